"""Recorders take frames as a run produces them: into memory, or into a netCDF file that others may read meanwhile.

When anything is due is the schedule's to say (kinetic_solver/scene/schedule.py): a recorder gives each group of `[output]` the
time dimension that the schedule names.

Files are netCDF classic 64-bit data (CDF-5): measured (benchmarks/live_file.py), it is the format that another process can open
while it is being written, without special settings (HDF5 locks). Each frame is synced to disk as it is written.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kinetic_solver.dataset.checkpoint import sync_folder
from kinetic_solver.dataset.files import abandon, mark_as_stopped, refuse_existing
from kinetic_solver.dataset.provenance import attributes
from kinetic_solver.dataset.schema import (
    FINISHED,
    RUNNING,
    STATUS_ATTRIBUTES,
    STOPPED,
    TIME_ATTRIBUTES,
    VARIABLES,
    Frame,
    Variables,
    bounds,
    coordinates,
)
from kinetic_solver.dataset.units import conventions, name_units, unit_in
from kinetic_solver.errors import OutputFailed, RunUnfinished, SceneError, SolverStopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene, Schedule

if TYPE_CHECKING:
    import xarray as xr


ROOM = 32768
"""Bytes kept free in a file's header for the attributes that its end brings. Chosen: the reasons of stops and the grids of an
adapting run take a few thousand."""


class Recorder(Protocol):
    """Takes frames as a run produces them."""

    def record(self, time: float, frame: Frame) -> None: ...

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        """The run is over: finished, with what it reports as attributes, or stopped for the reason given."""


@contextmanager
def recording(recorder: Recorder) -> Iterator[None]:
    """A run that fails or is interrupted closes its recorder with the reason; the run closes it where it comes to its end.

    A SolverStopped takes the frames that were kept in memory with it, as its `dataset`.
    """
    try:
        yield
    except BaseException as stop:
        said = isinstance(stop, (SolverStopped, RunUnfinished, OutputFailed))
        recorder.close(stopped=str(stop) if said else f"interrupted by {type(stop).__name__} {stop}".strip())
        if isinstance(stop, SolverStopped) and isinstance(recorder, MemoryRecorder):
            stop.dataset = recorder.dataset()
        raise


def _numbers(name: str) -> dict[str, str]:
    """Attributes of a coordinate that counts."""
    return {"long_name": f"number of the {name}", "units": "1"}


class MemoryRecorder:
    """Keeps frames in memory and makes them a Dataset. `more` are coordinates beside time, x and v, `notes` attributes beside the
    common ones."""

    def __init__(
        self,
        grid: PhaseSpaceGrid,
        scene: Scene,
        schedule: Schedule,
        method: str = "grid",
        variables: Variables = VARIABLES,
        more: Mapping[str, np.ndarray] | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> None:
        self.grid, self.scene, self.method = grid, scene, method
        self._variables, self._more, self._notes = variables, more or {}, dict(notes or {})
        self._dimensions = schedule.dimensions(scene)
        self._times: dict[str, list[float]] = {name: [] for name in self._dimensions.values()}
        self._values: dict[str, list[Any]] = {}
        self._status = RUNNING
        self._last: dict[str, str] = {}

    def record(self, time: float, frame: Frame) -> None:
        for group, values in frame.items():
            times = self._times[self._dimensions[group]]
            if not times or times[-1] != time:
                times.append(time)
            for name, value in values.items():
                self._values.setdefault(name, []).append(np.array(value, dtype=float))

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        self._status = STOPPED if stopped else FINISHED
        self._last = {"stopped": stopped} if stopped else dict(report or {})

    def dataset(self) -> xr.Dataset:
        import xarray as xr

        data: dict[str, Any] = {}
        for group, dimension in self._dimensions.items():
            for name, (dims, units, long_name) in self._variables[group].items():
                if name in self._values:
                    values = np.stack(self._values[name])
                    data[name] = ((dimension, *dims), values, {"long_name": long_name, "units": units})
        for name, (dimension, values) in bounds(self.grid).items():
            data[name] = ((dimension, "bounds"), values)
        data["status"] = ((), np.int8(self._status), STATUS_ATTRIBUTES)
        axes: dict[str, Any] = dict(coordinates(self.grid))
        axes.update({name: (name, values, _numbers(name)) for name, values in self._more.items()})
        for name, times in self._times.items():
            axes[name] = (name, self.scene.initial.time + np.array(times), TIME_ATTRIBUTES)
        dataset = xr.Dataset(data, axes, attributes(self.scene, self.method) | self._notes)
        name_units(dataset, self.scene)
        dataset.attrs.update(self._last)
        return dataset


class NetCDFRecorder:
    """Writes each frame to a file and syncs it to disk: a killed run loses at most the frame in hand.

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
        self._variables, self._more, self._notes = variables, more or {}, dict(notes or {})
        self._schedule, self._dimensions = schedule, schedule.dimensions(scene)
        self._count = dict.fromkeys(self._dimensions.values(), 0)
        if after is not None:
            self._reopen(after)

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
        self._sync()

    def _create(self) -> None:
        import netCDF4

        grid, scene, method = self._grid, self._scene, self._method
        try:
            self._file = out = netCDF4.Dataset(self._part, "w", format="NETCDF3_64BIT_DATA")
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be created ({error.strerror})") from None
        out.setncatts({**attributes(scene, method), **conventions(scene), **self._notes, "room": " " * ROOM})
        for name, size in (("x", grid.nx), ("v", grid.nv), ("bounds", 2)):
            out.createDimension(name, size)
        for name, (dimension, values, attrs) in coordinates(grid).items():
            variable = out.createVariable(name, "f8", (dimension,))
            variable.setncatts({**attrs, "units": unit_in(scene, attrs["units"])})
            variable[:] = values
        for name, values in self._more.items():
            out.createDimension(name, values.size)
            variable = out.createVariable(name, "i4", (name,))
            variable.setncatts(_numbers(name))
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
                variable.setncatts({**TIME_ATTRIBUTES, "units": unit_in(scene, TIME_ATTRIBUTES["units"])})
                if times is not None:
                    variable[:] = scene.initial.time + times
            for name, (dims, units, long_name) in self._variables[group].items():
                variable = out.createVariable(name, "f8", (dimension, *dims), fill_value=np.nan)
                variable.setncatts({"long_name": long_name, "units": unit_in(scene, units)})
        out.sync()
        # The room stays: where the data begin has been settled (tests/faults/test_files.py).
        out.delncattr("room")

    def record(self, time: float, frame: Frame) -> None:
        """Raises OutputFailed where it cannot be written; the frames before are kept."""
        try:
            self._record(time, frame)
        except (OSError, RuntimeError) as error:
            raise self._failed(error) from None

    def _record(self, time: float, frame: Frame) -> None:
        if self._file is None:
            self._create()
        for dimension in {self._dimensions[group] for group in frame}:
            index = self._count[dimension]
            for group, values in frame.items():
                if self._dimensions[group] == dimension:
                    for name, value in values.items():
                        self._file[name][index] = value
            # The time comes last: a frame has a time only once it is whole.
            self._file[dimension][index] = self._scene.initial.time + time
            self._count[dimension] = index + 1
        self._sync()
        if not self._named:
            self._part.replace(self.path)
            sync_folder(self.path.parent)
            self._named = True

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        """Raises OutputFailed where the end cannot be written; nothing is done where no frame could be."""
        if self._file is None:
            return
        last = {"stopped": stopped} if stopped else dict(report or {})
        try:
            if self._named:
                if last:
                    self._file.setncatts(last)
                    self._sync()
                self._file["status"][...] = STOPPED if stopped else FINISHED
                self._sync()
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
        self._file.sync()
        descriptor = os.open(self.path if self._named else self._part, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
