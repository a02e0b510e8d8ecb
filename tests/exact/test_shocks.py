"""Shocks of (6) on the line: they solve the equation, move, keep their shape, merge, and are mixtures of two Gaussians."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from kinetic_solver import exact
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
G, GAMMA, SIGMA, S = 1.3, 0.7, 0.5, 1.7
V = np.linspace(-9, 8, 341)
STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""First derivative of order 8."""


def speed(left: float, right: float) -> float:
    return (G - S * SIGMA * (left + right)) / GAMMA


def gaussian(density: float) -> np.ndarray:
    u = (G - S * density * SIGMA) / GAMMA
    return np.exp(-((V - u) ** 2) / (2 * SIGMA)) / np.sqrt(2 * np.pi * SIGMA)


@pytest.mark.parametrize(
    ("densities", "positions"), [([0.4, 0.9], [0.1]), ([0.3, 0.7, 1.2], [-0.4, 0.6]), ([0.2, 0.5, 0.6, 1.3], [0.0, 0.1, 0.3])]
)
def test_the_nonlinear_equation_is_satisfied(make_scene: MakeScene, densities: list[float], positions: list[float]) -> None:
    """∂f/∂t + v∂f/∂x + ∂[(g - γv)f]/∂v - σγ∂²f/∂v² - S f ρ(u - v), by differences of order 8."""
    h = 0.02
    offsets = h * np.arange(-4, 5)
    run = exact.shocks(make_scene(collisions=FOLLOW), densities, positions, 0.3 + offsets, -0.2 + offsets, V)
    f = run["f"].values
    dt, dx = STENCIL @ f[:, 4] / h, STENCIL @ f[4] / h
    dv = V[1] - V[0]
    here = f[4, 4]

    def derivative(values: np.ndarray) -> np.ndarray:
        return np.convolve(values, STENCIL[::-1], "same") / dv

    rho, u = float(run["density"][4, 4]), float(run["mean_velocity"][4, 4])
    inside = slice(30, -30)
    left = dt + V * dx + derivative((G - GAMMA * V) * here) - SIGMA * GAMMA * derivative(derivative(here))
    misfit = (left - S * here * rho * (u - V))[inside]
    assert np.abs(misfit).max() < 1e-8 * np.abs(V * dx).max()


def test_two_states_make_a_travelling_tanh(make_scene: MakeScene) -> None:
    """ρ_m + (Δρ/2) tanh(SΔρ ξ/2), ξ = x - x0 - ct: dense to the right, c = (ρ₁u₁ - ρ₂u₂)/(ρ₁ - ρ₂)."""
    x, t = np.linspace(-9, 9, 61), np.array([-2.0, 0.0, 3.5])
    run = exact.shocks(make_scene(collisions=FOLLOW), [0.4, 1.1], [0.8], t, x, V)
    c = run.attrs["shock_speeds"][0]
    u = [(G - S * rho * SIGMA) / GAMMA for rho in (0.4, 1.1)]
    assert c == pytest.approx((0.4 * u[0] - 1.1 * u[1]) / (0.4 - 1.1), rel=1e-13)
    profile = 0.75 + 0.35 * np.tanh(S * 0.7 * (x - 0.8 - c * t[:, None]) / 2)
    assert np.abs(run["density"].values - profile).max() < 1e-14


def test_moments_are_those_of_f(make_scene: MakeScene) -> None:
    run = exact.shocks(make_scene(collisions=FOLLOW), [0.3, 0.7, 1.2], [-0.4, 0.6], [0.2], np.linspace(-3, 3, 7), V)
    f, dv = run["f"].values[0], V[1] - V[0]
    rho, u = f.sum(axis=1) * dv, f @ V * dv / (f.sum(axis=1) * dv)
    w = V - u[:, None]
    assert np.allclose(run["density"][0], rho, rtol=1e-12)
    assert np.allclose(run["mean_velocity"][0], u, rtol=1e-12)
    assert np.allclose(run["temperature"][0], (f * w**2).sum(axis=1) * dv / rho, rtol=1e-12)
    assert np.allclose(run["heat_flux"][0], (f * w**3).sum(axis=1) * dv, atol=1e-13)


def test_at_every_place_f_is_the_mixture_of_the_two_homogeneous_states(make_scene: MakeScene) -> None:
    """The share of each from the density alone; in the middle there are two peaks only where S√σΔρ/γ is above 2."""
    for dense, peaks in ((1.1, 1), (2.6, 2)):
        run = exact.shocks(make_scene(collisions=FOLLOW), [0.4, dense], [0.0], [0.0], [-0.7, 0.0, 0.4], V)
        for place in range(3):
            rho = float(run["density"][0, place])
            share = (rho - 0.4) / (dense - 0.4)
            mixture = (1 - share) * 0.4 * gaussian(0.4) + share * dense * gaussian(dense)
            assert np.abs(run["f"].values[0, place] - mixture).max() < 1e-14
        # Where both have equally many particles
        equal = np.log(0.4 / dense) / (S * (dense - 0.4))
        middle = exact.shocks(make_scene(collisions=FOLLOW), [0.4, dense], [0.0], [0.0], [equal], V)["f"].values[0, 0]
        assert ((middle[1:-1] > middle[:-2]) & (middle[1:-1] > middle[2:])).sum() == peaks
        assert (S * np.sqrt(SIGMA) * (dense - 0.4) / GAMMA > 2) == (peaks == 2)


