"""Running a scene into a file by any method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kinetic_solver.dataset import recording, refuse_existing
from kinetic_solver.errors import SceneError
from kinetic_solver.methods.job import Job, Written
from kinetic_solver.methods.progress import Progress, telling
from kinetic_solver.scene import Scene, Schedule


@dataclass(frozen=True)
class Method:
    """One way from a scene to a file."""

    run: Callable[[Job], list[str]]
    """Writes the file and returns `Written.lines`."""
    resumes: bool = False
    """Whether it keeps checkpoints: `resume` and `max_walltime` are for those alone."""


def run_to_file(
    scene: Scene,
    path: str | Path,
    method: str = "grid",
    overwrite: bool = False,
    resume: bool = False,
    max_walltime: float | None = None,
    progress: bool | Progress = False,
) -> Written:
    """Run the scene by a method (a key of `METHODS`) into a netCDF file of the common schema (docs/output.md).

    Each frame is on disk as soon as it exists, and others may read the file meanwhile. A run that fails or is interrupted leaves
    the frames so far, with the reason as the attribute `stopped`; a scene that is refused leaves no file. `resume` goes on from
    the checkpoint beside the file: without one the run starts afresh, and a finished one is left as it is. After `max_walltime`
    seconds a run stops at its next frame with a checkpoint. `progress` is True for a bar (on a terminal) or a line every ten
    seconds, on stderr, or a callable of the time and the end time.

    Raises SceneError where the scene or an argument is wrong, OutputExistsError where the file exists and neither `overwrite` nor
    `resume` is said, SolverStopped where a run cannot go on, RunUnfinished where `max_walltime` is over.
    Tests: tests/interface/test_run_to_file.py.
    """
    path = Path(path)
    _check(scene, path, method, overwrite, resume, max_walltime)
    with telling(progress) as told:
        lines = METHODS[method].run(Job(scene, path, method, overwrite, resume, max_walltime, told))
    return Written(path, tuple(lines))


def _check(scene: Scene, path: Path, method: str, overwrite: bool, resume: bool, max_walltime: float | None) -> None:
    if method not in METHODS:
        raise SceneError(f"method = {method!r}: unknown; allowed: {', '.join(map(repr, METHODS))}")
    if (resume or max_walltime is not None) and not METHODS[method].resumes:
        able = ", ".join(repr(name) for name, known in METHODS.items() if known.resumes)
        asked = "resume" if resume else "max_walltime"
        raise SceneError(f"{asked}: method {method!r} keeps no checkpoints, and starts afresh; allowed: with method {able}")
    if max_walltime is not None and not max_walltime >= 0:
        raise SceneError(f"max_walltime = {max_walltime:g}: allowed: 0 or more seconds")
    if resume and overwrite:
        raise SceneError("resume, overwrite: both are given; allowed: one of them")
    if scene.initial.file is not None and Path(scene.initial.file).resolve() == path.resolve():
        raise SceneError(f"{path}: is the file that the run starts from; allowed: another name")
    refuse_existing(path, overwrite or resume)


def _grid(job: Job) -> list[str]:
    from kinetic_solver.plan import make_plan
    from kinetic_solver.solver import integrate

    plan = make_plan(job.scene)
    recorder = job.recorder(plan.output, plan.schedule)
    with recording(recorder):
        report = integrate(plan, recorder, job.progress)
    recorder.close(report=report.attributes())
    rtol = job.scene.accuracy.rtol
    lines = [f"estimated error {report.error:.2g} of max f (accuracy.rtol = {rtol:g}); limited by {report.limited_by}"]
    if report.error > rtol:
        lines.append("warning: the estimated error exceeds accuracy.rtol; certify the run, or lower accuracy.rtol")
    return lines + ([f"missing: {report.missing}"] if report.missing else [])


def _exact(job: Job) -> list[str]:
    from kinetic_solver import exact

    grid, schedule = exact.points(job.scene), Schedule.of(job.scene, exact.VARIABLES)
    recorder = job.recorder(grid, schedule, exact.VARIABLES)
    with recording(recorder):
        for time, frame in exact.frames(job.scene, grid, schedule):
            recorder.record(time, frame)
            if job.progress is not None and time > 0:
                job.progress(time, job.scene.run.end_time)
    recorder.close()
    return []


def _particles(job: Job) -> list[str]:
    from kinetic_solver.methods.particles import run

    return run(job)


METHODS = {"grid": Method(_grid), "exact": Method(_exact), "particles": Method(_particles, resumes=True)}
