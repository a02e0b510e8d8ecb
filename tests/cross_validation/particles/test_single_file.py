"""Single file: flights against a slow twin, every overtaking counted, rates, orders, sticking, restarts, what is refused."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal, localcontext
from fractions import Fraction

import numba
import numpy as np
import pytest

from kinetic_solver.errors import SceneError
from kinetic_solver.laws import FollowTheLeader, Inelastic, PairLaw
from kinetic_solver.scene import Model
from particles.random import OVERTAKINGS, key, words
from particles.single_file import SingleFile, _fly, _kernel, _settle, sticking
from particles.specialised import specialised

FOLLOW = -1.0
"""Among restitution coefficients, for the law of (6)."""


def law(restitution: float) -> PairLaw:
    return FollowTheLeader(1.0) if restitution == FOLLOW else Inelastic(1.0, restitution)


K = key(4, 0)
leaders = _kernel(FollowTheLeader)
STILL = Model(gravity=0.0, friction=0.0, noise=0.0)


@numba.njit
def first_word(event, step, k0, k1):  # type: ignore[no-untyped-def]
    return words(OVERTAKINGS, event, step, 0, k0, k1)[0]


def slow(
    x: list[Decimal], v: list[Decimal], length: int, h: Decimal, probability: float, restitution: float, step: int
) -> tuple[int, int]:
    """A flight in place, to 60 digits: all pairs of all particles are looked at for the next meeting. Moves x over h."""
    n, now, events, collisions = len(x), Decimal(0), 0, 0
    while True:
        best: tuple[Decimal, int] | None = None
        earliest = []
        for a in range(n):
            for ahead in range(a + 1, a + n):
                b = ahead % n
                gap = x[b] + (length if ahead >= n else 0) - x[a]
                if v[a] > v[b]:
                    assert gap / (v[a] - v[b]) > now - Decimal("1e-40")
                    time = max(now, gap / (v[a] - v[b]))
                    earliest.append(time)
                    if ahead == a + 1 and (best is None or (time, a) < best):
                        best = time, a
        if best is None or best[0] >= h:
            break
        now, a = best
        assert now - min(earliest) < Decimal("1e-40")
        b, shift = (a + 1, 0) if a + 1 < n else (0, length)
        collides = (int(first_word(events, np.uint64(step), K[0], K[1])) + 0.5) / 2**32 < probability
        events += 1
        if not collides:
            x[a], x[b], v[a], v[b] = x[b] + shift, x[a] - shift, v[b], v[a]
            continue
        collisions += 1
        place = x[a] + v[a] * now
        if restitution < 0:
            new = v[b], v[b]
        else:
            middle, half = (v[a] + v[b]) / 2, Decimal(restitution) * (v[a] - v[b]) / 2
            new = middle - half, middle + half
        v[a], v[b] = new
        x[a], x[b] = place - v[a] * now, place - shift - v[b] * now
    for s in range(n):
        x[s] += v[s] * h
    return events, collisions


@pytest.mark.parametrize(
    ("probability", "restitution"),
    [(0.0, FOLLOW), (0.4, FOLLOW), (1.0, FOLLOW), (0.4, 0.0), (0.4, 0.5), (1.0, 0.5), (0.4, 1.0), (1.0, 1.0)],
)
def test_a_slow_twin(probability: float, restitution: float) -> None:
    """Places and velocities slot by slot, over the joint of the ring too, and over more than a length."""
    total = across = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n, length, h = 7, 4, 0.875
        x = np.sort(rng.integers(0, length * 2**12, n)) / 2**12
        v = rng.integers(-(2**12), 2**12, n) / 2**10
        exact_x, exact_v = [Decimal(p) for p in x], [Decimal(p) for p in v]
        with localcontext(prec=60):
            expected = slow(exact_x, exact_v, length, Decimal(h), probability, restitution, seed)
        first = np.empty(16)
        kind = law(restitution)
        flight = specialised(_fly, kind.__class__, {}, after=numba.njit(kind.after))
        keeps, place = "momentum" in kind.conserves, (np.uint64(seed), K[0], K[1])
        found = flight(x, v, first, float(length), h, probability, kind.numbers, keeps, *place, 1e6)
        assert found == expected
        flown = x + v * h
        assert flown == pytest.approx([float(p) for p in exact_x], abs=1e-12)
        assert v == pytest.approx([float(p) for p in exact_v], abs=1e-13)
        _settle(x, v, float(length), h)
        assert 0 <= x[0] < length
        assert (np.diff(x) >= 0).all()
        assert np.abs(np.mod(x - flown + 1, length) - 1).max() < 1e-12
        total += found[0]
        across += not 0 <= flown[0] < length
    assert total > 100
    assert across > 0


@pytest.mark.parametrize("h", [0.01, 0.6, 7.0])
def test_every_overtaking_is_counted(h: float) -> None:
    """Free particles: as many overtakings as the straight lines of all pairs cross, and all arrive where they would alone."""
    rng = np.random.default_rng(2)
    n, length = 300, 5.0
    x, v = rng.uniform(0, length, n), rng.normal(size=n)
    file = SingleFile(x, v, length, 0.0, law(FOLLOW))
    overtakings, collisions = file.advance(STILL, h, 1, 0, K)
    i, j = np.triu_indices(n, 1)
    before, after = (x[j] - x[i]) / length, (x[j] - x[i] + (v[j] - v[i]) * h) / length
    assert overtakings == np.abs(np.floor(after) - np.floor(before)).sum()
    assert collisions == 0
    old, new = np.argsort(v), np.argsort(file.v)
    assert np.array_equal(v[old], file.v[new])
    distance = np.mod(file.places()[new] - (x + v * h)[old] + length / 2, length) - length / 2
    assert np.abs(distance).max() < 1e-12


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_momentum_and_order(restitution: float) -> None:
    """Momentum is exact once v is rounded to multiples of 2^-52 of the largest's power of two."""
    rng = np.random.default_rng(3)
    n, length = 2000, 5.0
    file = SingleFile(rng.uniform(0, length, n), 2 + rng.normal(size=n), length, 0.3, law(restitution))
    grain = 2.0 ** (math.frexp(np.abs(file.v).max())[1] - 52)
    momentum, energy = sum(map(Fraction, grain * np.rint(file.v / grain))), (file.v**2).sum()
    assert abs(float(momentum) - file.v.sum()) < 1e-11
    overtakings, collisions = file.advance(STILL, 0.25, 2, 0, K)
    assert abs(collisions - 0.3 * overtakings) < 4 * math.sqrt(0.21 * overtakings) < 0.011 * overtakings
    assert sum(map(Fraction, file.v)) == momentum
    change = (file.v**2).sum() / energy - 1
    assert abs(change) < 1e-12 if restitution == 1 else change < -0.01
    assert file.count == n
    assert (np.diff(file.x) >= 0).all()
    places = file.places()
    assert places.min() >= 0
    assert places.max() < length


