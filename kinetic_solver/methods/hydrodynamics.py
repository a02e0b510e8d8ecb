"""The paper's hydrodynamic equations into a file."""

from __future__ import annotations

from kinetic_solver import hydrodynamics
from kinetic_solver.dataset import recording
from kinetic_solver.errors import SceneError, SolverStopped
from kinetic_solver.hydrodynamics import FrameStore, Run
from kinetic_solver.methods.job import Job


def run(job: Job) -> list[str]:
    """Raises RunUnfinished after the step in which the run is told to stop, its state written beside the file."""
    if job.operator is not None:
        raise SceneError(f"operator {job.operator.label}: has no closure; allowed with method 'hydrodynamics': the scene's own")
    plan = hydrodynamics.make_plan(job.scene)
    resumed = job.resumed(job.scene)
    if resumed.finished:
        return ["it has finished already"]
    state = resumed.state
    after = None if state is None else float(plan.schedule.times[state["recorded"] - 1])
    recorder = job.recorder(plan.output, plan.schedule, hydrodynamics.variables(plan), after=after)
    keeper = job.keeper(resumed, recorder)
    store = FrameStore(resumed.checkpoint.scratch)

    def after_step(run: Run) -> None:
        keeper.look(run.time, run.snapshot)

    try:
        with recording(recorder):
            report = hydrodynamics.integrate(plan, recorder, job.progress, after_step, state, store)
        recorder.close(report=report)
    except SolverStopped:
        keeper.finish()  # no run goes on from there
        raise
    finally:
        store.close()
    keeper.finish()
    rtol = job.scene.accuracy.rtol
    said = [f"{value:.2g}" if isinstance(value, float) else f"{value}" for value in report.values()]
    return [
        *(f"{name.replace('_', ' ')}: {value}" for name, value in zip(report, said, strict=True)),
        f"accuracy.rtol = {rtol:g}",
    ]
