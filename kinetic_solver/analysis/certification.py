"""A run held against itself with everything refined: error bars, and the orders at which errors fall."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.dataset import VARIABLES, MemoryRecorder
from kinetic_solver.errors import SceneError, SolverStopped
from kinetic_solver.plan import Plan, in_t, make_plan
from kinetic_solver.plan.in_x import fast_odd
from kinetic_solver.scene import Accuracy, Scene, Schedule
from kinetic_solver.solver import integrate

if TYPE_CHECKING:
    import xarray as xr

RATIO = 1.5
"""Factor on nx, nv and the number of steps from one refinement to the next."""
ENLARGEMENTS = 4
"""Times that a grid on which a run stops is enlarged by RATIO. Chosen."""
FIELDS = ("f", "density", "mean_velocity", "temperature")
"""Fields that get error bars."""
DIRECTIONS = ("x", "v", "t")
"""What is coarsened alone, to see the order of its error."""


def certify(scene: Scene, run: xr.Dataset, say: Callable[[str], None] = lambda text: None) -> xr.Dataset:
    """Error bars of `run`, the dataset of `solve(scene)`, as a Dataset to merge with it.

    Five more runs of the scene: with nx, nv and steps refined RATIO-fold once and twice, the window wider by a tenth of itself
    each time (for x, v, t and window together), and with each of x, v and t coarsened RATIO-fold alone. Grids stay fixed
    within these runs, so the steps of one do not hide in another's. The twice refined run is the truth.

    - `<field>_error`, of the field's shape: |run - truth| + |once refined run - truth|; the latter bounds the truth's own error.
    - `certified_error(field)`: the largest |run - truth| after time 0, relative as rtol is meant (docs/accuracy.md);
      `truth_error(field)`: the same of the once refined run. Where it is not well below, the truth is no better.
    - `observed_order(direction, field)`: log(error of the coarsened run/error of the first plan's own)/log(RATIO); NaN where
      coarsening leaves the error below 1.5 times what it was: another direction limits it, or (t of exact steps) nothing does;
      infinite where the coarsened run stops.

    Test: tests/convergence/test_certification.py.
    """
    import xarray as xr

    names = [name for name in FIELDS if name in run]
    if not names:
        raise SceneError("output: f and moments are both false; allowed: one of them at least")
    plan, fixed = _holding(make_plan(scene), say)
    truth = _solve(_refined(plan, 2), "everything refined twice", say)
    once = _solve(_refined(plan, 1), "everything refined once", say)
    coarser = {name: _try(_coarsened(plan, name), f"{name} coarsened", say) for name in DIRECTIONS}
    data: dict[str, Any] = {}
    for name in names:
        attrs = {"long_name": f"error bar of {run[name].attrs['long_name']}", "units": run[name].attrs["units"]}
        bars = np.abs(run[name].values - truth[name].values) + np.abs(once[name].values - truth[name].values)
        data[f"{name}_error"] = (run[name].dims, bars, attrs)

    def errors(other: xr.Dataset) -> list[float]:
        return [_error(other, truth, name) for name in names]

    certified, once_errors, base = errors(run), errors(once), np.array(errors(fixed))
    orders = np.full((len(DIRECTIONS), len(names)), np.nan)
    for row, other in zip(orders, coarser.values(), strict=True):
        found = np.array(errors(other)) if other is not None else np.full(len(names), np.inf)
        visible = found > RATIO * base
        with np.errstate(divide="ignore"):
            row[visible] = np.log(found[visible] / base[visible]) / math.log(RATIO)
    relative = {"units": "1"}
    data["certified_error"] = ("field", certified, {"long_name": "error against a twice refined run", **relative})
    data["truth_error"] = ("field", once_errors, {"long_name": "the same of a run refined once instead of twice", **relative})
    data["observed_order"] = (("direction", "field"), orders, {"long_name": "observed order of the error", **relative})
    result = xr.Dataset(data, {"field": names, "direction": list(DIRECTIONS)})
    result.attrs["certified_fields"] = " ".join(names)
    result.attrs["certified_directions"] = " ".join(DIRECTIONS)
    result.attrs["certified"] = _in_words(result, scene.accuracy.rtol)
    return result


def _solve(plan: Plan, what: str, say: Callable[[str], None]) -> xr.Dataset:
    g = plan.grid
    say(f"certifying: {what}, {g.nx} × {g.nv}")
    recorder = MemoryRecorder(plan.output, plan.scene, plan.schedule)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a coarse grid that is meant to be coarse
        integrate(plan, recorder)
    recorder.close()
    return recorder.dataset()


def _holding(plan: Plan, say: Callable[[str], None]) -> tuple[Plan, xr.Dataset]:
    """A plan whose grid holds the run to its end unchanged, and that run: runs enlarge the grid of their start if need be."""
    for _ in range(ENLARGEMENTS):
        try:
            return plan, _solve(_refined(plan, 0), "the grid of the run's start, fixed", say)
        except SolverStopped:
            g = plan.grid
            larger = dataclasses.replace(g, nx=_points(g.nx, RATIO), nv=math.ceil(RATIO * g.nv))
            plan = dataclasses.replace(plan, grid=larger)
    return plan, _solve(_refined(plan, 0), "a larger grid, fixed", say)


def _try(plan: Plan, what: str, say: Callable[[str], None]) -> xr.Dataset | None:
    try:
        return _solve(plan, what, say)
    except (SolverStopped, SceneError):
        return None


def _refined(plan: Plan, times: int) -> Plan:
    ratio, g = RATIO**times, plan.grid
    margin = 0.1 * times * (g.high - g.low) / 2
    nv = math.ceil(ratio * g.nv * (1 + 2 * margin / (g.high - g.low)))
    return _fixed(plan, _points(g.nx, ratio), nv, (g.low - margin, g.high + margin), ratio)


def _coarsened(plan: Plan, direction: str) -> Plan:
    g = plan.grid
    nx = _points(g.nx, 1 / RATIO) if direction == "x" else g.nx
    nv = max(8, round(g.nv / RATIO)) if direction == "v" else g.nv
    return _fixed(plan, nx, nv, (g.low, g.high), 1 / RATIO if direction == "t" else 1.0)


def _points(nx: int, ratio: float) -> int:
    return 1 if nx == 1 else fast_odd(round(ratio * nx))


def _fixed(plan: Plan, nx: int, nv: int, window: tuple[float, float], steps: float) -> Plan:
    """The plan on a grid that is given, with `steps` times as many steps; its output is the plan's."""
    grid = dataclasses.replace(plan.grid, nx=nx, nv=nv, low=window[0], high=window[1])
    given = plan.inner.grid.model_copy(update={"nx": nx, "nv": nv, "velocity_window": window})
    inner = plan.inner.model_copy(update={"grid": given})
    if plan.controlled:  # steps are found from their estimated error, of order 5, or 8 for (6)
        order = 8 if plan.symmetric else 5
        inner = inner.model_copy(update={"accuracy": Accuracy.model_construct(rtol=plan.inner.accuracy.rtol / steps**order)})
    elif plan.stepping != "exact" and plan.time_step is not None and inner.grid.time_step is not None:
        inner = inner.model_copy(update={"grid": given.model_copy(update={"time_step": plan.time_step / steps})})
    step = plan.time_step / steps if plan.time_step is not None and not plan.controlled else plan.time_step
    quiet = plan.scene.output.model_copy(update={"scalars": False, "budgets": False, "moment_equations": False})
    scene = plan.scene.model_copy(update={"output": quiet})
    shortest = in_t.shortest_exact_step(plan.scales, plan.waves, grid) if plan.shortest_step > 0 else 0.0
    schedule = Schedule.of(scene, VARIABLES)
    return dataclasses.replace(
        plan.with_inner(inner), scene=scene, schedule=schedule, grid=grid, time_step=step, shortest_step=shortest
    )


def _error(run: xr.Dataset, truth: xr.Dataset, name: str) -> float:
    """The largest difference after time 0, over what rtol refers to."""
    a, b = run[name].values[1:], truth[name].values[1:]
    scale = float(np.nanmax(np.abs(b)))
    if name == "mean_velocity":
        scale = max(scale, math.sqrt(float(np.nanmax(truth["temperature"].values[1:]))))
    return float(np.nanmax(np.abs(a - b))) / scale


def _in_words(result: xr.Dataset, rtol: float) -> str:
    worst, truth = float(result["certified_error"].max()), float(result["truth_error"].max())
    verdict = "within" if worst + truth <= rtol else "above"
    return f"error {worst:.2g} ± {truth:.2g}, {verdict} rtol = {rtol:g}"