def test_places_next_to_whole_lengths() -> None:
    """x[0] is brought back to [0, length) whatever rounding does, and equal places keep their slots."""
    rng = np.random.default_rng(6)
    for length in rng.uniform(0.1, 10, 300):
        for whole in (-7, -1, 0, 1, 2, 3, 10, 1001):
            for x in (np.nextafter(whole * length, -1e9), whole * length, np.nextafter(whole * length, 1e9)):
                place = np.array([x, x])
                _settle(place, np.zeros(2), length, 1.0)
                assert 0 <= place[0] < length
                assert place[0] == place[1]
    v = rng.normal(size=3000)
    assert np.array_equal(SingleFile(np.full(3000, 0.2), v, 1.0, 0.5, law(FOLLOW)).v, v)


@pytest.mark.parametrize("restitution", [FOLLOW, 0.5])
def test_the_rate_of_collisions(restitution: float) -> None:
    """S∫∫|v - v'| of a Maxwellian, (1/2) S ρ² L 2√(θ/π) per time, in standard errors; one of N stands for w."""
    n, length, cross_section, density, theta, h = 400, 10.0, 0.02, 200.0, 0.6, 0.01
    weight = density * length / n
    counts = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        file = SingleFile(
            rng.uniform(0, length, n), math.sqrt(theta) * rng.normal(size=n), length, cross_section * weight, law(restitution)
        )
        counts.append(file.advance(STILL, h, 1, seed, key(seed, 0)))
    overtakings, collisions = np.array(counts, dtype=float).T
    speed = 2 * math.sqrt(theta / math.pi)
    crossings = 0.5 * n * (n - 1) / length * speed * h
    real = 0.5 * cross_section * density**2 * length * speed * h * (n - 1) / n  # no particle meets itself
    changed = cross_section * density * speed * h  # the share of particles whose velocities are no longer Maxwellian
    for found, expected in ((overtakings, crossings), (weight * collisions, real)):
        error = found.std(ddof=1) / math.sqrt(len(found))
        assert abs(found.mean() - expected) < 4 * error + changed * expected


