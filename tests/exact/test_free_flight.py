"""The closed form where waves steepen and streams meet: by brute force over velocities, at early times by Taylor's series, in a
vacuum; what it refuses, and elastic collisions, which are none."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import exact
from kinetic_solver.compare import compare
from kinetic_solver.errors import SceneError
from kinetic_solver.exact import Solution
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]


def brute_force(scene: Scene, time: float, x: float, count: int = 1_000_001) -> tuple[float, float, float]:
    """ρ, u and θ of free flight with friction from f0(y, v0) at y = x - b v0, b = (1 - e^{-γt})/γ: sums over v0."""
    start, length, gamma = scene.initial, scene.pipe.length, scene.model.friction
    (of_rho,), theta0, u0 = start.modes, start.temperature, start.mean_velocity
    assert theta0 is not None
    assert u0 is not None
    b, e = (-math.expm1(-gamma * time) / gamma, math.exp(-gamma * time)) if gamma else (time, 1.0)
    half = abs(u0) + 1.5 + 13 * math.sqrt(2 * theta0)
    dv = 2 * half / (count - 1)
    v = dv * (np.arange(count) - (count - 1) // 2)
    k = 2 * math.pi / length

    def waves(modes: Any, y: np.ndarray) -> np.ndarray:
        return np.asarray(sum((m.cos * np.cos(k * m.mode * y) + m.sin * np.sin(k * m.mode * y) for m in modes), 0 * y))

    y = x - b * v
    theta, u = theta0 * (1 + waves(start.temperature_modes, y)), u0 + waves(start.velocity_modes, y)
    f = (1 + waves([of_rho], y)) * np.exp(-((v - u) ** 2) / (2 * theta)) / np.sqrt(2 * np.pi * theta)
    rho = f.sum() * dv
    mean = f @ v * dv / rho
    return float(start.density * rho), float(e * mean), float(e * e * (f @ (v - mean) ** 2) * dv / rho)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(
    ("more", "time"),
    [
        ({"temperature_modes": [{"mode": 3, "sin": -0.5}]}, 5.2),
        ({"temperature_modes": [{"mode": 3, "sin": 0.97}]}, 12.0),
        ({"temperature_modes": [{"mode": 1, "cos": 0.999}]}, 3.0),
        ({"velocity_modes": [{"mode": 1, "sin": 0.8}]}, 2.0),
        ({"velocity_modes": [{"mode": 2, "cos": -1.1}], "temperature_modes": [{"mode": 1, "sin": 0.6}]}, 9.0),
    ],
)
def test_steep_waves_by_brute_force(make_scene: MakeScene, friction: float, more: dict[str, Any], time: float) -> None:
    """The trapezoidal rule over a million velocities, which sees every fold."""
    start = {"density": 0.8, "modes": [{"mode": 2, "cos": 0.45}], "mean_velocity": -0.3, "temperature": 0.087, **more}
    scene = make_scene(model={"gravity": 0.0, "friction": friction, "noise": 0.0}, pipe={"length": 4.9}, initial=start)
    x = 4.9 * np.array([0.1, 0.4, 0.7])
    rho, u, theta, _ = Solution(scene, time).moments(x)
    for i in range(3):
        truth = brute_force(scene, time, float(x[i]))
        assert np.abs(np.subtract(truth, (rho[i], u[i], theta[i]))).max() < 1e-13 * max(1.0, rho.max())


def test_cold_streams_that_have_met(make_scene: MakeScene) -> None:
    """Collisions without noise after waves have overtaken one another: mass, and f summed over v."""
    start = {"mean_velocity": 0.1, "temperature": 4e-3, "velocity_modes": [{"mode": 1, "sin": 0.9}]}
    model, collisions = {"gravity": 0.4, "friction": 0.2, "noise": 0.0}, {"operator": "follow-the-leader", "cross_section": 2.3}
    scene = make_scene(model=model, collisions=collisions, initial=start)
    solution, x = Solution(scene, 5.0), 9.0 * np.arange(800) / 800
    rho, u, _, _ = solution.moments(x)
    assert rho.mean() == pytest.approx(0.8, rel=1e-13)
    v = np.linspace(-1.5, 2.2, 6001)
    f = solution.distribution(x[::100], v)
    assert f.sum(axis=1) * (v[1] - v[0]) == pytest.approx(rho[::100], rel=1e-12)
    assert f @ v * (v[1] - v[0]) == pytest.approx((rho * u)[::100], abs=1e-12)


@pytest.mark.parametrize("cross_section", [0.0, 0.6])
@pytest.mark.parametrize("time", [1e-5, 1e-7, 1e-9, 1e-12])
def test_early_times_by_taylors_series(make_scene: MakeScene, cross_section: float, time: float) -> None:
    """f0 + t ∂f/∂t of (2), to t²; and what the closed form adds to f0 is of order t, not of the rounding over t."""
    collisions = {"operator": "follow-the-leader", "cross_section": cross_section}
    model, u0, theta = {"gravity": 1.3, "friction": 0.7, "noise": 0.5}, 0.3, 0.36
    start = {"density": 0.8, "modes": [{"mode": 1, "cos": 0.4}], "mean_velocity": u0, "temperature": theta}
    scene = make_scene(model=model, collisions=collisions, initial=start)
    x, v = 9.0 * np.arange(7)[:, None] / 7, np.linspace(-3.0, 3.6, 61)
    k, c = 2 * math.pi / 9, v - u0
    rho, slope = 0.8 * (1 + 0.4 * np.cos(k * x)), -0.32 * k * np.sin(k * x)
    maxwellian = np.exp(-(c**2) / (2 * theta)) / math.sqrt(2 * math.pi * theta)
    f0 = rho * maxwellian
    drift = (0.7 + (1.3 - 0.7 * v) * c / theta) * f0
    rate = -v * slope * maxwellian + drift + 0.35 * (c**2 / theta**2 - 1 / theta) * f0 + cross_section * f0 * rho * (u0 - v)
    f = Solution(scene, time).distribution(x[:, 0], v)
    assert np.abs(f - f0 - time * rate).max() < (20 * time**2 + 3e-15) * f0.max()
    density = Solution(scene, time).moments(x[:, 0])[0]
    assert np.abs(density - (rho - time * u0 * slope)[:, 0]).max() < 20 * time**2 + 3e-15


@pytest.mark.parametrize("ratio", [0.0, 1e-300])
def test_a_vacuum(make_scene: MakeScene, ratio: float) -> None:
    """No warning; mean velocity and temperature do not exist where there is nothing."""
    step = {"modes": [], "step": {"from": 0.2, "to": 0.7, "ratio": ratio}, "mean_velocity": -0.4, "temperature": 0.07}
    for collisions in (None, {"operator": "follow-the-leader", "cross_section": 1.7}):
        scene = make_scene(collisions=collisions, initial=step, run={"end_time": 0.2})
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            run = exact.solve(scene)
        empty = run["density"].values == 0
        assert empty[0].any() == (ratio == 0)
        assert np.array_equal(np.isnan(run["mean_velocity"].values), empty)
        assert np.array_equal(np.isnan(run["temperature"].values), empty)
        for name in ("f", "density", "heat_flux", "mass", "momentum", "energy"):
            assert np.isfinite(run[name].values).all()
        assert run["mass"].values == pytest.approx(0.8 * 9, rel=1e-13)


def test_what_it_refuses(make_scene: MakeScene) -> None:
    still = make_scene(model={"gravity": 0.0, "friction": 0.0, "noise": 0.0})
    for end in (1e6, 1e30):
        with pytest.raises(SceneError, match=r"^run\.end_time: .* allowed: an earlier time$"):
            exact.solve(still.replace(**{"run.end_time": end}))
    with pytest.raises(SceneError, match=r"^run\.end_time: .* or model\.noise above 0$"):
        exact.solve(make_scene(model={"gravity": 1.0, "friction": 1.1, "noise": 0.0}, run={"end_time": 900.0}))


def test_elastic_collisions_are_none(make_scene: MakeScene) -> None:
    """(12) with ε = 1 is zero: nothing of the closed form sees its cross-section."""
    elastic = make_scene(collisions={"operator": "inelastic", "cross_section": 2.0, "restitution": 1.0})
    found, wanted = exact.solve(elastic), exact.solve(make_scene())
    for name in wanted.data_vars:
        np.testing.assert_array_equal(found[name], wanted[name])
    assert not compare(found, wanted).differ
    assert elastic.cross_section == elastic.groups.collision_number == 0
    with pytest.raises(SceneError, match="shocks are exact for 'follow-the-leader'"):
        exact.shocks(elastic, [0.5, 1.0], [0.0], [0.0], [0.0, 1.0], [0.0, 1.0])
