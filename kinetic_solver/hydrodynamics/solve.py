"""From a scene to a dataset: the one file that knows the recorders."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from kinetic_solver.dataset import MemoryRecorder, Recorder, recording
from kinetic_solver.hydrodynamics.frame_store import FrameStore
from kinetic_solver.hydrodynamics.plan import Plan, make_plan
from kinetic_solver.hydrodynamics.records import variables
from kinetic_solver.hydrodynamics.refinement import RefinedRun
from kinetic_solver.hydrodynamics.spectral import SpectralRun
from kinetic_solver.progress import Progress, telling
from kinetic_solver.scene import Scene
from kinetic_solver.threads import one_blas_thread

if TYPE_CHECKING:
    import xarray as xr

Run = RefinedRun | SpectralRun
AfterStep = Callable[[Run], None]
Report = dict[str, Any]
"""Attributes of the dataset."""


def solve(scene: Scene, progress: bool | Progress | None = None) -> xr.Dataset:
    """The paper's hydrodynamic equations for `scene`: density, mean velocity, temperature and heat flux over (time, x), and
    totals.

    The closure (3)-(5), or with `hydrodynamics.moments` = M the Hermite hierarchy of M moments (docs/hydrodynamics_details.md).
    The closure is solved as conservation laws: mass to rounding, density and temperature positive, shocks captured, order 3 in
    time and 5 in x. What [grid] leaves open is refined until `accuracy.rtol` is met: in the maximum norm while the flow is
    smooth, in L1 once it has jumps; the attributes say which, and the errors estimated. Values are at the points x. Raises
    SceneError where the scene cannot be run, and SolverStopped where a run cannot go on. `progress` as of
    `kinetic_solver.solve`. Tests: tests/hydrodynamics/."""
    with telling(progress) as told:
        plan = make_plan(scene)
        recorder = MemoryRecorder(plan.output, scene, plan.schedule, "hydrodynamics", variables(plan))
        with recording(recorder):
            report = integrate(plan, recorder, told)
    recorder.close(report=report)
    return recorder.dataset().drop_dims("v")


def integrate(
    plan: Plan,
    recorder: Recorder,
    progress: Progress | None = None,
    after_step: AfterStep = lambda run: None,
    state: Any | None = None,
    store: FrameStore | None = None,
) -> Report:
    """Hand each frame to `recorder`, or from `state` on those that follow; the closure's, but for the start, when its last
    refinement is accepted. Until then they are in `store`, by default in memory.

    `after_step` is called after every step and every frame but the last, and may raise: `run.snapshot()` is a state to go on
    from.
    Raises SolverStopped where the run cannot go on, its frames recorded.
    """
    run = SpectralRun(plan) if plan.moments is not None else RefinedRun(plan, store or FrameStore())
    if state is not None:
        run.restore(state)
    end = plan.scene.run.end_time

    def after(run: Run) -> None:
        # Where a pass may follow its end is not the run's.
        if progress is not None and 0 < run.time < end:
            progress(run.time, end)
        after_step(run)

    with one_blas_thread():
        for number, values in run.frames(after):
            recorder.record(float(plan.schedule.times[number]), {group: values[group] for group in plan.schedule.due[number]})
    if progress is not None:
        progress(end, end)
    return run.report()
