"""A recorder that writes netCDF files, which others may read meanwhile.

Files are netCDF classic 64-bit data (CDF-5): measured (benchmarks/live_file.py), it is the format that another process can open
while it is being written, without special settings (HDF5 locks). Frames are written in blocks, since a write costs as much as a
small frame's computation: a block as soon as a second has passed since the last, and before a checkpoint speaks of its frames.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from kinetic_solver.dataset import library
from kinetic_solver.dataset.checkpoint import sync_folder
from kinetic_solver.dataset.files import abandon, mark_as_stopped, refuse_existing
from kinetic_solver.dataset.provenance import attributes
from kinetic_solver.dataset.recorders import numbers
from kinetic_solver.dataset.schema import (
    FINISHED,
    RUNNING,
    SCALED,
    STATUS_ATTRIBUTES,
    STOPPED,
    TIME_ATTRIBUTES,
    VARIABLES,
    Frame,
    Variables,
    bounds,
    coordinates,
    scale_names,
    variables_on,
)
from kinetic_solver.dataset.units import conventions, unit_in
from kinetic_solver.errors import OutputFailed, SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene, Schedule

ROOM = 32768
"""Bytes kept free in a file's header for the attributes that its end brings. Chosen: the reasons of stops and the grids of an
adapting run take a few thousand."""
EVERY = 1.0
"""Seconds from one write to the next. Chosen: what a kill may cost, and often enough for whoever watches."""
BLOCK = 2**24
"""Bytes of frames after which they are written sooner. Chosen: a write of 16 MiB takes its time by its size alone."""


class NetCDFRecorder:
    """Writes frames to a file, in blocks that are synced to disk: a killed run loses at most those of the last second.

    The first frame is written at once, later ones with the first that comes EVERY seconds after the last write, or fills a BLOCK.
    Whoever runs long between frames calls `settle` meanwhile; `sync` writes all there are, and a checkpoint follows it.

    The file has its name only once the first frame is whole: a scene that is refused leaves none, and one that is there can be
    read. Its header has room for the attributes that come last, so that the data never move; the status is written after them.

    Groups with a cadence of their own have a time dimension of known length, whose frames to come are NaN. With `after` the file
    is one that a stopped run left, and goes on with the frame that follows that time.
    Raises OutputExistsError where the file exists and may not be overwritten, SceneError where it cannot be created.
    """

    def __init__(
        self,
        path: str | Path,
        grid: PhaseSpaceGrid,
        scene: Scene,
        schedule: Schedule,
        method: str = "grid",
        overwrite: bool = False,
        variables: Variables = VARIABLES,
        more: Mapping[str, np.ndarray] | None = None,
        after: float | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> None:
        self.path, self._notes = Path(path), dict(notes or {})
        refuse_existing(path, overwrite or after is not None)
        if not self.path.parent.is_dir():
            raise SceneError(f"{self.path}: cannot be created (its folder does not exist)")
        self._part = self.path.with_name(self.path.name + ".part")
        """The file's name until its first frame is whole."""
        self._named = False
        self._grid, self._scene, self._method = grid, scene, method
        self._file: Any = None
        self._more, self._notes = more or {}, dict(notes or {})
        self._schedule, self._dimensions = schedule, schedule.dimensions(scene)
        self._variables = variables_on(grid, variables, self._dimensions)
        self._count = dict.fromkeys(self._dimensions.values(), 0)
        """Frames that are written."""
        self._waiting: dict[str, list[tuple[float, dict[str, Any]]]] = {name: [] for name in self._count}
        """Those that are not, by dimension: time, and values by variable."""
        self._size, self._synced = 0, -np.inf
        if after is not None:
            self._reopen(after)
            self._sync()

    @library.calls()
    def _reopen(self, after: float) -> None:
        import netCDF4

        try:
            self._file = netCDF4.Dataset(self.path, "a")
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be continued ({error.strerror})") from None
        self._named = True
        began = self._scene.initial.time
        for dimension in self._count:
            times = np.ma.filled(self._file[dimension][:], np.inf)
            self._count[dimension] = int((times - began <= after * (1 + 1e-12) + 1e-12 * abs(began)).sum())
        for group, dimension in self._dimensions.items():
            if self._count[dimension] != int((self._schedule.of_group(group) <= after * (1 + 1e-12)).sum()):
                self._file.close()
                raise SceneError(f"{self.path}: has lost what was written before the checkpoint; allowed: to overwrite it")
        self._file["status"][...] = RUNNING
        if "stopped" in self._file.ncattrs():
            self._file.delncattr("stopped")

    @library.calls()
    def _create(self) -> None:
        import netCDF4

        grid, scene, method = self._grid, self._scene, self._method
        try:
            self._file = out = netCDF4.Dataset(self._part, "w", format="NETCDF3_64BIT_DATA")
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be created ({error.strerror})") from None
        out.setncatts({**attributes(scene, method), **conventions(scene), **self._notes, "room": " " * ROOM})
        out.createDimension("bounds", 2)
        for name, (dimension, values, attrs) in coordinates(grid).items():
            out.createDimension(name, values.size)
            variable = out.createVariable(name, "f8", (dimension,))
            variable.setncatts({**attrs, "units": unit_in(scene.units, attrs["units"])})
            variable[:] = values
        for name, values in self._more.items():
            out.createDimension(name, values.size)
            variable = out.createVariable(name, "i4", (name,))
            variable.setncatts(numbers(name))
            variable[:] = values
        for name, (dimension, values) in bounds(grid).items():
            out.createVariable(name, "f8", (dimension, "bounds"))[:] = values
        status = out.createVariable("status", "i1", ())
        status.setncatts(STATUS_ATTRIBUTES)
        status[...] = RUNNING
        for group, dimension in self._dimensions.items():
            if dimension not in out.dimensions:
                times = None if dimension == "time" else self._schedule.of_group(group)
                out.createDimension(dimension, None if times is None else len(times))
                variable = out.createVariable(dimension, "f8", (dimension,))
                variable.setncatts({**TIME_ATTRIBUTES, "units": unit_in(scene.units, TIME_ATTRIBUTES["units"])})
                if times is not None:
                    variable[:] = scene.initial.time + times
            for name, (dims, units, long_name) in self._variables[group].items():
                variable = out.createVariable(name, "f8", (dimension, *dims), fill_value=np.nan)
                variable.setncatts({"long_name": long_name, "units": unit_in(scene.units, units)})
                if SCALED in dims:  # so that whoever takes the field has its velocities, too
                    variable.setncattr("coordinates", " ".join(scale_names(dimension)))
        out.sync()
        # The room stays: where the data begin has been settled (tests/faults/test_files.py).
        out.delncattr("room")

    def record(self, time: float, frame: Frame) -> None:
        """Takes a frame. Raises OutputFailed where what is due cannot be written; the frames before are kept."""
        if self._file is None:
            self._attempt(self._create)
        for dimension in {self._dimensions[group] for group in frame}:
            groups = [values for group, values in frame.items() if self._dimensions[group] == dimension]
            taken = {name: np.array(value, dtype=float) for values in groups for name, value in values.items()}
            self._waiting[dimension].append((self._scene.initial.time + time, taken))
            self._size += 8 + sum(value.nbytes for value in taken.values())
        if self._named:
            self.settle()
        else:
            self._attempt(self._write)  # though nothing may be wanted of it

    def settle(self) -> None:
        """Writes what waits, if it is time to. Raises OutputFailed."""
        if self._size and (self._size >= BLOCK or monotonic() - self._synced >= EVERY):
            self.sync()

    def sync(self) -> None:
        """Writes what waits, and syncs it. Raises OutputFailed."""
        if self._size:
            self._attempt(self._write)

    def _write(self) -> None:
        self._put()
        self._sync()
        if not self._named:
            self._part.replace(self.path)
            sync_folder(self.path.parent)
            self._named = True

    @library.calls()
    def _put(self) -> None:
        """What waits, in the library's hands."""
        for dimension, frames in self._waiting.items():
            if not frames:
                continue
            count = self._count[dimension]
            block = slice(count, count + len(frames))
            for name in frames[0][1]:
                self._file[name][block] = np.stack([values[name] for _, values in frames])
            # The times come last: a frame has a time only once it is whole.
            self._file[dimension][block] = [time for time, _ in frames]
            self._count[dimension] += len(frames)
            frames.clear()
        self._size = 0

    def _attempt(self, write: Callable[[], None]) -> None:
        try:
            write()
        except (OSError, RuntimeError) as error:
            raise self._failed(error) from None

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        """Raises OutputFailed where the end cannot be written; nothing is done where no frame could be."""
        if self._file is None:
            return
        last = {"stopped": stopped} if stopped else dict(report or {})
        try:
            if self._named:
                self._put()
                with library.calls():
                    self._file.setncatts(last)
                self._sync()
                with library.calls():
                    self._file["status"][...] = STOPPED if stopped else FINISHED
                self._sync()
            with library.calls():
                self._file.close()
        except (OSError, RuntimeError) as error:
            raise self._failed(error) from None
        self._file = None
        self._part.unlink(missing_ok=True)

    def _failed(self, error: Exception) -> OutputFailed:
        """The file is given up: closing it would fail again, and crash. What is on disk stays, and says that it stopped."""
        reason = getattr(error, "strerror", None) or str(error)
        if "define mode" in reason:  # what the library says after it could not write a header
            reason = "no room for its header"
        if self._file is not None:
            abandon(self._file)
        self._file = None
        self._part.unlink(missing_ok=True)
        message = f"{self.path}: cannot be written ({reason}); make room, and resume the run"
        if self._named:
            mark_as_stopped(self.path, message)
        return OutputFailed(message)

    def _sync(self) -> None:
        with library.calls():
            self._file.sync()
        descriptor = os.open(self.path if self._named else self._part, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        self._synced = monotonic()
