"""What a scene's units are changes nothing: not the plan, and not the answer.

Powers of two change no digit of a number, so plans and fields must agree to the last bit; powers of ten round, and may move a
count by one.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.random_kinds_scenes import in_units
from kinetic_solver import Scene, solve
from kinetic_solver.errors import SceneError
from kinetic_solver.plan import Plan, make_plan

BASE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 1.7},
    "pipe": {"length": 11.0},
    "run": {"end_time": 1.9, "output_every": 0.6},
    "accuracy": {"rtol": 1e-3},
}
COLLISIONS: dict[str, dict[str, Any]] = {
    "none": {},
    "(6)": {"collisions": {"operator": "follow-the-leader", "cross_section": 0.8}},
    "(12)": {"collisions": {"operator": "inelastic", "cross_section": 0.8, "restitution": 0.6}},
}
MODES = [{"mode": 1, "cos": 0.4, "sin": 0.0}, {"mode": 3, "cos": 0.0, "sin": 0.2}]
AT_REST = {"density": 1.2, "mean_velocity": 0.3, "temperature": 0.8}
BEAMS = [{"share": 0.4, "mean_velocity": -1.0, "temperature": 0.5}, {"share": 0.6, "mean_velocity": 1.1, "temperature": 0.3}]
STARTS: dict[str, dict[str, Any]] = {
    "homogeneous state": {"density": 1.2, "modes": MODES},
    "waves": {**AT_REST, "modes": MODES, "velocity_modes": [{"mode": 2, "cos": 0.3, "sin": 0.0}], "temperature_modes": MODES[:1]},
    "step": {**AT_REST, "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}},
    "vacuum": {**AT_REST, "step": {"from": 0.2, "to": 0.5, "ratio": 0.0}},
    "beams": {"density": 1.2, "modes": MODES, "beams": BEAMS},
    "pulse": {**AT_REST, "pulse": {"at": 0.3, "width": 0.05, "height": 2.0}},
    "nothing depends on x": AT_REST,
}
MODELS = [{}, {"noise": 0.0}, {"friction": 0.0}, {"friction": 1e-6, "noise": 1e6}, {"gravity": 0.0}]
units = st.tuples(*[st.sampled_from((-20, -7, 0, 3, 20))] * 3)
drawn = given(
    collisions=st.sampled_from(sorted(COLLISIONS)),
    start=st.sampled_from(sorted(STARTS)),
    model=st.sampled_from(MODELS),
    powers=units,
)


def tables(collisions: str, start: str, model: dict[str, float]) -> dict[str, Any]:
    initial = dict(STARTS[start])
    if model and "beams" not in initial:
        initial |= AT_REST
    return {**BASE, **COLLISIONS[collisions], "initial": initial, "model": {**BASE["model"], **model}}


def plan_of(table: dict[str, Any]) -> Plan | None:
    try:
        return make_plan(Scene.model_validate(table))
    except SceneError:
        return None


def counts(plan: Plan) -> tuple[int, ...]:
    return plan.grid.nx, plan.grid.nv, plan.output.nx, plan.output.nv, plan.expected_steps


def schemes(plan: Plan) -> tuple[object, ...]:
    return plan.stepping, plan.velocity, plan.drift_diffusion, plan.deposit, plan.reference_frame.moving, plan.waves.local_gauge


@drawn
@settings(max_examples=60)
def test_plans_in_units_of_powers_of_two_are_the_same(
    collisions: str, start: str, model: dict[str, float], powers: tuple[int, int, int]
) -> None:
    """Exactly: numbers of points and of steps, schemes, window and steps, what is refused."""
    length, time, number = (2.0**n for n in powers)
    table = tables(collisions, start, model)
    plan, other = plan_of(table), plan_of(in_units(table, length, time, number))
    assert (plan is None) == (other is None)
    if plan is None or other is None:
        return
    speed = length / time
    assert counts(plan) == counts(other)
    assert schemes(plan) == schemes(other)
    assert (plan.grid.low * speed, plan.grid.high * speed) == (other.grid.low, other.grid.high)
    assert (None if plan.time_step is None else plan.time_step * time) == other.time_step
    assert plan.shortest_step * time == other.shortest_step


@drawn
@settings(max_examples=40)
def test_plans_in_units_of_powers_of_ten_differ_by_a_point_at_most(
    collisions: str, start: str, model: dict[str, float], powers: tuple[int, int, int]
) -> None:
    length, time, number = (10.0 ** (3 * n / 10) for n in powers)  # up to 10^6
    table = tables(collisions, start, model)
    plan, other = plan_of(table), plan_of(in_units(table, length, time, number))
    assert (plan is None) == (other is None)
    if plan is None or other is None:
        return
    assert np.abs(np.subtract(counts(plan), counts(other))).max() <= 1
    assert schemes(plan) == schemes(other)


@pytest.mark.parametrize("collisions", sorted(COLLISIONS))
@pytest.mark.parametrize("start", ["waves", "nothing depends on x"])
def test_runs_in_units_of_powers_of_two_have_the_same_bits(collisions: str, start: str) -> None:
    """f, density, mean velocity and temperature at every frame, up to the power of two."""
    length, time, number = 2.0**20, 2.0**-9, 2.0**-20
    table = tables(collisions, start, {})
    speed = length / time
    run, other = (solve(Scene.model_validate(t)) for t in (table, in_units(table, length, time, number)))
    factors = {"f": number / (length * speed), "density": number / length, "mean_velocity": speed, "temperature": speed**2}
    for name, factor in factors.items():
        np.testing.assert_array_equal(run[name].values * factor, other[name].values, err_msg=name)


@pytest.mark.parametrize("collisions", sorted(COLLISIONS))
def test_runs_in_units_of_powers_of_ten_agree(collisions: str) -> None:
    """To a hundredth of rtol, whatever the digits of the units."""
    table = tables(collisions, "waves", {}) | {"output": {"nx": 65, "nv": 80, "velocity_window": (-4.0, 5.0)}}
    length, time, number = 1e6, 1e-4, 1e3
    speed = length / time
    scaled = in_units(table, length, time, number) | {
        "output": {"nx": 65, "nv": 80, "velocity_window": (-4.0 * speed, 5.0 * speed)}
    }
    run, other = (_quiet(solve, Scene.model_validate(t)) for t in (table, scaled))
    difference = np.abs(run["f"].values * (number / (length * speed)) - other["f"].values).max()
    assert difference < 1e-5 * float(other["f"].max())


def _quiet(run: Callable[[Scene], xr.Dataset], scene: Scene) -> xr.Dataset:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return run(scene)
