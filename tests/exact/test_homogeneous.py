"""Homogeneous stationary states: known numbers, scaling, and the grid solver's own relaxation to them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from kinetic_solver import solve
from kinetic_solver.initial import start_state
from kinetic_solver.operators.collisions import Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.homogeneous import _inelastic, homogeneous_state
from kinetic_solver.stability.inelastic import InelasticFlow

MakeScene = Callable[..., Scene]
UNIT = {"gravity": 0.0, "friction": 1.0, "noise": 1.0}

# (ε, Sρ) at γ = σ = 1: θ and a2 = ⟨w⁴⟩/(3θ²) - 1, from two independent computations.
KNOWN = {
    (0.0, 1.0): (0.68043451, 0.04815877),
    (0.5, 1.0): (0.7332962323, 0.0199397),
    (0.5, 1.347): (0.679406, 0.023459),
    (0.5, 10.0): (0.299769, 0.044325),
    (0.9, 100.0): (0.181439, -0.061548),
}


def inelastic(restitution: float, rate: float, **changes: object) -> dict[str, object]:
    table = {"operator": "inelastic", "cross_section": rate, "restitution": restitution}
    return {"collisions": table, "initial": {"density": 1.0, "modes": []}, "model": UNIT, **changes}


@pytest.mark.parametrize(("restitution", "rate"), KNOWN)
def test_known_states_of_operator_12(make_scene: MakeScene, restitution: float, rate: float) -> None:
    theta, a2 = KNOWN[restitution, rate]
    digits = 1e-8 if rate == 1.0 else 1e-6  # as many as are known
    state = homogeneous_state(make_scene(**inelastic(restitution, rate)))
    assert state is not None
    assert state.temperature == pytest.approx(theta, abs=digits)
    assert state.kurtosis_excess == pytest.approx(a2, abs=max(digits, 1e-7))


def test_collision_rate_of_operator_12(make_scene: MakeScene) -> None:
    state = homogeneous_state(make_scene(**inelastic(0.5, 1.0)))
    assert state is not None
    assert state.collision_rate == pytest.approx(0.965047, abs=2e-6)


def test_only_two_groups_matter(make_scene: MakeScene) -> None:
    """θ/σ and a2 depend on ε and R* alone; the mean is g/γ; the collision rate scales with γ."""
    gamma, sigma, g = 0.7, 0.5, 1.3
    rate = gamma / math.sqrt(sigma) / 0.8  # R* = 1 at density 0.8
    scene = make_scene(
        collisions={"operator": "inelastic", "cross_section": rate, "restitution": 0.5}, initial={"density": 0.8, "modes": []}
    )
    state, unit = homogeneous_state(scene), homogeneous_state(make_scene(**inelastic(0.5, 1.0)))
    assert state is not None
    assert unit is not None
    assert scene.groups.collision_number == pytest.approx(1.0, rel=1e-14)
    assert state.mean_velocity == pytest.approx(g / gamma)
    assert state.temperature == pytest.approx(sigma * unit.temperature, rel=1e-10)
    assert state.kurtosis_excess == pytest.approx(unit.kurtosis_excess, abs=1e-10)
    assert state.collision_rate == pytest.approx(gamma * unit.collision_rate, rel=1e-10)


def test_operator_6_and_no_collisions_are_gaussian(make_scene: MakeScene) -> None:
    follow = homogeneous_state(make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7}))
    free = homogeneous_state(make_scene())
    assert follow is not None
    assert free is not None
    assert (follow.temperature, follow.kurtosis_excess) == (free.temperature, free.kurtosis_excess) == (0.5, 0.0)
    assert follow.mean_velocity == pytest.approx((1.3 - 1.7 * 0.8 * 0.5) / 0.7)
    assert free.mean_velocity == pytest.approx(1.3 / 0.7)


def test_where_there_is_no_stationary_state(make_scene: MakeScene) -> None:
    scene = make_scene(model={"gravity": 1.3, "friction": 0.7, "noise": 0.0})
    assert homogeneous_state(scene) is None
    assert start_state(scene) == (1.3 / 0.7, 1.0)
    assert start_state(make_scene(model={"friction": 0.0})) == (0.0, 0.5)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_the_grid_solver_relaxes_to_it(make_scene: MakeScene, restitution: float) -> None:
    """From a cold Maxwellian over 25/γ, by the time-dependent solver, which shares only the quadrature of C."""
    theta, a2 = KNOWN[restitution, 1.0]
    scene = make_scene(
        **inelastic(restitution, 1.0, run={"end_time": 25.0}, accuracy={"rtol": 1e-8}, output={"f": False, "budgets": False}),
        grid={"nv": 160, "velocity_window": (-7.5, 7.5), "deposit": "quintic"},
    )
    final = solve(scene).isel(time=-1)
    v, w = final["v"].values, final["velocity_distribution"].values
    mean = w @ v / w.sum()
    variance = w @ (v - mean) ** 2 / w.sum()
    kurtosis = w @ (v - mean) ** 4 / w.sum() / (3 * variance**2) - 1
    assert variance == pytest.approx(theta, abs=1e-7)
    assert kurtosis == pytest.approx(a2, abs=1e-7)


def pairs_of_cells(restitution: float, collision_number: float) -> tuple[float, float, float]:
    """A slow twin that shares nothing with stability's: (θ, a2, ⟨|v - v'|⟩) of 0 = ∂(vf + ∂f) + R* C[f], γ = σ = S = ρ = 1.

    Velocity points in a periodic window, derivatives by the discrete Fourier transform, C with the solver's quintic deposit, by
    Newton's method.
    """
    c = collision_number * (1 - restitution**2) / math.sqrt(math.pi)
    guess = brentq(lambda theta: theta - 1 + c * theta**1.5, 0.0, 1.0)
    reach = max(math.sqrt(72 * guess), math.sqrt(collision_number**2 + 72) - collision_number)
    nv = 2 * math.ceil(reach / math.sqrt(guess) * 14)
    dv = 2 * reach / nv
    v = dv * (np.arange(nv) + 0.5) - reach
    operator = Inelastic(v, collision_number, restitution, "quintic")
    k = 2 * np.pi * np.fft.rfftfreq(nv, dv)
    k[-1] = 0.0
    derivative = np.fft.irfft(1j * k[:, None] * np.fft.rfft(np.eye(nv), axis=0), n=nv, axis=0)
    linear = derivative @ (np.diag(v) + derivative)
    f = np.exp(-(v**2) / (2 * guess)) / math.sqrt(2 * math.pi * guess)
    step = f
    while np.abs(step).max() > 1e-12 * f.max():
        residual = linear @ f + operator.rate(f[None])[0]
        # C is quadratic: [C(f + e) - C(f - e)]/2 is its exact derivative along e.
        jacobian = linear + (operator.rate(f + np.eye(nv)) - operator.rate(f - np.eye(nv))).T / 2
        # The equations sum to zero (mass); ∫f = 1 takes their place, added to each so that the matrix stays regular.
        step = np.linalg.solve(jacobian + dv, -residual + (1 - f.sum() * dv))
        f = f + step
    theta = float(v**2 @ f) * dv
    distance = float(f @ np.abs(v[:, None] - v[None, :]) @ f) * dv**2 + dv**2 / 6 * float(f @ f) * dv
    return theta, float(v**4 @ f) * dv / (3 * theta**2) - 1, distance


@pytest.mark.parametrize(("restitution", "number"), [(0.0, 0.3), (0.5, 10.0), (0.9, 100.0), (0.5, 1e-3)])
def test_states_of_operator_12_by_two_schemes(make_scene: MakeScene, restitution: float, number: float) -> None:
    """θ_h to 1e-9, a2 to 1e-8, the rate to the 1e-7 of cells: the linear theory's Fourier-Galerkin method, and pairs of cells."""
    state = homogeneous_state(make_scene(**inelastic(restitution, number)))
    theta, a2, distance = pairs_of_cells(restitution, number)
    assert state is not None
    assert state.temperature == pytest.approx(theta, rel=1e-9)
    assert state.kurtosis_excess == pytest.approx(a2, abs=1e-8)
    assert state.collision_rate == pytest.approx(number * distance, rel=1e-7)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9, 0.99, 0.99999])
