"""Where momentum and energy come from: every term is its integral, and nothing is left over."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import hydrodynamics
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}


@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_rates_are_integrals_of_the_fields_and_add_up(make_scene: MakeScene, collisions: dict[str, Any]) -> None:
    scene = make_scene(
        model={"gravity": 6.3}, collisions=collisions, run={"end_time": 1.5, "output_every": 0.025}, accuracy={"rtol": 1e-7}
    )
    run = hydrodynamics.solve(scene)
    rho, u, theta = (run[name].values for name in ("density", "mean_velocity", "temperature"))
    force, heat = -1.7 * rho**2 * theta, -1.7 * u * rho**2 * theta
    if collisions is INELASTIC:
        force, heat = np.zeros_like(rho), -2.3 * (1 - 0.4**2) / np.sqrt(np.pi) * rho**2 * theta**1.5
    expected = {
        "momentum_rate_gravity": 6.3 * rho,
        "momentum_rate_friction": -0.7 * rho * u,
        "momentum_rate_collisions": force,
        "energy_rate_gravity": 6.3 * rho * u,
        "energy_rate_friction": -0.7 * rho * (u**2 + theta),
        "energy_rate_noise": 0.7 * 0.5 * rho,
        "energy_rate_collisions": heat,
    }
    time = run["time"].values
    for name, values in expected.items():
        rate = values.mean(axis=1) * 9.0
        assert np.allclose(run[name], rate, rtol=1e-9, atol=1e-12), name
        # Simpson's rule over the frames
        step = time[1]
        integral = step / 3 * (rate[0] + rate[-1] + 4 * rate[1:-1:2].sum() + 2 * rate[2:-1:2].sum())
        assert run[name.replace("rate", "from")].values[-1] == pytest.approx(integral, rel=1e-6, abs=1e-9), name
    for kind in ("momentum", "energy"):
        assert np.abs(run[f"{kind}_residual"]).max() < 1e-6 * np.abs(run[kind]).max()
    assert np.abs(run["mass_residual"]).max() < 1e-13


def test_residuals_fall_as_the_third_power_of_the_step(make_scene: MakeScene) -> None:
    residuals = []
    for step in (0.04, 0.02, 0.01):
        scene = make_scene(collisions=FOLLOW, grid={"nx": 33, "time_step": step}, accuracy={"rtol": 1e-2})
        residuals.append(abs(float(hydrodynamics.solve(scene)["energy_residual"][-1])))
    orders = np.log2(np.array(residuals[:-1]) / residuals[1:])
    assert ((orders > 2.6) & (orders < 3.5)).all(), (orders, residuals)


def test_shocks_heat_without_a_term_of_their_own(make_scene: MakeScene) -> None:
    """Energy is what is conserved: with jumps the residuals stay those of the steps."""
    scene = make_scene(
        collisions=FOLLOW,
        initial={"modes": [], "step": {"from": 0.2, "to": 0.6, "ratio": 3.0}},
        grid={"nx": 255},
        accuracy={"rtol": 0.05},
    )
    run = hydrodynamics.solve(scene)
    assert abs(float(run["energy_residual"][-1])) < 1e-5 * float(run["energy"][-1])


def test_m_moments_have_none(make_scene: MakeScene) -> None:
    run = hydrodynamics.solve(make_scene(collisions=FOLLOW, hydrodynamics={"moments": 5}))
    assert not [name for name in run if "residual" in str(name)]
