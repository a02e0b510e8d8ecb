"""The linearised step in Hermite functions against the closed form; errors of f are max|Δf|/max f."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.exact import Solution
from kinetic_solver.initial import start_state
from kinetic_solver.operators.linearised.hermite import HermiteLinearisedStep
from kinetic_solver.operators.velocity.hermite import HermiteBasis
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
# Nothing is one, no two are equal, and the start is neither the homogeneous state nor at the temperature σ
UNEQUAL = {
    "collisions": {"operator": "follow-the-leader", "cross_section": 1.9},
    "initial": {"mean_velocity": 0.9, "temperature": 0.25},
}


def start(scene: Scene, nx: int, count: int) -> tuple[HermiteLinearisedStep, Array]:
    """The step about the homogeneous mean velocity, and the scene's start."""
    model, rho = scene.model, scene.initial.density
    centre = (model.gravity - scene.cross_section * rho * model.noise) / model.friction
    basis = HermiteBasis(centre, model.noise, count)
    x = scene.pipe.length / nx * np.arange(nx)
    u0, theta0 = start_state(scene)
    a = basis.maxwellian(initial.density(scene, x), initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0))
    return HermiteLinearisedStep(scene.pipe.length, nx, basis, model, scene.cross_section, rho), a


def error(scene: Scene, step: HermiteLinearisedStep, a: Array, time: float) -> float:
    centre, width = step.basis.centre, np.sqrt(step.basis.variance)
    v = centre + width * np.linspace(-9, 9, 73)
    x = scene.pipe.length / a.shape[0] * np.arange(a.shape[0])
    truth = Solution(scene, time).distribution(x, v)
    return float(np.abs(a @ step.basis.values(v) - truth).max() / truth.max())


def mass_error(scene: Scene, a: Array) -> float:
    return float(abs(a[:, 0].mean() / scene.initial.density - 1))


@pytest.mark.parametrize(
    ("number", "nx", "count", "allowed"),
    [
        (0.3, 63, 48, 2e-14),
        (0.3, 64, 48, 2e-14),
        (2.0, 63, 48, 2e-12),
        (2.0, 64, 48, 2e-12),
        (5.0, 127, 64, 1e-7),
        (5.0, 255, 128, 1e-7),
    ],
)
def test_one_step(standing_scene: MakeScene, number: float, nx: int, count: int, allowed: float) -> None:
    """The first two are round-off; at R* = 5 W spans nine decades, which costs the nine digits that `round_off` says."""
    scene = standing_scene(number)
    step, a = start(scene, nx, count)
    a = step(a, 2.0)
    assert error(scene, step, a, 2.0) < allowed
    assert error(scene, step, a, 2.0) < 10 * step.round_off
    assert mass_error(scene, a) < 1e-14


@pytest.mark.parametrize(("number", "nx", "allowed"), [(0.3, 63, 2e-13), (2.0, 95, 2e-11), (5.0, 127, 5e-6)])
def test_many_steps(standing_scene: MakeScene, number: float, nx: int, allowed: float) -> None:
    """Going to F and back at each of 40 steps adds up round-off, and no more."""
    scene = standing_scene(number)
    step, a = start(scene, nx, 64)
    for _ in range(40):
        a = step(a, 0.05)
    assert error(scene, step, a, 2.0) < allowed
    assert error(scene, step, a, 2.0) < 100 * step.round_off
    assert mass_error(scene, a) < 1e-14


def test_unequal_parameters(make_scene: MakeScene) -> None:
    """At each time one step, unequal steps, and steps in F alone agree with the closed form; 96 functions for the cold start."""
    scene = make_scene(**UNEQUAL)
    step, first = start(scene, 81, 96)
    spectrum, a, time = step.lift(first), first, 0.0
    for h in (0.02, 0.4, 0.7, 1.5):
        time += h
        spectrum = step.propagate(spectrum, h)
        a = step(a, h)
        for result in (step(first, time), a, step.lower(spectrum)):
            assert error(scene, step, result, time) < 1e-12
            assert mass_error(scene, result) < 1e-14


