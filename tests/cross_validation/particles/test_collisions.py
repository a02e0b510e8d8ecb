"""Collisions: conservation, the number of them and their pairs, no bias at any step, a slow twin, threads."""

from __future__ import annotations

import itertools
import math

import numba
import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from kinetic_solver.laws import FollowTheLeader, Inelastic, PairLaw
from kinetic_solver.scene import Model
from particles.collisions import collide
from particles.ensemble import Ensemble
from particles.langevin import LangevinStep
from particles.random import COLLISIONS, key, words

FOLLOW = -1.0
"""Among restitution coefficients, for the law of (6)."""


def law(restitution: float) -> PairLaw:
    return FollowTheLeader(1.0) if restitution == FOLLOW else Inelastic(1.0, restitution)


K = key(4, 0)


@numba.njit
def four(cell, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    return words(COLLISIONS, cell, step, draw, k0, k1)


def slow(v: np.ndarray, starts: np.ndarray, rate: float, restitution: float, step: int) -> np.ndarray:
    """The same by the definition, in Python."""
    v = v.copy()
    for cell in range(len(starts) - 1):
        first, n = int(starts[cell]), int(starts[cell + 1] - starts[cell])
        if n < 2:
            continue
        width = v[first : first + n].max() - v[first : first + n].min()
        elapsed, draw = 0.0, 0
        while True:
            a, b, c, d = (int(word) for word in four(cell, np.uint64(step), draw, K[0], K[1]))
            elapsed -= math.log((d + 0.5) / 2**32)
            if elapsed > 0.5 * n * (n - 1) * rate * width:
                break
            draw += 1
            i, j = a * n >> 32, b * (n - 1) >> 32
            j += j >= i
            u, w = v[first + i], v[first + j]
            if (c + 0.5) / 2**32 * width < abs(u - w):
                fast, slower = (i, j) if u > w else (j, i)
                base, r = min(u, w), abs(u - w)
                lost = 0.0 if restitution < 0 else 0.5 * (1 - restitution) * r
                v[first + fast] = base + lost
                v[first + slower] = base + (0.0 if restitution < 0 else 0.5 * (1 + restitution) * r)
    return v


def ensemble(cells: int, each: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    v = np.random.default_rng(seed).normal(size=cells * each)
    return v, each * np.arange(cells + 1), np.zeros((cells, 2), dtype=np.int64)


@pytest.mark.parametrize("restitution", [FOLLOW, 0.0, 0.6, 1.0])
@pytest.mark.parametrize("threads", [1, 2])
def test_slow_twin(restitution: float, threads: int) -> None:
    rng = np.random.default_rng(3)
    starts = np.concatenate([[0], np.cumsum([0, 1, 2, 30, 0, 17])])
    v = rng.normal(size=int(starts[-1]))
    expected = slow(v, starts, 0.05, restitution, 9)
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        collide(v, starts, 0.05, law(restitution), 9, K, np.zeros((6, 2), dtype=np.int64))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(v, expected)


def test_what_each_operator_conserves() -> None:
    for restitution in (0.0, 0.6, 1.0, FOLLOW):
        v, starts, tally = ensemble(50, 40)
        before = v.reshape(50, 40).copy()
        collide(v, starts, 0.05, law(restitution), 1, K, tally)
        after = v.reshape(50, 40)
        assert tally[:, 1].sum() > 500
        if restitution == FOLLOW:
            assert np.isin(after, before).all()
            assert np.array_equal(after.min(axis=1), before.min(axis=1))
            assert (after.sum(axis=1) < before.sum(axis=1)).all()
            continue
        assert np.abs(after.sum(axis=1) - before.sum(axis=1)).max() < 1e-12
        energy = (after**2).sum(axis=1) - (before**2).sum(axis=1)
        assert (energy < 0).all() if restitution < 1 else np.abs(energy).max() < 1e-12
        if restitution == 1:
            assert np.allclose(np.sort(after, axis=1), np.sort(before, axis=1), rtol=0, atol=1e-14)


def test_the_number_of_collisions_is_a_poisson_process() -> None:
    """ε = 1 only exchanges velocities, so the rate stays what it was: ½ n(n - 1) rate ⟨|v - v'|⟩ in each cell."""
    cells, each, rate = 2000, 12, 0.02
    v, starts, tally = ensemble(1, each)
    v, starts, tally = np.tile(v, cells), each * np.arange(cells + 1), np.zeros((cells, 2), dtype=np.int64)
    expected = rate * np.abs(v[:each, None] - v[None, :each]).sum() / 2
    collide(v, starts, rate, law(1.0), 3, K, tally)
    counts = tally[:, 1]
    assert abs(counts.mean() - expected) < 4 * math.sqrt(expected / cells)
    assert counts.var() == pytest.approx(expected, rel=4 * math.sqrt(2 / cells + 1 / (expected * cells)))
    candidates, majorant = tally[:, 0], rate * each * (each - 1) / 2 * (v.max() - v.min())
    assert abs(candidates.mean() - majorant) < 4 * math.sqrt(majorant / cells)
    # Accepted and refused candidates are independent Poisson processes.
    assert abs(np.corrcoef(counts, candidates - counts)[0, 1]) < 4 / math.sqrt(cells)


def test_pairs_collide_in_proportion_to_their_relative_velocity() -> None:
    """Cells with one collision: ε = 1 shows which pair by its exchange, and does not change the rates."""
    cells, one = 60_000, np.array([-1.9, -0.4, 0.1, 0.7, 2.3])
    v, starts, tally = np.tile(one, cells), 5 * np.arange(cells + 1), np.zeros((cells, 2), dtype=np.int64)
    collide(v, starts, 0.03, law(1.0), 8, K, tally)
    changed = np.abs(v.reshape(cells, 5) - one)[tally[:, 1] == 1] > 1e-9
    assert len(changed) > 10_000
    assert (changed.sum(axis=1) == 2).all()
    pairs = list(itertools.combinations(range(5), 2))
    counts = np.array([(changed[:, i] & changed[:, j]).sum() for i, j in pairs])
    distances = np.array([one[j] - one[i] for i, j in pairs])
    assert stats.chisquare(counts, len(changed) * distances / distances.sum()).pvalue > 1e-3


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_a_pair_alone(parts: int) -> None:
    """(12) for two particles: after c collisions the next comes at the rate ε^c |v - v'|, a pure birth process, at any step."""
    cells, restitution, distance, time = 40_000, 0.6, 2.4, 1.3
    v, starts = np.tile([1.7, 1.7 - distance], cells), 2 * np.arange(cells + 1)
    total = np.zeros(cells, dtype=np.int64)
    for part in range(parts):
        tally = np.zeros((cells, 2), dtype=np.int64)
        collide(v, starts, time / parts, law(restitution), 40 + part, K, tally)
        total += tally[:, 1]
    rates = distance * restitution ** np.arange(40)
    generator = np.diag(-rates) + np.diag(rates[:-1], 1)
    expected = cells * expm(time * generator)[0, :6]
    observed = np.bincount(total, minlength=6)
    assert stats.chisquare([*observed[:6], cells - observed[:6].sum()], [*expected, cells - expected.sum()]).pvalue > 1e-3
    left = v[1::2] - v[::2]
    assert np.abs(np.abs(left) - distance * restitution**total).max() < 1e-14
    assert np.array_equal(np.sign(left), (-1.0) ** (total + 1))  # they come apart as they came together, in one dimension


@pytest.mark.parametrize("parts", [1, 3])
def test_three_that_follow(parts: int) -> None:
    """(6) for three particles is a Markov chain over 27 states: its probabilities by the matrix exponential, at any step."""
    cells, levels, time = 40_000, (-1.3, 0.2, 1.9), 0.35
    states = list(itertools.product(range(3), repeat=3))
    generator = np.zeros((27, 27))
    for s, state in enumerate(states):
        for i, j in itertools.combinations(range(3), 2):
            after = list(state)
            after[i] = after[j] = min(state[i], state[j])
            rate = abs(levels[state[i]] - levels[state[j]])
            generator[s, states.index(tuple(after))] += rate
            generator[s, s] -= rate
    expected = cells * expm(time * generator)[states.index((1, 2, 0))]
    v = np.tile([levels[1], levels[2], levels[0]], cells)
    for part in range(parts):
        collide(v, 3 * np.arange(cells + 1), time / parts, law(FOLLOW), 50 + part, K, np.zeros((cells, 2), dtype=np.int64))
    places = np.searchsorted(levels, v.reshape(cells, 3))
    observed = np.bincount(places @ [9, 3, 1], minlength=27)
    reached = expected > 1e-9
    assert expected[reached].min() > 20
    assert observed[~reached].sum() == 0
    assert stats.chisquare(observed[reached], expected[reached]).pvalue > 1e-3


def test_cells_that_cannot_collide() -> None:
    """Empty ones, one particle, equal velocities, no time: nothing changes, and the tally of the step before goes."""
    starts = np.array([0, 0, 1, 1, 5, 8])
    v = np.array([0.3, 1.2, 1.2, 1.2, 1.2, -0.7, 0.4, 2.1])
    before, tally = v.copy(), np.full((5, 2), 77)
    collide(v, starts, 0.0, law(FOLLOW), 2, K, tally)
    assert np.array_equal(v, before)
    assert not tally.any()
    collide(v, starts, 50.0, law(FOLLOW), 2, K, tally)
    assert np.array_equal(v[:5], before[:5])
    assert not tally[:4].any()
    assert (v[5:] == -0.7).all()


@pytest.mark.parametrize("restitution", [0.6, FOLLOW])
def test_the_same_bits_at_any_number_of_threads(restitution: float) -> None:
    found, before = [], numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            v, starts, tally = ensemble(301, 23)
            collide(v, starts, 0.05, law(restitution), 9, K, tally)
            found.append((v, tally))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])


