"""The grid solver: equation (2) on phase space, from scene to Dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from kinetic_solver.dataset import MemoryRecorder, Recorder, law_attribute, recording
from kinetic_solver.initial import Given, notes_of, recorded
from kinetic_solver.laws import CollisionLaw
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.progress import Progress, telling
from kinetic_solver.scene import Scene
from kinetic_solver.solver import checkpoint
from kinetic_solver.solver.loop import AfterStep, March
from kinetic_solver.solver.report import Report
from kinetic_solver.threads import one_blas_thread

if TYPE_CHECKING:
    import xarray as xr


def solve(
    scene: Scene,
    progress: bool | Progress | None = None,
    operator: CollisionLaw | None = None,
    initial: Given | None = None,
) -> xr.Dataset:
    """Solve (2) for `scene` on the phase-space grid; return every frame as an xarray Dataset (docs/output.md).

    `operator` is a collision law of one's own (docs/extending.md) for a scene without [collisions]; the dataset's attribute `law`
    names it.

    Exact in time without collisions and with operator (6); with (12) of high order, under error control. Mass is conserved to
    round-off. `initial` is a start of one's own instead of [initial]: f(x, v) as a callable or a DataArray (docs/starts.md).
    `progress` is True for a bar (on a terminal, in a notebook) or a line every ten seconds, on stderr, or a callable of the time
    and the end time.

    Raises SceneError where the scene, or that start, cannot be run, and SolverStopped, with the frames so far as its `dataset`,
    where a run cannot go on.
    """
    with telling(progress) as told:
        plan = make_plan(scene, operator, initial)
        notes = {**law_attribute(operator), **notes_of(plan.start)}
        recorder = MemoryRecorder(plan.output, recorded(scene, plan.start), plan.schedule, notes=notes)
        with recording(recorder):
            report = integrate(plan, recorder, told)
    recorder.close(report=report.attributes())
    return recorder.dataset()


def integrate(
    plan: Plan,
    recorder: Recorder,
    progress: Progress | None = None,
    after_step: AfterStep | None = None,
    state: Mapping[str, Any] | None = None,
) -> Report:
    """Run the time loop and hand each frame to `recorder` as soon as it exists.

    With a `state` that `checkpoint.snapshot` took in `after_step` it goes on from there, with the bits of a run that was never
    stopped, and the recorder is handed the frames after `state["frame"]`.
    """
    with one_blas_thread(with_scipy=False):
        march = March(plan, recorder, progress, after_step)
        if state is not None:
            checkpoint.restore(march, state)
        return march.go()
