"""Collision operators: their slow twins, what they conserve, positivity, and the rates that are known exactly."""

from __future__ import annotations

import math
from itertools import pairwise

import numba
import numpy as np
import pytest

from kinetic_solver import threads as threads_module
from kinetic_solver.operators.collisions import FollowLeader, Inelastic

EPS = np.finfo(float).eps
S = 1.7
DEPOSITS = ["linear", "cubic", "quintic"]
POINTS = {"linear": 2, "cubic": 4, "quintic": 6}


def velocities(nv: int, low: float = -7.0, high: float = 9.0) -> np.ndarray:
    return low + (high - low) / nv * (np.arange(nv) + 0.5)


def states(v: np.ndarray) -> np.ndarray:
    """Three x: a Maxwellian, two cold streams, and noise that reaches the window's edges."""
    rng = np.random.default_rng(3)
    one = np.exp(-((v - 0.4) ** 2) / 1.6)
    two = np.exp(-((v + 2) ** 2)) + 0.3 * np.exp(-((v - 3) ** 2))
    return np.stack([one, two, rng.random(v.size)])


def gain_and_loss(f: np.ndarray, v: np.ndarray, restitution: float, points: int, corrected: bool) -> np.ndarray:
    """The weak form, pair by pair: what `Inelastic.rate` computes, one x at a time, in plain loops."""
    nv, dv = v.size, v[1] - v[0]
    alpha = (1 - restitution) / 2
    out = np.zeros(nv)

    def place(at: float, amount: float, points: int) -> bool:
        first = math.floor(at) - (points // 2 - 1)
        if first < 0 or first + points > nv:
            return False
        for node in range(first, first + points):
            weight = math.prod((at - other) / (node - other) for other in range(first, first + points) if other != node)
            out[node] += weight * amount
        return True

    def fits(at: float) -> bool:
        first = math.floor(at) - (points // 2 - 1)
        return first >= 0 and first + points <= nv

    for b in range(nv):
        for a in range(b + 1, nv):
            rate = S * f[a] * f[b] * (v[a] - v[b]) * dv
            out[a] -= rate
            out[b] -= rate
            shift = alpha * (a - b)
            # The faster product is the mirror image of the slower one, stencil and all.
            for at, mirrored in ((b + shift, False), (a - shift, True)):
                used = points if fits(b + shift) and fits(nv - 1 - (a - shift)) else 2
                if mirrored:
                    out[:] = out[::-1]
                    assert place(nv - 1 - at, rate, used)
                    out[:] = out[::-1]
                else:
                    assert place(at, rate, used)
    if corrected:
        square = S * dv**2 * alpha * (1 - alpha) / 120 * f[1:-1] ** 2
        out[:-2] += square
        out[1:-1] -= 2 * square
        out[2:] += square
    return out


@pytest.mark.parametrize("deposit", DEPOSITS)
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9])
def test_inelastic_against_its_slow_twin(deposit: str, restitution: float) -> None:
    v = velocities(25)
    f = states(v)
    fast = Inelastic(v, S, restitution, deposit).rate(f)
    slow = np.stack([gain_and_loss(row, v, restitution, POINTS[deposit], deposit == "quintic") for row in f])
    assert np.abs(fast - slow).max() < 100 * EPS * np.abs(slow).max()


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_inelastic_against_equation_12_as_printed(restitution: float) -> None:
    """Gain and loss integrals of (12) for a Gaussian, by adaptive quadrature, at a few velocities."""
    from scipy.integrate import quad

    v = velocities(600, -8.0, 8.0)
    mean, theta = 0.4, 0.8

    def f(w: float) -> float:
        return math.exp(-((w - mean) ** 2) / (2 * theta))

    rate = Inelastic(v, S, restitution, "quintic").rate(np.array([[f(w) for w in v]]))[0]
    for j in (220, 270, 300, 350, 400):
        at = v[j]
        gain = lambda w: f(w) * f((2 * at - (1 - restitution) * w) / (1 + restitution)) * abs(w - at)  # noqa: B023, E731
        loss = lambda w: f(w) * abs(w - at)  # noqa: B023, E731
        opts = {"points": [at], "epsabs": 1e-13, "epsrel": 1e-12, "limit": 200}
        expected = 4 / (1 + restitution) ** 2 * quad(gain, -12, 12, **opts)[0] - f(at) * quad(loss, -12, 12, **opts)[0]
        assert rate[j] == pytest.approx(S * expected, abs=3e-9)