@pytest.mark.parametrize("number", [1e-300, 1e-6, 5e-5, 1e-2, 1.0, 30.0, 1e4, 1e6, 1e12, 1e100])
def test_states_at_any_collision_number(make_scene: MakeScene, restitution: float, number: float) -> None:
    """What friction and noise give, 2γ(σ - θ), collisions take: S(1 - ε²)/4 ∬ff'|v - v'|³."""
    flow = InelasticFlow(restitution, number)
    w, f, dw = flow.homogeneous
    r = np.abs(w[:, None] - w)
    taken = number * (1 - restitution**2) / 4 * float(f @ r**3 @ f) * dw**2
    assert f.sum() * dw == pytest.approx(1.0, rel=1e-12)
    assert taken == pytest.approx(2 * (1 - flow.temperature), rel=1e-4, abs=1e-10)  # the kink of |r|³ costs sums O(dw⁴)
    assert f.min() > -1e-13 * f.max()


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.99])
def test_weak_collisions(restitution: float) -> None:
    """θ = 1 - cR* + 3c²R*²/2 + …, a2 = (1 - 2ε²)/6 cR* + …, c = (1 - ε²)/√π: moments of C on a Maxwellian. Both two-sided."""
    c = (1 - restitution**2) / math.sqrt(math.pi)

    def off(number: float) -> tuple[float, float]:
        theta, a2, _ = _inelastic(restitution, number)
        return theta - (1 - c * number), a2 - (1 - 2 * restitution**2) / 6 * c * number

    once, twice = off(1e-3 / c), off(2e-3 / c)
    for small, large in zip(once, twice, strict=True):
        assert large / small == pytest.approx(4.0, rel=0.01)
    assert once[0] / 1e-3**2 == pytest.approx(1.5, rel=0.1)  # Haff's part; the other is that f is no Maxwellian
