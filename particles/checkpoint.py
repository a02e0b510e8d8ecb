"""Where a run of particles goes on after it was stopped: the state of a `Simulation` at a frame, beside the run's file.

A checkpoint is written through a temporary file: there is always a whole one. Writing takes at most a twentieth of a run's time.
Tests: tests/cross_validation/particles/test_checkpoint.py.
"""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from typing import Any
from zipfile import BadZipFile

import numpy as np

from kinetic_solver.dataset import FINISHED, open_run, scene_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

SHARE = 20
"""At least so many times as long as it took to write the last checkpoint lie between two."""


class Checkpoint:
    """The checkpoint of the run that writes `target`."""

    def __init__(self, target: Path, scene: Scene) -> None:
        self.path = target.with_name(target.name + ".checkpoint")
        self._target = target
        self._scene = scene
        self._took = 0.0
        self._last = monotonic()

    def save(self, state: dict[str, Any]) -> None:
        began = monotonic()
        part = self.path.with_name(self.path.name + ".part")
        try:
            with part.open("wb") as file:
                np.savez(file, scene=self._scene.model_dump_json(exclude_none=True), written=self._target.stat().st_size, **state)
            part.replace(self.path)
        finally:
            part.unlink(missing_ok=True)
        self._last = monotonic()
        self._took = self._last - began

    @property
    def due(self) -> bool:
        return monotonic() - self._last >= SHARE * self._took

    def load(self) -> dict[str, Any] | None:
        """None where there is none. Raises SceneError where it is another scene's, not readable, or ahead of the run's file."""
        if not self.path.exists():
            return None
        try:
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                state = dict(file)
            scene, written = Scene.model_validate_json(str(state.pop("scene"))), int(state.pop("written"))
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            raise SceneError(f"{self.path}: is not a readable checkpoint; remove it to start afresh") from None
        check_scene(self.path, scene, self._scene)
        if self._target.stat().st_size < written:
            raise SceneError(f"{self._target}: has lost what was written before the checkpoint; allowed: to overwrite it")
        return state

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)


def check_scene(path: Path, theirs: Scene, ours: Scene) -> None:
    """Raises SceneError with the keys in which the scene at `path` differs from a run's."""
    there, here = (_flat(scene.model_dump()) for scene in (theirs, ours))
    names = [name for name in sorted(there.keys() | here.keys()) if there.get(name) != here.get(name)]
    if names:
        raise SceneError(f"{path}: is of another scene ({', '.join(names)} differ); allowed: to overwrite it, or another name")


def _flat(tables: dict[str, Any]) -> dict[str, Any]:
    """Dotted key → value."""
    flat: dict[str, Any] = {}
    for name, table in tables.items():
        flat |= {f"{name}.{key}": value for key, value in table.items()} if isinstance(table, dict) else {name: table}
    return flat


def finished(target: Path, scene: Scene) -> bool:
    """Whether the run that writes `target` has come to its end. Raises SceneError where the file is not this run's."""
    if not target.exists():
        return False
    with open_run(target) as run:
        if run.attrs.get("method") != "particles":
            raise SceneError(f"{target}: is a run of method {run.attrs.get('method')!r}; allowed: another name")
        check_scene(target, scene_of(run, target), scene)
        return "status" in run and int(run["status"]) == FINISHED