@pytest.mark.parametrize(
    ("model", "exact"),
    [
        (
            Model(gravity=1.0, friction=0.8, noise=0.0),
            lambda t: ((1 - math.exp(-0.8 * t)) / 0.8, (0.8 * t - 1 + math.exp(-0.8 * t)) / 0.64),
        ),
        (Model(gravity=1.0, friction=0.0, noise=0.0), lambda t: (t, t * t / 2)),
    ],
    ids=["friction", "free fall"],
)
def test_second_order_in_the_step(model: Model, exact) -> None:  # type: ignore[no-untyped-def]
    """Way of a particle without noise: its velocity's share and gravity's. Free fall is exact."""
    reach, fall = exact(3.0)
    errors = []
    for steps in (4, 8, 16, 32):
        file = SingleFile(np.array([1.0]), np.array([2.0]), 1e3, 0.0, law(FOLLOW))
        file.advance(model, 3.0, steps, 0, K)
        errors.append(abs(file.x[0] - 1 - 2 * reach - fall))
    if model.friction == 0:
        assert max(errors) < 1e-11
    else:
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert 1.95 < orders[-1] < 2.05


def test_the_noise_of_places() -> None:
    """Variances and covariance of x and v after n steps: those of the splitting in standard errors, which are of second order."""
    model, time = Model(gravity=0.5, friction=0.7, noise=1.3), 2.0
    gamma, sigma = model.friction, model.noise
    e = math.exp(-gamma * time)
    exact = sigma / gamma**2 * (2 * gamma * time - 3 + 4 * e - e * e)

    def of_splitting(steps: int) -> np.ndarray:
        covariance, h = np.zeros((2, 2)), time / steps
        for part in range(2 * steps + 1):
            if part % 2:
                a, noise = np.array([[1, h], [0, 1]]), 0.0
            else:
                t = h / 2 if part in (0, 2 * steps) else h
                a, noise = np.diag([1, math.exp(-gamma * t)]), sigma * -math.expm1(-2 * gamma * t)
            covariance = a @ covariance @ a.T + np.diag([0, noise])
        return covariance

    errors = np.array([of_splitting(steps)[0, 0] - exact for steps in (8, 16, 32, 64)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert 1.95 < orders[-1] < 2.05
    n = 200_000
    start = 100.0 * np.arange(n)
    file = SingleFile(start, np.zeros(n), 100.0 * n, 0.0, law(FOLLOW))
    overtakings, _ = file.advance(model, time, 2, 5, K)
    assert overtakings == 0
    shift = file.length if file.x[-1] > file.length + 50 else 0.0
    found = np.cov(file.x - start - shift, file.v)
    expected = of_splitting(2)
    errors = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / n)
    assert (np.abs(found - expected) < 4 * errors).all()
    assert abs(expected[0, 0] - exact) > 4 * errors[0, 0]


@pytest.mark.parametrize("restitution", [FOLLOW, 0.0, 0.5])
def test_the_same_bits_from_a_state_and_on_threads(restitution: float) -> None:
    model, n, length, pieces = Model(gravity=1.0, friction=1.0, noise=1.0), 300, 3.0, 6

    def start(replica: int) -> SingleFile:
        rng = np.random.default_rng(replica)
        return SingleFile(rng.uniform(0, length, n), rng.normal(size=n), length, 0.3, law(restitution))

    def go(file: SingleFile, replica: int, first: int, last: int) -> SingleFile:
        for piece in range(first, last):
            file.advance(model, 0.1, 5, 6 * piece, key(9, replica))
        return file

    straight = [go(start(replica), replica, 0, pieces) for replica in range(2)]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda replica: go(start(replica), replica, 0, pieces), range(2)))
    assert not np.array_equal(straight[0].x, straight[1].x)
    ties = 0
    for replica, file in enumerate(straight):
        for middle in range(1, pieces):
            half = go(start(replica), replica, 0, middle)
            ties += int((np.diff(half.x) == 0).sum())
            resumed = go(SingleFile(half.x, half.v, length, 0.3, law(restitution)), replica, middle, pieces)
            assert np.array_equal(resumed.x, file.x)
            assert np.array_equal(resumed.v, file.v)
        assert np.array_equal(together[replica].x, file.x)
        assert np.array_equal(together[replica].v, file.v)
    assert (ties > 10) == (restitution <= 0)


