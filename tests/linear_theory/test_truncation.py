"""The nonlinear truncation with M moments: conservation, the Maxwellian limit, and on which side of ρ_c it grows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import exact
from kinetic_solver.analysis.measured_rates import measured_rates
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability import closure_rates, critical_density, kinetic_rates, truncated_run

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}


def at(make_scene: MakeScene, factor: float, mode: int) -> Scene:
    """A wave of 1e-6 in one mode, at `factor` times that mode's critical density of three moments."""
    rho_c = critical_density(make_scene(collisions=FOLLOW), mode)
    start = {"density": factor * rho_c, "modes": [{"mode": mode, "cos": 1e-6}]}
    return make_scene(collisions=FOLLOW, initial=start, run={"end_time": 30.0, "output_every": 0.1})


@pytest.mark.parametrize("mode", [1, 2, 4])
@pytest.mark.parametrize(("factor", "sign"), [(0.9, -1), (1.1, 1)])
def test_three_moments_change_sign_at_the_critical_density(make_scene: MakeScene, mode: int, factor: float, sign: int) -> None:
    """Measured in the run, predicted by the cubic; the kinetic equation decays on both sides."""
    scene = at(make_scene, factor, mode)
    measured = measured_rates(truncated_run(scene, nx=32), mode)
    growth = float(measured["growth_rate"][0])
    assert np.sign(growth) == sign == np.sign(closure_rates(scene, mode)[0].real)
    assert abs(growth - closure_rates(scene, mode)[0].real) <= float(measured["uncertainty"][0]) < 0.01 * abs(growth)
    assert kinetic_rates(scene, mode)[0][0].real < 0


def test_more_moments_are_stable_where_three_are_not(make_scene: MakeScene) -> None:
    scene = at(make_scene, 1.1, 2)
    assert critical_density(scene, 2, 6) > scene.initial.density
    run = truncated_run(scene, moments=6, nx=32)
    late = np.abs(run["density"].values[-1] / scene.initial.density - 1).max()
    assert late < 1e-7


def test_many_moments_become_the_kinetic_equation(make_scene: MakeScene) -> None:
    """A large wave at R* = 0.6: the nonlinear truncation converges to the closed form."""
    scene = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 0.74},
        initial={"mean_velocity": 0.9, "temperature": 0.4, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
    )
    solution = exact.Solution(scene, 1.5)
    errors = []
    for moments in (8, 16, 32):
        run = truncated_run(scene, moments)
        truth = solution.moments(run["x"].values)[0]
        errors.append(float(np.abs(run["density"].values[-1] - truth).max() / truth.max()))
        assert np.abs(run["density"].mean("x") / scene.initial.density - 1).max() < 1e-13
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[2] < 1e-6


@pytest.mark.parametrize(
    ("changes", "moments", "message"),
    [
        ({"collisions": {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5}}, 3, "follow-the-leader"),
        ({"collisions": FOLLOW}, 2, "moments = 2: allowed: 3 or more"),
        ({"collisions": FOLLOW, "model": {"noise": 0.0}}, 3, r"model.noise = 0"),
        ({"collisions": FOLLOW, "initial": {"modes": [], "step": {"from": 0.2, "to": 0.5, "ratio": 2.0}}}, 3, "initial.step"),
        ({"initial": {"modes": [], "pulse": {"at": 0.2, "width": 0.1, "height": 2.0}}}, 3, "initial.pulse"),
        ({"initial": {"beams": [{"share": 1.0, "mean_velocity": 0.3, "temperature": 0.4}]}}, 3, "initial.beams"),
    ],
)
def test_refusals(make_scene: MakeScene, changes: dict[str, Any], moments: int, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        truncated_run(make_scene(**changes), moments)