@pytest.mark.parametrize(
    ("restitution", "temperature", "excess", "collisions"),
    [(0.5, 0.733296, 0.019940, 0.965046), (FOLLOW, 1.0, 0.0, 2 / math.sqrt(math.pi))],
)
def test_homogeneous_states(restitution: float, temperature: float, excess: float, collisions: float) -> None:
    """Half Langevin, collisions, half Langevin at R* = 1 from another state: u, θ/σ, kurtosis and the rate of collisions.

    Of (12) those of the kinetic equation (tests/exact/test_homogeneous.py), of (6) θ = σ and u = (g - Sρσ)/γ. A pipe so
    short that all of it mixes; 8 ensembles, each averaged over the times γt from 8 to 18, whose scatter gives the standard error.
    """
    g, gamma, sigma, count, cells, every = 1.3, 0.7, 0.5, 25_000, 5, 6
    h, rate = 0.03 / gamma, gamma / math.sqrt(sigma)  # Sρ
    model = Model(gravity=g, friction=gamma, noise=sigma)
    half, whole = LangevinStep.over(model, h / 2), LangevinStep.over(model, h)
    tally, means = np.zeros((cells, 2), dtype=np.int64), []
    for replica in range(8):
        rng, k = np.random.default_rng([9, replica]), key(9, replica)
        gas = Ensemble(rng.uniform(0, 0.9, count), rng.normal(1.5, 1.1, count), 0.9, cells)
        gas.advance_and_sort(half, 0, k)
        samples = []
        for step in range(1, 601):
            collide(gas.v, gas.starts, rate * cells / count * h, law(restitution), step, k, tally)
            if step % every or step * gamma * h < 8:
                gas.advance_and_sort(whole, 2 * step, k)
                continue
            gas.advance(half, 2 * step, k)
            u, squares = gas.v.mean(), (gas.v - gas.v.mean()) ** 2
            theta = squares.mean()
            samples.append((u, theta, squares @ squares / count / (3 * theta**2) - 1, tally[:, 1].sum()))
            gas.advance_and_sort(half, 2 * step + 1, k)
        means.append(np.mean(samples, axis=0))
    mean, error = np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / math.sqrt(8)
    drag = rate * sigma if restitution == FOLLOW else 0.0
    expected = [(g - drag) / gamma, temperature * sigma, excess, count / 2 * collisions * gamma * h]
    assert (np.abs(mean - expected) < 4 * error).all()