@pytest.mark.parametrize("deposit", DEPOSITS)
@pytest.mark.parametrize("restitution", [0.0, 0.25, 0.5, 0.77, 1.0])
@pytest.mark.parametrize("nv", [8, 61, 200])
def test_inelastic_conserves_mass_and_momentum(deposit: str, restitution: float, nv: int) -> None:
    v = velocities(nv)
    f = states(v)
    operator = Inelastic(v, S, restitution, deposit)
    rate = operator.rate(f)
    lost = np.maximum(np.abs(rate).sum(axis=1), EPS)
    assert np.abs(rate.sum(axis=1) / lost).max() < 20 * EPS * nv
    assert np.abs(rate @ v / (np.abs(rate) @ np.abs(v) + EPS)).max() < 20 * EPS * nv
    after = operator(f, 0.7)
    assert np.abs(after.sum(axis=1) / f.sum(axis=1) - 1).max() < 1e-13
    assert np.abs((after - f) @ v).max() < 1e-13 * (f @ np.abs(v)).max()
    assert operator.conserves == ("mass", "momentum")


@pytest.mark.parametrize("deposit", DEPOSITS)
def test_elastic_collisions_do_nothing(deposit: str) -> None:
    v = velocities(64)
    f = states(v)
    operator = Inelastic(v, S, 1.0, deposit)
    assert not operator.rate(f).any()
    assert np.array_equal(operator(f, 3.0), f)


@pytest.mark.parametrize("dt", [0.01, 0.3, 20.0])
def test_the_linear_deposit_is_positive_at_any_step(dt: float) -> None:
    """Also from a state with empty cells, in which any negative weight would show."""
    v = velocities(64)
    f = states(v)
    f[2, ::3] = 0.0
    for restitution in (0.0, 0.6):
        after = Inelastic(v, S, restitution, "linear")(f, dt)
        assert after.min() > -np.finfo(float).tiny  # the far tail underflows, where arithmetic is no longer relative
        assert np.abs(after.sum(axis=1) / f.sum(axis=1) - 1).max() < 1e-13


def energy_rate_error(deposit: str, nv: int, restitution: float) -> float:
    """Relative error of ∫v²C dv on a Maxwellian; the window spans 16 standard deviations."""
    rho, theta, mean = 0.8, 0.6, 0.35
    reach = 8 * math.sqrt(theta)
    v = velocities(nv, mean - reach, mean + reach)
    f = rho * np.exp(-((v - mean) ** 2) / (2 * theta)) / math.sqrt(2 * math.pi * theta)
    rate = Inelastic(v, S, restitution, deposit).rate(f[None])[0] @ v**2 * (v[1] - v[0])
    expected = -2 * S * (1 - restitution**2) / math.sqrt(math.pi) * rho**2 * theta**1.5
    return abs(rate / expected - 1)


@pytest.mark.parametrize(("deposit", "order"), [("linear", 2), ("cubic", 4), ("quintic", 6)])
@pytest.mark.parametrize(("restitution", "coarsest"), [(0.1, 32), (0.5, 32), (0.9, 80)])
def test_energy_rate_on_a_maxwellian(deposit: str, order: int, restitution: float, coarsest: int) -> None:
    """-2S(1 - ε²)/√π ρ²θ^(3/2), at the deposit's order in dv from both sides.

    Near-elastic products move by less than a cell until (1 - ε)/2 · √θ > dv: the order shows from there on.
    """
    errors = [energy_rate_error(deposit, nv, restitution) for nv in (coarsest, 2 * coarsest, 4 * coarsest)]
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    assert all(order - 0.3 < o < order + 0.3 for o in orders), (errors, orders)


@pytest.mark.parametrize(("deposit", "order"), [("linear", 2), ("cubic", 4), ("quintic", 6)])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_order_of_c_at_every_velocity(deposit: str, order: int, restitution: float) -> None:
    """max|ΔC| on a Maxwellian; the points of each grid are among those of the reference, three times finer."""
    errors = []
    for nv in (54, 108, 216):
        v, fine = velocities(nv, -8.0, 8.0), velocities(3 * nv, -8.0, 8.0)
        f, f_fine = (np.exp(-(w**2) / 2)[None] for w in (v, fine))
        reference = Inelastic(fine, S, restitution, "quintic").rate(f_fine)[0, 1::3]
        errors.append(np.abs(Inelastic(v, S, restitution, deposit).rate(f)[0] - reference).max())
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    assert all(order - 0.4 < o < order + 0.2 for o in orders), (errors, orders)


