"""From a scene to a dataset: the one file that knows the recorders."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from kinetic_solver.dataset import VARIABLES, MemoryRecorder, Recorder, Variables, recording
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.plan import Plan, make_plan
from kinetic_solver.hydrodynamics.refinement import refined_run
from kinetic_solver.hydrodynamics.spectral import SpectralRun
from kinetic_solver.scene import Scene
from kinetic_solver.threads import one_blas_thread

if TYPE_CHECKING:
    import xarray as xr

Progress = Callable[[float, float], None]
"""Called as progress(time, end time)."""
Report = dict[str, Any]
"""Attributes of the dataset."""

_FIELDS = ("density", "mean_velocity", "temperature", "heat_flux")
_TOTALS = ("mass", "momentum", "energy")
_VARIABLES: Variables = {
    "moments": {name: VARIABLES["moments"][name] for name in _FIELDS},
    "scalars": {name: VARIABLES["scalars"][name] for name in _TOTALS},
    "budgets": VARIABLES["budgets"],
}


def variables(plan: Plan) -> Variables:
    """What a recorder of the plan's frames is to expect."""
    return {group: _VARIABLES[group] for group in plan.groups}


def solve(scene: Scene, progress: Progress | None = None) -> xr.Dataset:
    """The paper's hydrodynamic equations for `scene`: density, mean velocity, temperature and heat flux over (time, x), and
    totals.

    The closure (3)-(5), or with `hydrodynamics.moments` = M the Hermite hierarchy of M moments (docs/hydrodynamics.md). The
    closure is solved as conservation laws: mass to rounding, density and temperature positive, shocks captured, order 3 in time
    and 5 in x. What [grid] leaves open is refined until `accuracy.rtol` is met: in the maximum norm while the flow is smooth,
    in L1 once it has jumps; the attributes say which, and the errors estimated. Values are at the points x. Raises SceneError
    where the scene cannot be run, and SolverStopped where a run cannot go on. Tests: tests/hydrodynamics/."""
    plan = make_plan(scene)
    recorder = MemoryRecorder(plan.output, scene, plan.schedule, "hydrodynamics", variables(plan))
    with recording(recorder):
        report = integrate(plan, recorder, progress)
    recorder.close(report=report)
    return recorder.dataset().drop_dims("v")


def integrate(plan: Plan, recorder: Recorder, progress: Progress | None = None) -> Report:
    """Hand each frame to `recorder`; the closure's come when its last refinement is accepted."""
    end = plan.scene.run.end_time
    watch = None if progress is None else lambda time: progress(time, end)
    with one_blas_thread():
        frames, report = refined_run(plan, watch) if plan.moments is None else SpectralRun(plan, watch).frames()
        budgets = frames.budgets or [{}] * len(frames.fields)
        rows = zip(plan.schedule.times.tolist(), plan.schedule.due, frames.fields, frames.totals, budgets, strict=False)
        for time, due, field, total, budget in rows:
            values = {
                "moments": dict(zip(_FIELDS, field, strict=True)),
                "scalars": dict(zip(_TOTALS, total.tolist(), strict=True)),
                "budgets": budget,
            }
            if due:
                recorder.record(time, {group: values[group] for group in due})
    if frames.stopped is not None:
        raise SolverStopped(frames.stopped)
    return report