@pytest.mark.parametrize(("restitution", "power"), [(0.3, 2), (FOLLOW, 1)])
def test_no_bias_at_any_step(restitution: float, power: int) -> None:
    """One long step against eight short ones, over 4000 cells: the same mean of v^power within 4 standard errors."""
    cells, each = 4000, 20
    means = []
    for parts, first in ((1, 100), (8, 200)):
        v, starts, tally = ensemble(cells, each, seed=parts)
        for part in range(parts):
            collide(v, starts, 0.08 / parts, law(restitution), first + part, K, tally)
        moment = (v.reshape(cells, each) ** power).mean(axis=1)
        means.append((moment.mean(), moment.std() / math.sqrt(cells)))
    assert abs(means[0][0] - means[1][0]) < 4 * math.hypot(means[0][1], means[1][1])


def test_the_rate_of_cooling() -> None:
    """(12): dE/dt = -S(1 - ε²)/4 ∬ f f' |v - v'|³, per cell by a step so short that it is linear; a sum over pairs."""
    cells, each, rate, restitution = 20_000, 8, 2e-3, 0.4
    v, _, _ = ensemble(1, each)
    expected = -rate * (1 - restitution**2) / 4 * (np.abs(v[:, None] - v[None, :]) ** 3).sum() / 2
    start = float((v**2).sum()) / 2
    v, starts, tally = np.tile(v, cells), each * np.arange(cells + 1), np.zeros((cells, 2), dtype=np.int64)
    collide(v, starts, rate, law(restitution), 3, K, tally)
    change = (v.reshape(cells, each) ** 2).sum(axis=1) / 2 - start
    assert abs(change.mean() - expected) < 4 * change.std() / math.sqrt(cells) + 0.02 * abs(expected)