@pytest.mark.parametrize(
    ("restitution", "strength", "u", "theta"), [(FOLLOW, 0.5, 0.5, 1.0), (0.5, 1.0, 1.0, 0.733296)], ids=["(6)", "(12)"]
)
def test_homogeneous_states(restitution: float, strength: float, u: float, theta: float) -> None:
    """u = (g - Sρσ)/γ and θ = σ with (6); u = g/γ and θ of the equation's own moments with (12), in standard errors; P ≪ 1."""
    model, n, length, replicas = Model(gravity=1.0, friction=1.0, noise=1.0), 2000, 8 * math.pi, 4
    probability = strength * length / n
    assert sticking(probability, 0.05) < 0.02
    means = np.empty((replicas, 2))
    for replica in range(replicas):
        rng = np.random.default_rng(replica)
        file = SingleFile(
            rng.uniform(0, length, n), u + math.sqrt(theta) * rng.normal(size=n), length, probability, law(restitution)
        )
        samples = []
        for piece in range(24):
            file.advance(model, 0.5, 10, 11 * piece, key(1, replica))
            if piece >= 8:
                samples.append((file.v.mean(), file.v.var()))
        means[replica] = np.mean(samples, axis=0)
    errors = means.std(axis=0, ddof=1) / math.sqrt(replicas)
    assert errors.max() < 0.02
    assert (np.abs(means.mean(axis=0) - (u, theta)) < 4 * np.maximum(errors, 0.003)).all()


@numba.njit
def ages(samples, longest, probability, k0, k1):  # type: ignore[no-untyped-def]
    """Steps until a pair that starts at Δx = Δv = 0 collides, longest + 1 if it does not; noise alone, unit steps."""
    found = np.empty(samples, dtype=np.int64)
    x, v, first, noise = np.empty(2), np.empty(2), np.empty(4), (1.0, 0.0, 1.0)
    for sample in range(samples):
        x[:], v[:], age, collisions = 5e8, 0.0, 0, 0
        while collisions == 0 and age <= longest:
            number = 2 * (sample * (longest + 1) + age)
            _, collisions, _ = leaders(
                x, v, first, 1e9, probability, (1.0,), False, 1.0, 1, noise, noise, number, k0, k1, 100.0, 0, 1
            )
            age += 1
        found[sample] = age
    return found


