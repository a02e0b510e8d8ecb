"""Collisions: conservation, the number of them and their pairs, no bias at any step, a slow twin, threads."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from particles.collisions import FOLLOW, collide
from particles.random import COLLISIONS, key, words

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
                if restitution < 0:
                    v[first + i] = v[first + j] = min(u, w)
                else:
                    middle, half = (u + w) / 2, restitution * (u - w) / 2
                    v[first + i], v[first + j] = middle - half, middle + half
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
        collide(v, starts, 0.05, restitution, 9, K, np.zeros((6, 2), dtype=np.int64))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(v, expected)


def test_what_each_operator_conserves() -> None:
    for restitution in (0.0, 0.6, 1.0, FOLLOW):
        v, starts, tally = ensemble(50, 40)
        before = v.reshape(50, 40).copy()
        collide(v, starts, 0.05, restitution, 1, K, tally)
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
    collide(v, starts, rate, 1.0, 3, K, tally)
    counts = tally[:, 1]
    assert abs(counts.mean() - expected) < 4 * math.sqrt(expected / cells)
    assert counts.var() == pytest.approx(expected, rel=4 * math.sqrt(2 / cells + 1 / (expected * cells)))


@pytest.mark.parametrize(("restitution", "power"), [(0.3, 2), (FOLLOW, 1)])
def test_no_bias_at_any_step(restitution: float, power: int) -> None:
    """One long step against eight short ones, over 4000 cells: the same mean of v^power within 4 standard errors."""
    cells, each = 4000, 20
    means = []
    for parts, first in ((1, 100), (8, 200)):
        v, starts, tally = ensemble(cells, each, seed=parts)
        for part in range(parts):
            collide(v, starts, 0.08 / parts, restitution, first + part, K, tally)
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
    collide(v, starts, rate, restitution, 3, K, tally)
    change = (v.reshape(cells, each) ** 2).sum(axis=1) / 2 - start
    assert abs(change.mean() - expected) < 4 * change.std() / math.sqrt(cells) + 0.02 * abs(expected)
