"""rtol delivers: everything chosen from it (rules.py, docs/rules.md), the result held against exact or refined solutions.

The wide sweep behind the rules' constants is benchmarks/accuracy_rules.py; here are its corners.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from kinetic_solver import Scene, SceneError, exact, solve
from kinetic_solver.plan import choices, in_t, in_v, make_plan
from kinetic_solver.plan.criterion import strictest
from kinetic_solver.plan.in_x import fast_odd
from kinetic_solver.plan.measured import DEPOSIT_ERROR


def scene(operator: dict[str, Any], rtol: float, length: float, temperature: float | None, end: float) -> Scene:
    start: dict[str, Any] = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
    if temperature is not None:
        start["temperature"] = temperature
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
            "collisions": operator,
            "pipe": {"length": length},
            "initial": start,
            "run": {"end_time": end},
            "accuracy": {"rtol": rtol},
            "output": {"budgets": False},
        }
    )


def follow(number: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": number}


def inelastic(number: float, restitution: float) -> dict[str, Any]:
    return {"operator": "inelastic", "cross_section": number, "restitution": restitution}


def relative_errors(run: Any, truth: Any) -> dict[str, float]:
    """max|Δf|/max f; density and temperature likewise; mean velocity over max(|u|, √θ)."""
    top = {name: float(abs(truth[name]).max()) for name in ("f", "density", "temperature")}
    top["mean_velocity"] = max(float(abs(truth["mean_velocity"]).max()), math.sqrt(top["temperature"]))
    return {name: float(abs(run[name] - truth[name]).max()) / scale for name, scale in top.items()}


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
@pytest.mark.parametrize(
    ("number", "length", "temperature", "end"),
    [
        (0.3, 8 * math.pi, None, 2.0),
        (1.0, 3.0, 0.2, 0.5),
        (2.0, 8 * math.pi, None, 10.0),
        (2.0, 60.0, 3.0, 1.0),
        (3.0, 8 * math.pi, None, 2.0),
        (5.0, 3.0, 0.2, 0.5),
    ],
)
def test_operator_6_against_the_closed_form(
    number: float, length: float, temperature: float | None, end: float, rtol: float
) -> None:
    subject = scene(follow(number), rtol, length, temperature, end)
    run = solve(subject)
    errors = relative_errors(run, exact.solve(subject, x=run["x"], v=run["v"]))
    assert max(errors.values()) <= rtol, errors


def test_operator_6_at_a_fine_tolerance() -> None:
    subject = scene(follow(1.0), 1e-6, 8 * math.pi, None, 1.0)
    run = solve(subject)
    errors = relative_errors(run, exact.solve(subject, x=run["x"], v=run["v"]))
    assert max(errors.values()) <= 1e-6, errors


@pytest.mark.parametrize(
    ("restitution", "number", "rtol", "length", "temperature", "end"),
    [
        (0.0, 2.0, 1e-2, 8 * math.pi, None, 2.0),
        (0.5, 2.0, 1e-3, 8 * math.pi, None, 0.2),
        (0.9, 0.5, 1e-3, 3.0, 0.2, 0.5),
        (0.0, 0.5, 1e-4, 3.0, 0.2, 0.1),
    ],
)
@pytest.mark.filterwarnings("ignore:.*velocity(_| )window")  # of the reference: the run's own window, at a tenth of its rtol
def test_operator_12_against_a_refined_run(
    restitution: float, number: float, rtol: float, length: float, temperature: float | None, end: float
) -> None:
    """Refined: three times the points in x and v, which the run's points are among, a tenth of rtol, a higher deposit."""
    subject = scene(inelastic(number, restitution), rtol, length, temperature, end)
    plan = make_plan(subject)
    finer = {"nx": 3 * plan.grid.nx, "nv": 3 * plan.grid.nv, "velocity_window": (plan.grid.low, plan.grid.high)}
    finer |= {"deposit": "cubic" if rtol >= 1e-3 else "quintic"}
    reference = solve(
        Scene.model_validate({**subject.model_dump(exclude_none=True), "grid": finer, "accuracy": {"rtol": rtol / 10}})
    )
    truth = reference.isel(x=slice(None, None, 3), v=slice(1, None, 3)).assign_coords(x=plan.grid.x, v=plan.grid.v)
    shown = subject.replace(**{"output.nx": plan.grid.nx, "output.nv": plan.grid.nv})
    errors = relative_errors(solve(shown).isel(time=-1), truth.isel(time=-1))
    assert max(errors.values()) <= rtol, errors


def test_tighter_tolerances_choose_finer_grids() -> None:
    plans = [make_plan(scene(follow(1.0), rtol, 8 * math.pi, None, 1.0)) for rtol in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)]
    for coarse, fine in itertools.pairwise(plans):
        assert fine.grid.nv > coarse.grid.nv
        assert fine.grid.nx >= coarse.grid.nx
        assert fine.grid.low < coarse.grid.low


def test_every_choice_gives_its_reason() -> None:
    plan = make_plan(scene(inelastic(1.0, 0.5), 1e-4, 8 * math.pi, None, 1.0))
    assert set(plan.reasons) == {"velocity_window", "deposit", "time_step", "nv", "nx", "stepping"}
    assert plan.deposit == "quintic"
    assert set(DEPOSIT_ERROR) == {"linear", "cubic", "quintic"}


@pytest.mark.parametrize(("n", "expected"), [(1, 1), (2, 3), (4, 5), (11, 15), (63, 63), (64, 75), (106, 125)])
def test_fast_odd_sizes(n: int, expected: int) -> None:
    assert fast_odd(n) == expected


def test_hermite_functions_are_not_chosen_where_there_are_too_few() -> None:
    """(12) at a strict tolerance, begun seven thermal velocities from the homogeneous state: refused only where asked for."""
    tables: dict[str, Any] = {
        "model": {"gravity": 2.6, "friction": 0.5, "noise": 0.6},
        "collisions": inelastic(0.3, 0.2),
        "pipe": {"length": 9.0},
        "initial": {"modes": [{"mode": 1, "cos": 0.4}], "mean_velocity": 0.0, "temperature": 0.75},
        "run": {"end_time": 0.5},
        "accuracy": {"rtol": 1e-7},
    }
    assert make_plan(Scene.model_validate(tables)).velocity == "points"
    with pytest.raises(SceneError, match="need more than 240 functions"):
        make_plan(Scene.model_validate({**tables, "grid": {"velocity": "hermite"}}))


@pytest.mark.parametrize(
    ("number", "length", "temperature"), [(0.3, 60.0, 0.7), (1.0, 3.0, 3.0), (2.2, 25.0, None), (3.0, 1.0, 3.0)]
)
def test_the_cheapest_exact_step_is_found(number: float, length: float, temperature: float | None) -> None:
    """Though not all are tried."""
    plan = make_plan(scene(follow(number), 1e-6, length, temperature, 3.0))
    scales, width = plan.scales, plan.grid.high - plan.grid.low
    farthest, costs = in_t.filling(scales, in_t.farthest_exact_step(scales)), {}
    for parts in choices.EXACT_STEP_PARTS:
        h = in_t.filling(scales, farthest / parts)
        points = width / strictest(in_v.spacings(scales, plan.waves, in_v.Schemes("exact", "kernel", None, h))).value
        costs[h] = parts * points * (choices.PRODUCT_COST + points)
    assert plan.time_step is not None
    assert costs[plan.time_step] == min(costs.values())
    assert in_v.coarsest(scales, plan.waves) >= width / points
