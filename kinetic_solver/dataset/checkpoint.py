"""Where a run goes on after it was stopped: its state beside its file, in one format for every method.

A checkpoint is an .npz file without pickles: `header`, a JSON text, and the arrays that the state refers to. The header names the
format, the version of this software, the method and the scene, and holds the SHA-256 sum of the rest. It is written to a
temporary name, synced and renamed, and the one before is kept beside it: there is always a whole one, and a damaged one is
noticed. Tests: tests/faults/test_checkpoint.py.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from kinetic_solver.dataset.files import open_run, scene_of
from kinetic_solver.dataset.provenance import version
from kinetic_solver.dataset.schema import FINISHED
from kinetic_solver.dataset.trees import pack, unpack
from kinetic_solver.errors import OutputFailed, SceneError
from kinetic_solver.scene import Scene

NOTES = ("law", "initial", "initial_sha256")
"""Attributes that say what a run is of beside its scene."""
FORMAT = 1
"""Of the file: to be raised whenever what is written changes its meaning."""


class _Damaged(Exception):
    """A file that is no whole checkpoint."""


class Checkpoint:
    """The checkpoints of the run of a scene by a method into the file `target`: the last, and the one before."""

    def __init__(
        self, target: Path, scene: Scene, method: str, types: Iterable[type] = (), notes: Mapping[str, str] | None = None
    ) -> None:
        """`types` are the dataclasses that states hold. `notes` say what the run is of beside its scene: a law, a start."""
        self.path = target.with_name(target.name + ".checkpoint")
        self.previous = target.with_name(target.name + ".checkpoint.previous")
        self.scratch = target.with_name(target.name + ".frames")
        """Where a method keeps what checkpoints speak of and are too small for."""
        self._target, self._scene, self._method, self._notes = target, scene, method, dict(notes or {})
        self._types = {kind.__name__: kind for kind in types}

    def save(self, time: float, state: Any) -> None:
        """Write the state, a tree (trees.py), which the run has at this time, together with what the target holds now.

        Raises OutputFailed where there is no room for it; the last one is kept.
        """
        arrays: list[np.ndarray] = []
        packed = json.dumps(pack(state, arrays))
        header = {
            "format": FORMAT,
            "version": version(),
            "method": self._method,
            "scene": self._scene.model_dump_json(exclude_none=True),
            "notes": self._notes,
            "time": time,
            "written": self._target.stat().st_size,
            "state": packed,
        }
        header["sum"] = _sum(header, arrays)
        part = self.path.with_name(self.path.name + ".part")
        try:
            with part.open("wb") as file:
                named = {f"array_{n}": array for n, array in enumerate(arrays)}
                np.savez(file, header=np.array(json.dumps(header)), **named)  # type: ignore[arg-type]
                file.flush()
                os.fsync(file.fileno())
            if self.path.exists():
                self.path.replace(self.previous)
            part.replace(self.path)
            sync_folder(self.path.parent)
        except OSError as error:
            raise OutputFailed(f"{self.path}: cannot be written ({error.strerror}); make room, and resume the run") from None
        finally:
            part.unlink(missing_ok=True)

    def load(self) -> Any | None:
        """The last whole state; None where there is no checkpoint.

        Raises SceneError where none is whole, and where one is another scene's, another method's or another version's, or ahead
        of the target.
        """
        there = [path for path in (self.path, self.previous) if path.exists()]
        if not there:
            return None
        for path in there:
            try:
                header, arrays = _read(path)
                self._check(path, header)
                return unpack(json.loads(header["state"]), arrays, self._types)
            except (_Damaged, KeyError, IndexError, TypeError, ValueError) as error:
                if isinstance(error, SceneError):
                    raise
        raise SceneError(f"{there[0]}: is not a readable checkpoint; remove it to start afresh")

    def _check(self, path: Path, header: Mapping[str, Any]) -> None:
        if header["method"] != self._method:
            raise SceneError(f"{path}: is of method {header['method']!r}; allowed: to overwrite the run, or another name")
        if header["version"] != version() or header["format"] != FORMAT:
            raise SceneError(
                f"{path}: was written by version {header['version']}, this is {version()}; allowed: to go on with that version, "
                "or to overwrite the run"
            )
        check_notes(path, header["notes"], self._notes)
        check_scene(path, Scene.model_validate_json(header["scene"]), self._scene)
        if not 0 <= header["time"] <= self._scene.run.end_time:
            raise _Damaged
        if self._target.stat().st_size < header["written"]:
            raise SceneError(f"{self._target}: has lost what was written before the checkpoint; allowed: to overwrite it")

    def remove(self) -> None:
        for path in (self.path, self.previous, self.scratch):
            path.unlink(missing_ok=True)


def _read(path: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    """(header, arrays). Raises _Damaged where the file is not as it was written."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            arrays = [file[f"array_{n}"] for n in range(len(file.files) - 1)]
        if header.pop("sum") != _sum(header, arrays):
            raise _Damaged
    except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, BadZipFile):
        raise _Damaged from None
    return header, arrays


def _sum(header: Mapping[str, Any], arrays: Iterable[np.ndarray]) -> str:
    """SHA-256 of all that a checkpoint holds: what the arrays are, too."""
    found = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for array in arrays:
        found.update(f"{array.dtype.str}{array.shape}".encode())
        found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()


def sync_folder(folder: Path) -> None:
    """A name given in the folder is on disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_scene(path: Path, theirs: Scene, ours: Scene) -> None:
    """Raises SceneError with the keys in which the scene at `path` differs from a run's."""
    there, here = (_flat(scene.model_dump()) for scene in (theirs, ours))
    names = [name for name in sorted(there.keys() | here.keys()) if there.get(name) != here.get(name)]
    if names:
        raise SceneError(f"{path}: is of another scene ({', '.join(names)} differ); allowed: to overwrite it, or another name")


def check_notes(path: Path, theirs: Mapping[str, str], ours: Mapping[str, str]) -> None:
    """Raises SceneError where the run at `path` has another law or start beside its scene than this one."""
    for name in NOTES:
        if theirs.get(name) != ours.get(name):
            raise SceneError(
                f"{path}: is of {name} = {theirs.get(name, 'what the scene says')}, this run of "
                f"{ours.get(name, 'what the scene says')}; allowed: to overwrite it, or another name"
            )


def _flat(tables: dict[str, Any]) -> dict[str, Any]:
    """Dotted key → value."""
    flat: dict[str, Any] = {}
    for name, table in tables.items():
        flat |= {f"{name}.{key}": value for key, value in table.items()} if isinstance(table, dict) else {name: table}
    return flat


def finished(target: Path, scene: Scene, method: str, notes: Mapping[str, str] | None = None) -> bool:
    """Whether the run that writes `target` has come to its end. Raises SceneError where the file is not this run's."""
    if not target.exists():
        return False
    with open_run(target) as run:
        if run.attrs.get("method") != method:
            raise SceneError(f"{target}: is a run of method {run.attrs.get('method')!r}; allowed: another name")
        check_notes(target, run.attrs, notes or {})
        check_scene(target, scene_of(run, target), scene)
        return "status" in run and int(run["status"]) == FINISHED
