"""The closure (3)-(5) from start to end: orders in x and t against a spectral twin, well-balanced, frames, stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.closure import ClosurePass, Frame, conserved, primitive
from kinetic_solver.hydrodynamics.gas import Gas, collide, fastest
from kinetic_solver.hydrodynamics.lawson import ClosureSteps
from kinetic_solver.scene import Scene
from kinetic_solver.stability.closure import closure_temperature

MakeScene = Callable[..., Scene]
Twin = Callable[[Scene, int], Array]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}
START = {
    "mean_velocity": 0.6,
    "temperature": 0.9,
    "modes": [{"mode": 1, "cos": 0.2}, {"mode": 2, "sin": 0.1}],
    "velocity_modes": [{"mode": 1, "sin": 0.1}],
    "temperature_modes": [{"mode": 2, "cos": 0.15}],
}
LONG = math.inf


def smooth(make_scene: MakeScene, collisions: dict[str, Any]) -> Scene:
    return make_scene(collisions=collisions, initial=START, run={"end_time": 0.8})


def ends(scene: Scene, nx: int, longest: float = LONG) -> tuple[Frame, Frame]:
    """(the start, the end)."""
    one = ClosurePass(scene, nx, longest)
    start = one.frame(0.0)
    one.advance(0.0, scene.run.end_time)
    return start, one.frame(scene.run.end_time)


def end(scene: Scene, nx: int, longest: float = LONG) -> Array:
    return ends(scene, nx, longest)[1].fields


def orders(errors: list[float]) -> Array:
    return np.log2(np.array(errors[:-1]) / errors[1:])


@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_order_five_in_x(make_scene: MakeScene, primitive_twin: Twin, collisions: dict[str, Any]) -> None:
    """Steps so short that their error does not show."""
    scene = smooth(make_scene, collisions)
    truth = primitive_twin(scene, 405)
    errors = [float(np.abs(end(scene, nx, 5e-4) - truth[:, :: 405 // nx]).max()) for nx in (135, 405)]
    print(errors)
    assert 4.6 < math.log(errors[0] / errors[1], 3) < 5.4, errors


@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_order_three_in_time(make_scene: MakeScene, collisions: dict[str, Any]) -> None:
    """On one grid, against much shorter steps."""
    scene = smooth(make_scene, collisions)
    truth = end(scene, 24, 0.05 / 32)
    errors = [float(np.abs(end(scene, 24, h) - truth).max()) for h in (0.05, 0.025, 0.0125)]
    assert ((orders(errors) > 2.6) & (orders(errors) < 3.5)).all(), errors


def test_agrees_with_the_equations_as_printed(make_scene: MakeScene, primitive_twin: Twin) -> None:
    """Both operators, on 189 points: (3)-(5) in other variables and another discretisation."""
    for collisions in (FOLLOW, INELASTIC):
        scene = smooth(make_scene, collisions)
        assert np.abs(end(scene, 189) - primitive_twin(scene, 189)).max() < 2e-6


def test_simple_waves_of_a_free_gas_are_burgers_waves(make_scene: MakeScene) -> None:
    """Uniform entropy θ/ρ²: u ± √(3θ) each obey Burgers' equation, solved by characteristics until shortly before the shock."""
    a, amplitude, t = 0.4, 0.2, 1.6
    errors = []
    for nx in (64, 128, 256):
        x = 2 * np.pi * np.arange(nx) / nx

        def riemann(y: Array, sign: int) -> Array:
            return 0.3 + 0.1 * np.cos(y) + sign * np.sqrt(3 * a) * (1 + amplitude * np.sin(y))

        rho = 1 + amplitude * np.sin(x)
        steps = ClosureSteps(Gas(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0), x[1], LONG)
        state = steps.advance(conserved(rho, 0.3 + 0.1 * np.cos(x), a * rho**2), 0.0, t)
        invariants = []
        for sign in (1, -1):
            y = x.copy()
            for _ in range(200):
                y = x - t * riemann(y, sign)
            invariants.append(riemann(y, sign))
        exact = (invariants[0] - invariants[1]) / (2 * np.sqrt(3 * a))
        errors.append(float(np.abs(state[0] - exact).max()))
    assert (orders(errors) > 2.5).all(), errors
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_the_homogeneous_state_stays_to_rounding(make_scene: MakeScene, collisions: dict[str, Any]) -> None:
    scene = make_scene(collisions=collisions, initial={"density": 1.9, "modes": []}, run={"end_time": 40.0})
    gamma, sigma, rate = 0.7, 0.5, collisions["cross_section"] * 1.9
    u, theta = (1.3 - rate * sigma) / gamma, sigma
    if collisions is INELASTIC:
        theta = closure_temperature(gamma, sigma, rate * (1 - 0.4**2) / math.sqrt(math.pi))
        u = 1.3 / gamma
    scene = scene.model_copy(update={"initial": scene.initial.model_copy(update={"mean_velocity": u, "temperature": theta})})
    for found, expected in zip(end(scene, 33), (1.9, u, theta), strict=True):
        assert np.abs(found / expected - 1).max() < 1e-13