def test_varying_start(make_scene: MakeScene) -> None:
    """Mean velocity and temperature that depend on x: f is not a product at the start."""
    scene = make_scene(
        collisions=UNEQUAL["collisions"],
        initial={"velocity_modes": [{"mode": 1, "sin": 0.3}], "temperature_modes": [{"mode": 2, "cos": 0.2}]},
    )
    step, a = start(scene, 81, 64)
    assert error(scene, step, step(a, 0.9), 0.9) < 1e-12


@pytest.mark.parametrize("cross_section", [0.0, 1e-9])
def test_without_collisions(make_scene: MakeScene, cross_section: float) -> None:
    """S = 0 is the plain linear step; it is a regular limit."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": cross_section})
    step, a = start(scene, 63, 48)
    for _ in range(3):
        a = step(a, 0.5)
    assert error(scene, step, a, 1.5) < 1e-13
    assert mass_error(scene, a) < 1e-14


def test_without_friction(make_scene: MakeScene) -> None:
    """γ = 0: streaming, gravity and collisions. Nothing damps the Hermite modes: the time that `count` resolves is limited."""
    scene = make_scene(
        model={"friction": 0.0}, initial={"mean_velocity": 0.2, "temperature": 0.5}, collisions=UNEQUAL["collisions"]
    )
    rho, length, nx = scene.initial.density, scene.pipe.length, 81
    basis = HermiteBasis(0.2, 0.5, 96)
    step = HermiteLinearisedStep(length, nx, basis, scene.model, scene.cross_section, rho)
    density = initial.density(scene, length / nx * np.arange(nx))
    a = step(basis.maxwellian(density, np.full(nx, 0.2), np.full(nx, 0.5)), 0.5)
    assert error(scene, step, a, 0.5) < 1e-10


@pytest.mark.parametrize("nx", [1, 2, 7])
def test_homogeneous_state_is_stationary(make_scene: MakeScene, nx: int) -> None:
    scene = make_scene(collisions=UNEQUAL["collisions"], initial={"modes": []})
    step, a = start(scene, nx, 12)
    assert step(a, 3.0) == pytest.approx(a, abs=1e-14)
    assert step.gauge_range < 1e-13


def test_density_defect_shows_too_few_points(standing_scene: MakeScene) -> None:
    """After a short step it is the order of the error of ρ in the emptiest place, and so no less than the error of f."""
    scene = standing_scene(2.0)
    for nx in (31, 47, 63):
        step, a = start(scene, nx, 48)
        a = step(a, 0.1)
        assert 1e-3 * step.density_defect < error(scene, step, a, 0.1) < step.density_defect


def test_lift_and_lower_are_inverse(standing_scene: MakeScene) -> None:
    """Also where the points do not resolve ρ, as 31 do not here."""
    step, a = start(standing_scene(2.0), 31, 48)
    a = step(a, 1.0)
    assert step.lower(step.lift(a)) == pytest.approx(a, abs=1e-11)


def test_too_large_a_gauge_is_an_error(standing_scene: MakeScene) -> None:
    step, a = start(standing_scene(12.0), 127, 64)
    with pytest.raises(LostAccuracy):
        step(a, 1.0)


@pytest.mark.parametrize("nx", [63, 64])
def test_moments_are_those_of_the_states(make_scene: MakeScene, nx: int) -> None:
    step, a = start(make_scene(**UNEQUAL), nx, 60)
    lifted = step.lift(a)
    times = [0.3, 1.7]
    found = step.moments(lifted, times, [0.0, 0.0])
    assert found is not None
    v = np.linspace(-16.0, 12.0, 400)
    for h, moments in zip(times, found, strict=True):
        f = step.lower(step.propagate(lifted, h)) @ step.basis.values(v)
        expected = (f @ (v[:, None] ** np.arange(4))).T * (v[1] - v[0])
        assert moments == pytest.approx(expected, abs=1e-11 * float(np.abs(expected).max()))
