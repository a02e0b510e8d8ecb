"""The phase-space grid into a file."""

from __future__ import annotations

from kinetic_solver.dataset import recording
from kinetic_solver.initial import recorded
from kinetic_solver.methods.job import Job
from kinetic_solver.plan import make_plan
from kinetic_solver.solver import checkpoint, integrate
from kinetic_solver.solver.loop import March


def run(job: Job) -> list[str]:
    """Raises RunUnfinished after the step in which the run is told to stop, its state written beside the file."""
    plan = make_plan(job.scene, job.operator, job.initial)
    scene, notes = recorded(job.scene, plan.start), job.notes(plan.start)
    resumed = job.resumed(scene, checkpoint.TYPES, notes)
    if resumed.finished:
        return ["it has finished already"]
    times, state = plan.schedule.times, resumed.state
    after = None if state is None else float(times[state["frame"]])
    recorder = job.recorder(plan.output, plan.schedule, scene=scene, after=after, notes=notes)
    keeper = job.keeper(resumed, recorder)

    def after_step(march: March) -> None:
        keeper.look(march.now.time, lambda: checkpoint.snapshot(march))

    with recording(recorder):
        report = integrate(plan, recorder, job.progress, after_step, state)
    recorder.close(report=report.attributes())
    keeper.finish()
    rtol = job.scene.accuracy.rtol
    lines = [f"estimated error {report.error:.2g} of max f (accuracy.rtol = {rtol:g}); limited by {report.limited_by}"]
    return lines + ([f"missing: {report.missing}"] if report.missing else [])