def test_inelastic_substep_is_second_order_in_time() -> None:
    """From where two stages are enough; a step that positivity splits into more is the more accurate for it."""
    v = velocities(64)
    operator = Inelastic(v, S, 0.5, "quintic")
    f = states(v)[:2]
    end = 4.0 / operator.collision_frequency_max(f)

    def advance(steps: int) -> np.ndarray:
        g = f
        for _ in range(steps):
            g = operator(g, end / steps)
        return g

    reference = advance(1024)
    errors = {n: float(np.abs(advance(n) - reference).max()) for n in (1, 16, 32, 64)}
    orders = [math.log2(errors[a] / errors[b]) for a, b in ((16, 32), (32, 64))]
    assert all(1.9 < o < 2.1 for o in orders), (errors, orders)
    assert errors[1] < 256 * errors[16]


def test_follow_leader_against_its_slow_twin_and_equation_6() -> None:
    v = velocities(40)
    f, dv, dt = states(v), v[1] - v[0], 0.37
    operator = FollowLeader(v, S)
    rho = f.sum(axis=1, keepdims=True) * dv
    u = (f @ v)[:, None] * dv / rho
    assert operator.rate(f) == pytest.approx(S * f * rho * (u - v), abs=1e-13)
    slow = f * np.exp(-S * rho * (v - u) * dt)
    slow *= rho / (slow.sum(axis=1, keepdims=True) * dv)
    assert operator(f, dt) == pytest.approx(slow, rel=1e-13, abs=0)


def test_rates_of_follow_leader_from_moments() -> None:
    """∫∫v C and ½∫∫v² C by the moments of f are those of the rate itself."""
    v = velocities(96)
    f, dx = states(v)[:2], 0.7
    operator = FollowLeader(v, S)
    dv = v[1] - v[0]
    moments = (f @ (v[:, None] ** np.arange(4)) * dv).T
    rate = operator.rate(f).sum(axis=0) * dx * dv
    assert operator.brought(moments, dx) == pytest.approx((rate @ v, rate @ v**2 / 2), rel=1e-12)


def test_follow_leader_substep_is_exact_in_time() -> None:
    """One step is many steps; its limit is the rate; a Maxwellian moves by Sρθ dt and keeps its temperature (8)."""
    v = velocities(200, -14.0, 10.0)
    dv, theta, rho = v[1] - v[0], 0.7, 1.3
    f = rho * np.exp(-((v - 0.4) ** 2) / (2 * theta))[None] / math.sqrt(2 * math.pi * theta)
    operator = FollowLeader(v, S)
    once, often = operator(f, 0.9), f
    for _ in range(9):
        often = operator(often, 0.1)
    assert np.abs(once - often).max() < 1e-13 * f.max()
    moved = rho * np.exp(-((v - 0.4 + S * rho * theta * 0.9) ** 2) / (2 * theta)) / math.sqrt(2 * math.pi * theta)
    assert np.abs(once[0] - moved).max() < 1e-13 * f.max()
    assert operator.rate(f)[0] @ v * dv == pytest.approx(-S * rho**2 * theta, rel=1e-12)
    slope = (operator(f, 1e-5) - operator(f, -1e-5)) / 2e-5
    assert np.abs(slope - operator.rate(f)).max() < 1e-8


@pytest.mark.parametrize("dt", [0.01, 1.0, 100.0])
def test_follow_leader_conserves_mass_and_is_positive(dt: float) -> None:
    v = velocities(64)
    f = states(v)
    f[1] = 0.0  # an empty place stays empty
    after = FollowLeader(v, S)(f, dt)
    assert after.min() >= 0
    assert np.array_equal(after[1], f[1])
    assert np.abs(after.sum(axis=1) - f.sum(axis=1)).max() < 1e-13 * f.sum(axis=1).max()


@pytest.mark.parametrize("operator", [FollowLeader(velocities(64), S), Inelastic(velocities(64), S, 0.4, "cubic")])
def test_bits_do_not_depend_on_threads(operator: FollowLeader | Inelastic, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads_module, "SECONDS_OF_A_THREAD", 1e-9)  # so little work would get one thread
    f = np.tile(states(operator.velocity), (5, 1)) * np.linspace(0.5, 2, 15)[:, None]
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(operator(f, 0.3))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(*results)


def test_rows_in_threads_are_all_of_them_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """In parts that join, one for each thread that there is work for; what goes wrong in a part is raised."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: 3)
    for rows, seconds, expected in ((7, 1.0, 3), (2, 1.0, 2), (7, 2.1 * threads_module.SECONDS_OF_A_THREAD, 2), (7, 1e-5, 1)):
        parts: list[slice] = []
        threads_module.over_rows(parts.append, rows, seconds)
        assert len(parts) == expected
        assert sorted(i for part in parts for i in range(rows)[part]) == list(range(rows))

    def broken(part: slice) -> None:
        raise ZeroDivisionError(part)

    with pytest.raises(ZeroDivisionError):
        threads_module.over_rows(broken, 7, 1.0)
