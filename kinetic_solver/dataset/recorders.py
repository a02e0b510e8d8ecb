"""Recorders take frames as a run produces them: into memory, or into a netCDF file that others may read meanwhile.

Files are netCDF classic 64-bit data (CDF-5): measured, it is the format that another process can open while it is being
written, without special settings (HDF5 locks). Each frame is synced to disk as it is written.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kinetic_solver.dataset.provenance import attributes
from kinetic_solver.dataset.schema import (
    FINISHED,
    RUNNING,
    STATUS_ATTRIBUTES,
    STOPPED,
    VARIABLES,
    Frame,
    Variables,
    bounds,
    coordinates,
)
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene

if TYPE_CHECKING:
    import xarray as xr


def _time_dimensions(scene: Scene, variables: Variables) -> dict[str, str]:
    """The time dimension of each group: `time`, or `time_<group>` for a cadence of its own."""
    result = {}
    for group in variables:
        cadence = getattr(scene.output, group)
        if cadence is False:
            continue
        own = cadence is not True and cadence != scene.output_every
        result[group] = f"time_{group}" if own else "time"
    return result


class Recorder(Protocol):
    """Takes frames as a run produces them."""

    def record(self, time: float, frame: Frame) -> None: ...

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        """The run is over: finished, with what it reports as attributes, or stopped for the reason given."""


class MemoryRecorder:
    """Keeps frames in memory and makes them a Dataset."""

    def __init__(
        self,
        grid: PhaseSpaceGrid,
        scene: Scene,
        method: str = "grid",
        variables: Variables = VARIABLES,
        more: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        self.grid, self.scene, self.method = grid, scene, method
        self._variables, self._more = variables, more or {}
        self._dimensions = _time_dimensions(scene, variables)
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
        axes.update({name: (name, values) for name, values in self._more.items()})
        for name, times in self._times.items():
            axes[name] = (name, np.array(times), {"long_name": "time", "units": "time", "axis": "T"})
        dataset = xr.Dataset(data, axes, attributes(self.scene, self.method))
        dataset.attrs.update(self._last)
        return dataset


class NetCDFRecorder:
    """Writes each frame to a file and syncs it to disk: a killed run loses at most the frame in hand.

    The file comes into being with the first frame, so a scene that is refused leaves none.

    Groups with a cadence of their own have a time dimension of known length, whose frames to come are NaN. With `after` the file
    is one that a stopped run left, and goes on with the frame that follows that time.
    Raises SceneError where the file exists and may not be overwritten, or cannot be created.
    """

    def __init__(
        self,
        path: str | Path,
        grid: PhaseSpaceGrid,
        scene: Scene,
        method: str = "grid",
        overwrite: bool = False,
        variables: Variables = VARIABLES,
        more: Mapping[str, np.ndarray] | None = None,
        after: float | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.exists() and not overwrite and after is None:
            raise SceneError(f"{self.path}: exists already; use --overwrite to replace it, or name another file with -o")
        if not self.path.parent.is_dir():
            raise SceneError(f"{self.path}: cannot be created (its folder does not exist)")
        self._grid, self._scene, self._method = grid, scene, method
        self._file: Any = None
        self._variables, self._more = variables, more or {}
        self._dimensions = _time_dimensions(scene, variables)
        self._count = dict.fromkeys(self._dimensions.values(), 0)
        if after is not None:
            self._reopen(after)

    def _reopen(self, after: float) -> None:
        import netCDF4

        try:
            self._file = netCDF4.Dataset(self.path, "a")
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be continued ({error.strerror})") from None
        for dimension in self._count:
            times = np.ma.filled(self._file[dimension][:], np.inf)
            self._count[dimension] = int((times <= after * (1 + 1e-12)).sum())
        self._file["status"][...] = RUNNING
        if "stopped" in self._file.ncattrs():
            self._file.delncattr("stopped")
        self._sync()

    def _create(self) -> None:
        import netCDF4

        grid, scene, method = self._grid, self._scene, self._method
        try:
            self._file = out = netCDF4.Dataset(self.path, "w", format="NETCDF3_64BIT_DATA")
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be created ({error.strerror})") from None
        out.setncatts(attributes(scene, method))
        for name, size in (("x", grid.nx), ("v", grid.nv), ("bounds", 2)):
            out.createDimension(name, size)
        for name, (dimension, values, attrs) in coordinates(grid).items():
            variable = out.createVariable(name, "f8", (dimension,))
            variable.setncatts(attrs)
            variable[:] = values
        for name, values in self._more.items():
            out.createDimension(name, values.size)
            out.createVariable(name, "i4", (name,))[:] = values
        for name, (dimension, values) in bounds(grid).items():
            out.createVariable(name, "f8", (dimension, "bounds"))[:] = values
        status = out.createVariable("status", "i1", ())
        status.setncatts(STATUS_ATTRIBUTES)
        status[...] = RUNNING
        for group, dimension in self._dimensions.items():
            if dimension not in out.dimensions:
                times = None if dimension == "time" else scene.times(getattr(scene.output, group))
                out.createDimension(dimension, None if times is None else len(times))
                variable = out.createVariable(dimension, "f8", (dimension,))
                variable.setncatts({"long_name": "time", "units": "time", "axis": "T"})
                if times is not None:
                    variable[:] = times
            for name, (dims, units, long_name) in self._variables[group].items():
                variable = out.createVariable(name, "f8", (dimension, *dims), fill_value=np.nan)
                variable.setncatts({"long_name": long_name, "units": units})
        self._sync()

    def record(self, time: float, frame: Frame) -> None:
        if self._file is None:
            self._create()
        for dimension in {self._dimensions[group] for group in frame}:
            index = self._count[dimension]
            for group, values in frame.items():
                if self._dimensions[group] == dimension:
                    for name, value in values.items():
                        self._file[name][index] = value
            # The time comes last: a frame has a time only once it is whole.
            self._file[dimension][index] = time
            self._count[dimension] = index + 1
        self._sync()

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        if self._file is None:
            return
        self._file["status"][...] = STOPPED if stopped else FINISHED
        self._sync()
        self._file.setncatts({"stopped": stopped} if stopped else dict(report or {}))
        self._file.close()

    def _sync(self) -> None:
        self._file.sync()
        descriptor = os.open(self.path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
