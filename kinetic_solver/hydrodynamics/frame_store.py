"""Frames that may still be replaced by finer ones, kept outside the output: rows of numbers, one after another.

A pass is what a run has at one resolution, and its rows are of one length. They lie on a stream, which is a file beside the
output where a run is to go on after it was stopped, and memory where it is not.
Tests: tests/hydrodynamics/test_frame_store.py.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import OutputFailed, SceneError

BLOCK = 2**20
"""Bytes that are read at once where a sum is checked."""


class FrameStore:
    """Rows of float64, of several passes. What `state` says is on disk, and `restore` takes a store back to it."""

    def __init__(self, path: Path | None = None) -> None:
        """In the file `path`, made at the first row; in memory without one."""
        self._path = path
        self._stream: BinaryIO | None = None
        self._passes: list[tuple[int, int, int]] = []
        """(where it begins, numbers a row, rows) of each pass."""
        self._sum = hashlib.sha256()

    def begin(self, width: int) -> None:
        """A pass whose rows have this many numbers."""
        self._passes.append((self._length(), width, 0))

    def append(self, row: Array) -> None:
        """To the pass that was begun last. Raises OutputFailed where there is no room."""
        start, width, count = self._passes[-1]
        assert row.shape == (width,)
        data = np.ascontiguousarray(row).tobytes()
        stream = self._open("w+b")
        try:
            stream.seek(start + count * width * 8)
            left = memoryview(data)
            while left:
                left = left[stream.write(left) :]
        except OSError as error:
            raise OutputFailed(f"{self._path}: cannot be written ({error.strerror}); make room, and resume the run") from None
        self._sum.update(data)
        self._passes[-1] = (start, width, count + 1)

    def rows(self, place: int) -> int:
        """Of the pass of this number, from 0."""
        return self._passes[place][2]

    def row(self, place: int, number: int) -> Array:
        start, width, _ = self._passes[place]
        stream = self._open("r+b")
        stream.seek(start + number * width * 8)
        return np.frombuffer(stream.read(width * 8))

    def state(self) -> dict[str, Any]:
        """A tree that says what is kept. It is on disk by then."""
        if self._path is not None and self._stream is not None:
            os.fsync(self._stream.fileno())
        return {"passes": list(self._passes), "sum": self._sum.hexdigest()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """A new store of the same path holds what it held then; what was added later is dropped.

        Raises SceneError where the file has lost any of it."""
        self._passes = list(state["passes"])
        damaged = SceneError(f"{self._path}: has lost frames that the checkpoint speaks of; allowed: to overwrite the run")
        if (length := self._length()) == 0:
            return
        try:
            stream = self._open("r+b")
        except FileNotFoundError:
            raise damaged from None
        while (left := length - stream.tell()) > 0:
            data = stream.read(min(BLOCK, left))
            if not data:
                raise damaged
            self._sum.update(data)
        if self._sum.hexdigest() != state["sum"]:
            raise damaged
        stream.truncate()

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()

    def _length(self) -> int:
        start, width, count = self._passes[-1] if self._passes else (0, 0, 0)
        return start + 8 * width * count

    def _open(self, mode: str) -> BinaryIO:
        if self._stream is None:
            # Without a buffer, so that a write that fails fails here and not when the file is closed.
            self._stream = BytesIO() if self._path is None else open(self._path, mode, buffering=0)  # type: ignore[assignment]  # noqa: SIM115
        assert self._stream is not None
        return self._stream