def test_shocks_catch_up_and_merge(make_scene: MakeScene) -> None:
    """The left one is the faster; after they meet a single shock between the outer states is left, with its own speed."""
    scene = make_scene(collisions=FOLLOW)
    slow, fast = speed(0.7, 1.6), speed(0.2, 0.7)
    assert fast > slow
    meet = 30.0 / (fast - slow)
    x = np.linspace(-120, 120, 9601)

    def front(t: float, level: float) -> float:
        rho = exact.shocks(scene, [0.2, 0.7, 1.6], [-15.0, 15.0], [t], x, V[:2])["density"].values[0]
        assert (np.diff(rho) > -1e-15).all()
        return float(np.interp(level, rho, x))

    assert front(0.0, 0.45) == pytest.approx(-15.0, abs=1e-3)
    assert front(0.0, 1.15) == pytest.approx(15.0, abs=1e-3)
    assert (front(0.5 * meet, 0.45) - front(0.0, 0.45)) / (0.5 * meet) == pytest.approx(fast, abs=1e-3)
    assert (front(0.5 * meet, 1.15) - front(0.0, 1.15)) / (0.5 * meet) == pytest.approx(slow, abs=1e-3)
    late = [front(t * meet, 0.9) for t in (2.0, 3.0)]
    assert (late[1] - late[0]) / meet == pytest.approx(speed(0.2, 1.6), abs=1e-3)
    assert front(3 * meet, 1.15) - front(3 * meet, 0.45) < 2.0


def test_many_collisions_do_not_overflow(make_scene: MakeScene) -> None:
    """R* = 5 and more, far from the front, where exp(SΦ) itself is beyond double precision."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 40.0})
    run = exact.shocks(scene, [0.3, 0.9], [0.0], [0.0, 100.0], [-1e4, 0.0, 1e4], np.linspace(-60, 10, 141))
    assert np.isfinite(run["f"]).all()
    assert run["density"].values[0].tolist() == pytest.approx([0.3, 0.6, 0.9], rel=1e-14)


def test_relaxation_from_a_step_ends_in_the_shock() -> None:
    """The closed form from a step of 2 in a long pipe, S = 2: 3.4e-8 of the tanh at t = 30, far from the fall."""
    scene = Scene.model_validate(
        {
            "collisions": {"operator": "follow-the-leader", "cross_section": 2.0},
            "pipe": {"length": 240.0},
            "initial": {"density": 1.0, "step": {"from": 0.5, "to": 1.0, "ratio": 2.0}},
            "run": {"end_time": 30.0},
        }
    )
    left, right = 2 / 3, 4 / 3
    # At rest in the frame of u_h for ρ̄ = 1: the front at 120 moves with c = -S(ρ₁ + ρ₂)
    front = 120.0 - 2.0 * (left + right) * 30.0
    x = front + np.linspace(-6, 6, 25)
    found = exact.Solution(scene, 30.0).moments(x)[0]

    def apart(shift: float) -> float:
        """From the shock whose front was displaced by so much while it formed."""
        shock = exact.shocks(scene, [left, right], [120.0 + shift], [30.0], x, [0.0])
        return float(np.abs(shock["density"].values[0] - found).max())

    assert minimize_scalar(apart, bounds=(-3, 3), method="bounded", options={"xatol": 1e-10}).fun < 1e-7


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, {"densities": [0.9, 0.4]}, "densities: 0.9 is followed by 0.4"),
        ({}, {"densities": [0.4, 0.4]}, "densities: 0.4 is followed by 0.4"),
        ({}, {"densities": [0.0, 0.4]}, "densities: the least is 0"),
        ({}, {"densities": [0.4]}, "densities: has shape"),
        ({}, {"positions": [0.0, 1.0]}, "positions: 2 given; allowed: 1"),
        ({}, {"densities": [0.1, 0.2, 0.3], "positions": [1.0, 0.0]}, "positions: 1 is followed by 0"),
        ({}, {"times": [np.nan]}, "times: has a number that is not finite"),
        ({}, {"v": [[0.0]]}, "v: has shape"),
        ({"collisions": {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5}}, {}, "'inelastic'"),
        ({"collisions": {"operator": "follow-the-leader", "cross_section": 0.0}}, {}, "no collisions"),
        ({"model": {"friction": 0.0}}, {}, "model.friction = 0"),
    ],
)
def test_refusals(make_scene: MakeScene, changes: dict[str, Any], arguments: dict[str, Any], message: str) -> None:
    given = {"densities": [0.4, 0.9], "positions": [0.0], "times": [0.0], "x": [0.0], "v": [0.0, 1.0], **arguments}
    with pytest.raises(SceneError, match=message) as error:
        exact.shocks(make_scene(**{"collisions": FOLLOW, **changes}), **given)
    assert "\n" not in str(error.value)
