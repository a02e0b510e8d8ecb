"""A scene, with several values of some of its keys."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from kinetic_solver.compiling import announce_from_now_on, announcing
from kinetic_solver.dataset import one_writer, write_dataset
from kinetic_solver.errors import KineticError, SceneError
from kinetic_solver.scene import Scene, check_is_scene, shorten
from kinetic_solver.sweeps.combined import combined
from kinetic_solver.sweeps.points import Point, check_method, points, run_point

if TYPE_CHECKING:
    import xarray as xr

NAME = "sweep.nc"
"""Of the file, in the sweep's folder, that has all points; these are in the folder `points` beside it."""
MOST_POINTS = 1_000_000
"""Chosen: more are asked for by a slip of the pen."""
MOST_DEATHS = 3
"""Pools in a row that may break before any point of them is finished."""

Say = Callable[[str], None]


def sweep(
    scene: Scene,
    values: Mapping[str, Iterable[Any]],
    path: str | Path | None = None,
    method: str = "grid",
    executor: Executor | None = None,
    say: Say | None = None,
) -> xr.Dataset:
    """Run the scene for every combination of the values of these keys, as in {"collisions.cross_section": [0.5, 1.0, 2.0]}.

    Returns one dataset (docs/output.md) on one grid whose first dimensions are the keys, in their order. A point that failed is
    missing values, from where it stopped on, and says why in the variable `error`; `status` is 1 where a run has come to its end.

    `path` is a folder: every point is a file in it, whole or not there, which another sweep of the same points finds; the whole
    is `sweep.nc`. `executor` is any of concurrent.futures, or of a cluster that sees the folder; by default a pool of processes,
    which is made anew where one of them is killed. Each point runs on one thread. Particles get a seed that follows from the
    scene's and the keys. `say` is told of every point; where it is given, a pool that has loops to compile says so on stderr.

    Raises SceneError for keys and values that no point can have, KineticError where processes die again and again.
    Tests: tests/interface/test_sweep.py, tests/faults/test_sweep_workers.py.
    """
    check_is_scene(scene)
    check_method(method)
    listed = {key: _listed(key, given) for key, given in values.items()}
    if not listed:
        raise SceneError("sweep: there are no keys; allowed: one or more, each with its values")
    if scene.initial.file is not None:
        scene = scene.replace(**{"initial.file": str(Path(scene.initial.file).resolve())})
    if path is None:
        with tempfile.TemporaryDirectory(prefix="kinetic-solver-") as folder:
            return _run(scene, listed, Path(folder), method, executor, say)
    target = Path(path).resolve()
    if target.exists() and not target.is_dir():
        raise SceneError(f"{path}: is a file; allowed: the name of a folder")
    target.mkdir(parents=True, exist_ok=True)
    with one_writer(target / NAME):
        dataset = _run(scene, listed, target, method, executor, say)
        write_dataset(dataset, target / NAME, overwrite=True)
    return dataset


def _listed(key: str, given: Iterable[Any]) -> list[Any]:
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise SceneError(f"{shorten(key)} = {shorten(given)}: is one value; allowed: a list of them")
    found = [value.item() if hasattr(value, "item") and getattr(value, "ndim", 0) == 0 else value for value in given]
    if not found:
        raise SceneError(f"{shorten(key)}: has no values; allowed: one or more")
    if len({repr(value) for value in found}) < len(found):
        raise SceneError(f"{shorten(key)} = {shorten(found)}: has a value twice; allowed: each once")
    return found


def _run(
    scene: Scene, values: dict[str, list[Any]], folder: Path, method: str, executor: Executor | None, told: Say | None
) -> xr.Dataset:
    say = told or (lambda text: None)
    number = 1
    for listed in values.values():
        number *= len(listed)
    if number > MOST_POINTS:
        raise SceneError(f"sweep: {number} points; allowed: {MOST_POINTS}")
    (folder / "points").mkdir(exist_ok=True)
    all_points = list(points(scene, values, method, folder / "points"))
    refused = [point for point in all_points if point.scene is None]
    if len(refused) == number:
        raise SceneError(refused[0].refused.removeprefix("SceneError: "))
    left = [point for point in all_points if not point.done]
    if len(left) < number:
        say(f"{number - len(left)} of {number} points are there already, or have no scene")
    if left and executor is not None:
        with announcing() if told else nullcontext():  # where its points run in this process
            _ask(executor, left, say)
    elif left:
        _ask_pools(left, say, aloud=told is not None)
    return combined(scene, values, all_points)


def _ask(executor: Executor, left: list[Point], say: Say) -> None:
    with _nothing_to_import_again():
        asked = {executor.submit(run_point, point): point for point in left}
    try:
        for count, future in enumerate(concurrent.futures.as_completed(asked), 1):
            future.result()
            point = asked[future]
            say(f"{count} of {len(left)}: {point}" + (f": {point.error}" if point.error else ""))
    except BaseException:
        for future in asked:
            future.cancel()
        raise


@contextmanager
def _nothing_to_import_again() -> Iterator[None]:
    """Processes that are started here do not run the caller's script again, as spawned ones do to find functions of it: points
    need none. So a script may call a sweep at its top level."""
    own = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = own


def _ask_pools(left: list[Point], say: Say, aloud: bool) -> None:
    """Processes of this machine. One that is killed takes its pool with it: the points that are left go to another pool."""
    deaths = 0
    # Not forked: a forked process has the parent's locks, and libraries without their threads (tests/faults/test_pools.py).
    context = multiprocessing.get_context("spawn")
    announce = partial(announce_from_now_on, context.Semaphore()) if aloud else None
    while left:
        pool = ProcessPoolExecutor(min(len(left), _cores()), context, announce)
        try:
            _ask(pool, left, say)
        except BrokenExecutor:
            say("a process was killed; its point is run again")
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        before, left = len(left), [point for point in left if not point.done]
        deaths = deaths + 1 if len(left) == before else 0
        if deaths == MOST_DEATHS:
            raise KineticError(
                f"sweep: {MOST_DEATHS} times processes died before any point was finished, {left[0]} among {len(left)} left; "
                "allowed: points that fit into memory"
            )


def _cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