@pytest.mark.parametrize("probability", [1.0, 0.25])
def test_the_exponent_of_sticking(probability: float) -> None:
    """The share that has not collided falls as steps^-θ between 32 and 1024 steps, and is (1 - 0.53 P) steps^-θ."""
    survived = [(ages(12_000, 1024, probability, K[0], K[1]) > age).mean() for age in (32, 1024)]
    ratio = survived[1] / survived[0]
    exponent = -math.log(ratio) / math.log(32)
    error = math.sqrt((1 - ratio) / ratio / (12_000 * survived[0])) / math.log(32)
    theta = -math.log(1 - sticking(probability, 1e-3)) / math.log(1e3)
    assert error < 0.1 * theta
    assert abs(exponent - theta) < 4 * error
    assert survived[0] * 32**theta == pytest.approx(1 - 0.53 * probability, abs=0.02)


def test_sticking() -> None:
    assert sticking(1.0, 1e-4) == pytest.approx(0.9)
    assert sticking(1e-4, 1e-2) == pytest.approx(1e-4 * math.sqrt(3) / (2 * math.pi) * math.log(100), rel=1e-3)
    assert sticking(0.0, 1e-3) == pytest.approx(0.0, abs=1e-15)
    assert sticking(0.3, 2.0) == 0.0


@pytest.mark.parametrize(("restitution", "collapses"), [(0.05, True), (0.1, False)])
def test_inelastic_collapse_ends_in_rounding(restitution: float, collapses: bool) -> None:
    """Three particles collapse where ε < 7 - 4√3 = 0.072 (S. McNamara and W. R. Young 1992): their velocities become one."""
    file = SingleFile(np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.1, -1.0]), 100.0, 1.0, law(restitution))
    overtakings, collisions = file.advance(STILL, 40.0, 1, 0, K)
    assert overtakings == collisions < 200
    assert (overtakings > 10) == collapses
    assert (np.ptp(file.v) < 1e-12) == collapses
    assert file.v.sum() == pytest.approx(0.1, abs=1e-15)


@pytest.mark.parametrize("restitution", [FOLLOW, 0.0, 0.1, 0.5, 0.9])
def test_many_particles_collapse_in_one_flight(restitution: float) -> None:
    """P = 1 and a long flight. Averages of rounded velocities would go round in circles with ε = 0."""
    rng = np.random.default_rng(5)
    n, length = 100, 10.0
    x, v = np.sort(rng.uniform(0, length, n)), rng.normal(size=n)
    file = SingleFile(x, v, length, 1.0, law(restitution))
    overtakings, collisions = file.advance(STILL, 5.0, 1, 0, K)
    assert overtakings == collisions
    assert overtakings > (1000 * n if 0 <= restitution < 0.5 else n / 2)
    assert (np.diff(file.x) >= 0).all()
    if restitution >= 0:
        assert file.v.sum() == pytest.approx(v.sum(), abs=1e-13)


def test_refusals() -> None:
    with pytest.raises(SceneError, match=r"particles.count: with 4 particles .* is 1.6; allowed: up to 1; raise .* to 7 or more"):
        SingleFile(np.zeros(4), np.zeros(4), 1.0, 1.6, law(FOLLOW))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_not_a_number_stops(bad: float) -> None:
    file = SingleFile(np.array([0.1, 0.4, 0.7]), np.array([0.0, bad, 1.0]), 1.0, 0.5, law(0.5))
    with pytest.raises(RuntimeError, match="not a finite number"):
        file.advance(Model(), 0.1, 1, 0, K)


def test_too_many_overtakings_stop() -> None:
    """All particles in one place: more meetings than 100 times a homogeneous gas has."""
    n = 3000
    file = SingleFile(np.full(n, 0.5), -np.sort(np.random.default_rng(1).normal(size=n)), 1e3, 0.0, law(FOLLOW))
    with pytest.raises(RuntimeError, match=r"overtakings of a homogeneous gas in one step of 0\.01, .*raise particles\.count"):
        file.advance(STILL, 0.01, 1, 0, K)
