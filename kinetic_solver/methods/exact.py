"""The closed form into a file. Its frames are independent of one another: a checkpoint says how many there are."""

from __future__ import annotations

from kinetic_solver import exact
from kinetic_solver.dataset import recording
from kinetic_solver.errors import SceneError
from kinetic_solver.methods.job import Job
from kinetic_solver.scene import Schedule


def run(job: Job) -> list[str]:
    """Raises RunUnfinished after the frame in which the run is told to stop."""
    if job.operator is not None:
        raise SceneError(f"operator {job.operator.label}: has no closed form; allowed with method 'exact': the scene's own")
    grid, schedule = exact.points(job.scene), Schedule.of(job.scene, exact.VARIABLES)
    resumed = job.resumed(job.scene)
    if resumed.finished:
        return ["it has finished already"]
    done = 0 if resumed.state is None else int(resumed.state["frames"])
    after = float(schedule.times[done - 1]) if done else None
    recorder = job.recorder(grid, schedule, exact.VARIABLES, after=after)
    keeper = job.keeper(resumed, recorder)
    with recording(recorder):
        for count, (time, frame) in enumerate(exact.frames(job.scene, grid, schedule, done), done + 1):
            recorder.record(time, frame)
            if job.progress is not None and time > 0:
                job.progress(time, job.scene.run.end_time)
            if count < len(schedule.times):
                keeper.look(time, lambda: {"frames": count})  # noqa: B023 (it is called at once)
    recorder.close()
    keeper.finish()
    return []
