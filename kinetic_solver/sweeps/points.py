"""One point of a sweep: its scene, its file, and the run from one to the other, in whatever process."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kinetic_solver.errors import OutputFailed, RunUnfinished, SceneError
from kinetic_solver.methods import METHODS, run_to_file
from kinetic_solver.scene import Scene
from kinetic_solver.threads import one_blas_thread, one_thread_of_loops

SEED = "particles.seed"


@dataclass(frozen=True)
class Point:
    """What is known of a point before and after its run. It can be sent to other processes and machines."""

    keys: tuple[tuple[str, Any], ...]
    """The keys in which it differs from the other points."""
    method: str
    folder: Path
    scene: str | None
    """As JSON; None where there is no such scene."""
    refused: str = ""
    """Why there is none."""

    @property
    def name(self) -> str:
        """Of its file, without an ending: from all that determines the run, whatever other points there are."""
        return hashlib.sha256(json.dumps([self.method, self.scene]).encode()).hexdigest()[:16]

    @property
    def file(self) -> Path:
        """Is there once the run has come to its end, and whole then."""
        return self.folder / f"{self.name}.nc"

    @property
    def record(self) -> Path:
        """Is there where the run failed: says why."""
        return self.folder / f"{self.name}.json"

    @property
    def done(self) -> bool:
        return self.scene is None or self.file.exists() or self.record.exists()

    @property
    def error(self) -> str:
        """Why the point has failed; "" where it has not."""
        if self.scene is None:
            return self.refused
        return str(json.loads(self.record.read_text(encoding="utf-8"))["error"]) if self.record.exists() else ""

    def __str__(self) -> str:
        return ", ".join(f"{key} = {value:.6g}" if isinstance(value, float) else f"{key} = {value}" for key, value in self.keys)


def points(scene: Scene, values: Mapping[str, Sequence[Any]], method: str, folder: Path) -> Iterator[Point]:
    """All combinations, the last key's values changing fastest."""
    for combination in itertools.product(*values.values()):
        keys = dict(zip(values, combination, strict=True))
        refused, text = "", None
        try:
            text = _scene(scene, keys, method).model_dump_json(by_alias=True, exclude_none=True)
        except SceneError as error:
            refused = f"SceneError: {error}"
        yield Point(tuple(keys.items()), method, folder, text, refused)


def _scene(scene: Scene, keys: Mapping[str, Any], method: str) -> Scene:
    """With a seed that follows from the scene's and the keys: points are independent, and each is the same in any sweep."""
    made = scene.replace(**keys)
    if method != "particles" or SEED in keys:
        return made
    told = json.dumps([scene.particles.seed, sorted(keys.items())]).encode()
    return made.replace(**{SEED: int.from_bytes(hashlib.sha256(told).digest()[:8]) >> 1})


def run_point(point: Point) -> None:
    """Runs it, on one thread, unless it is done; goes on where an earlier process was killed. A scene that cannot be run, and a
    run that stops, are results, and are recorded.

    Raises OutputFailed, or another OSError, where nothing can be written, and RunUnfinished where the process is to stop.
    """
    if point.done:
        return
    assert point.scene is not None
    running = point.folder / f"{point.name}.running.nc"
    failed = ""
    try:
        with one_blas_thread(with_scipy=False), one_thread_of_loops():
            run_to_file(Scene.model_validate_json(point.scene), running, point.method, resume=True)
    except (OutputFailed, OSError, RunUnfinished):
        raise
    except Exception as error:
        failed = f"{type(error).__name__}: {error}"
    if failed:
        part = point.record.with_suffix(".json.part")
        part.write_text(json.dumps({"error": failed, "keys": dict(point.keys)}, indent=1), encoding="utf-8")
        part.replace(point.record)
    if running.exists():
        running.replace(point.file)
    for left in point.folder.glob(f"{point.name}.running.nc.*"):
        left.unlink()


def check_method(method: str) -> None:
    """Raises SceneError for one that there is not."""
    if method not in METHODS:
        raise SceneError(f"method = {method!r}: unknown; allowed: {', '.join(map(repr, METHODS))}")
