"""Running a scene into a file by any method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from kinetic_solver.dataset import one_writer, refuse_existing
from kinetic_solver.errors import SceneError
from kinetic_solver.initial import Given
from kinetic_solver.laws import CollisionLaw
from kinetic_solver.methods.interruption import Interruption
from kinetic_solver.methods.job import Job, Written
from kinetic_solver.progress import Progress, telling
from kinetic_solver.scene import Scene, check_is_scene


@dataclass(frozen=True)
class Method:
    """One way from a scene to a file."""

    run: Callable[[Job], list[str]]
    """Writes the file and returns `Written.lines`."""
    starts: bool = True
    """Whether it can start from an f(x, v) of the user's own."""


def run_to_file(
    scene: Scene,
    path: str | Path,
    method: str = "grid",
    overwrite: bool = False,
    resume: bool = False,
    max_walltime: float | None = None,
    progress: bool | Progress = False,
    operator: CollisionLaw | None = None,
    initial: Given | None = None,
    interruption: Interruption | None = None,
) -> Written:
    """Run the scene by a method (a key of `METHODS`) into a netCDF file of the common schema (docs/output.md).

    Each frame is on disk as soon as it exists, and others may read the file meanwhile. A run that fails or is interrupted leaves
    the frames so far, with the reason as the attribute `stopped`; a scene that is refused leaves no file. `resume` goes on from
    the checkpoint beside the file, and the file comes out with the bits of a run that was never stopped; without a checkpoint the
    run starts afresh, and a finished one is left as it is. A run stops with a checkpoint after the step in which its
    `max_walltime`, in seconds, is over, or somebody asks it to through `interruption`. `progress` is True for a bar (on a
    terminal) or a line every ten seconds, on stderr, or a callable of the time and the end time.

    `operator` is a collision law of one's own (docs/extending.md), which the file names. `initial` is a start of one's own,
    f(x, v) as a callable or a DataArray, instead of [initial] (docs/starts.md). To resume takes the same ones.

    Raises SceneError where the scene or an argument is wrong or another process writes the file, OutputExistsError where it
    exists and neither `overwrite` nor `resume` is said, SolverStopped where a run cannot go on, RunUnfinished where it was
    stopped.
    Tests: tests/interface/test_run_to_file.py, tests/faults/.
    """
    path = Path(path)
    _check(scene, path, method, overwrite, resume, max_walltime)
    scene.law_with(operator)
    if initial is not None and not METHODS[method].starts:
        able = ", ".join(repr(name) for name, known in METHODS.items() if known.starts)
        raise SceneError(f"initial: method {method!r} starts from what [initial] says; allowed: an f(x, v) with method {able}")
    asked = interruption if interruption is not None else Interruption()
    with one_writer(path), telling(progress) as told:
        job = Job(scene, path, method, overwrite, resume, max_walltime, told, operator, initial, asked)
        lines = METHODS[method].run(job)
    return Written(path, tuple(lines))


def _check(scene: Scene, path: Path, method: str, overwrite: bool, resume: bool, max_walltime: float | None) -> None:
    check_is_scene(scene)
    if method not in METHODS:
        raise SceneError(f"method = {method!r}: unknown; allowed: {', '.join(map(repr, METHODS))}")
    if max_walltime is not None and not max_walltime >= 0:
        raise SceneError(f"max_walltime = {max_walltime:g}: allowed: 0 or more seconds")
    if resume and overwrite:
        raise SceneError("resume, overwrite: both are given; allowed: one of them")
    if scene.initial.file is not None and Path(scene.initial.file).resolve() == path.resolve():
        raise SceneError(f"{path}: is the file that the run starts from; allowed: another name")
    refuse_existing(path, overwrite or resume)


def _grid(job: Job) -> list[str]:
    from kinetic_solver.methods.grid import run

    return run(job)


def _exact(job: Job) -> list[str]:
    from kinetic_solver.methods.exact import run

    return run(job)


def _hydrodynamics(job: Job) -> list[str]:
    from kinetic_solver.methods.hydrodynamics import run

    return run(job)


def _particles(job: Job) -> list[str]:
    from kinetic_solver.methods.particles import run

    return run(job)


METHODS = {
    "grid": Method(_grid),
    "exact": Method(_exact, starts=False),
    "hydrodynamics": Method(_hydrodynamics, starts=False),
    "particles": Method(_particles),
}