def test_gravity_friction_and_noise_are_exact(make_scene: MakeScene) -> None:
    """In one step from the lab and from a moving frame, against DOP853 on u and θ; so strong that an explicit step would
    explode."""
    for gamma, time in ((0.7, 0.4), (300.0, 2.0), (0.0, 1.3)):
        gas = Gas(1.3, gamma, 0.5, 0.0, 0.0, 0.0, 0.0)
        state = conserved(np.array([0.8]), np.array([-0.4]), np.array([1.7]))
        rho, u, theta = primitive(gas.relax(state, time, 0.6))[:, 0]

        def rate(_: float, y: Array, gamma: float = gamma) -> list[float]:
            return [1.3 - gamma * (y[0] + 0.6), 2 * gamma * (0.5 - y[1])]

        expected = solve_ivp(rate, (0, time), [-0.4, 1.7], "Radau", rtol=1e-10, atol=1e-12).y[:, -1]
        assert rho == 0.8
        assert np.allclose([u, theta], expected, rtol=1e-7)


def test_strong_friction_does_not_shorten_steps(make_scene: MakeScene) -> None:
    """Friction that acts within a hundredth of the time in which a wave crosses a cell: to the terminal velocity, stably."""
    scene = make_scene(model={"friction": 700.0}, run={"end_time": 3.0}, initial={"mean_velocity": 5.0, "temperature": 4.0})
    steps = ClosureSteps(Gas.of(scene), 9.0 / 32, LONG)
    x = 9.0 / 32 * np.arange(32)
    state = steps.advance(conserved(0.8 + 0.3 * np.cos(2 * np.pi * x / 9), np.full(32, 5.0), np.full(32, 4.0)), 0.0, 3.0)
    assert steps.steps < 3.0 / (0.4 * 9.0 / 32 / 1.3)  # Courant numbers above 0.4 of the final speed
    assert np.abs(primitive(state)[2] / 0.5 - 1).max() < 0.02


def test_the_frame_of_reference_does_not_matter(make_scene: MakeScene) -> None:
    """A mean velocity of 40 thermal ones: as accurate, and as long steps, as at rest."""
    slow, fast = (
        make_scene(model={"gravity": g}, collisions=FOLLOW, initial={**START, "mean_velocity": u}, run={"end_time": 0.9})
        for g, u in ((0.0, 0.0), (0.7 * 30, 30.0))
    )
    nx = 135
    a, b = end(slow, nx), end(fast, nx)
    assert 30 * 0.9 / (9.0 / nx) == pytest.approx(405)
    assert np.abs(np.roll(a, 405 % nx, axis=1)[0] - b[0]).max() < 1e-9
    assert np.abs(np.roll(a, 405 % nx, axis=1)[1] + 30 - b[1]).max() < 1e-9


def test_collisions_use_up_no_more_than_the_temperature() -> None:
    """Twin of the rates, and the Euler step that `fastest` allows."""
    rng = np.random.default_rng(5)
    rho, u, theta = 0.1 + rng.random(40), rng.normal(0, 2, 40), rng.random(40) ** 4
    state = conserved(rho, u, theta)
    out = np.zeros_like(state)
    collide(state, 1.7, 0.4, 0.9, 0.2, out)
    assert np.allclose(out[1], -1.7 * rho**2 * theta + 0.4 * rho, rtol=1e-12, atol=1e-14)
    assert np.allclose(out[2], u * out[1] - 0.9 * rho**2 * theta**1.5 + 0.2 * rho, rtol=1e-12, atol=1e-13)
    assert (out[0] == 0).all()
    speed, rate = fastest(state, 1.7, 0.4, 0.9, 0.2)
    assert speed == pytest.approx((np.abs(u) + np.sqrt(3 * theta)).max(), rel=1e-12)
    assert (primitive(state + out / rate)[2] > -1e-12).all()
    assert (primitive(state + 0.9 * out / rate)[2] > 0).all()
    assert math.isnan(fastest(-state, 1.7, 0.4, 0.9, 0.2)[0])


def test_mass_is_conserved_and_momentum_without_forces(make_scene: MakeScene) -> None:
    free = {"model": {"gravity": 0.0, "friction": 0.0}, "initial": {**START, "mean_velocity": 0.6}, "run": {"end_time": 6.0}}
    for changes in (free, {"collisions": FOLLOW, "initial": START, "run": {"end_time": 6.0}}):
        scene = make_scene(**changes)
        before, after = (frame.totals for frame in ends(scene, 64))
        kept = slice(None) if changes is free else slice(1)
        assert np.abs(after[kept] / before[kept] - 1).max() < 1e-13
