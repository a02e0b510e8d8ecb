"""The dataset's schema, and the one module that writes netCDF.

Files are netCDF classic 64-bit data (CDF-5): measured, it is the format that another process can open while it is being
written, without special settings (HDF5 locks). Each frame is synced to disk as it is written.
"""

from __future__ import annotations

import functools
import json
import os
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene, SceneError

if TYPE_CHECKING:
    import xarray as xr

RUNNING, FINISHED, STOPPED = 0, 1, 2

Frame = Mapping[str, Mapping[str, Any]]
"""What one time brings: group of `[output]` → variable → value."""

Variables = Mapping[str, Mapping[str, tuple[tuple[str, ...], str, str]]]
"""Group of `[output]` → name → (dimensions beside time, units, long name)."""

VARIABLES: Variables = {
    "f": {"f": (("x", "v"), "particles time length-2", "distribution function, point values")},
    "moments": {
        "density": (("x",), "particles length-1", "density ρ"),
        "mean_velocity": (("x",), "length time-1", "mean velocity u"),
        "temperature": (("x",), "length2 time-2", "granular temperature θ, the velocity variance"),
        "heat_flux": (("x",), "particles length2 time-3", "heat flux, third central velocity moment of f"),
        "velocity_distribution": (("v",), "particles time length-1", "velocity distribution w(v), f integrated over x"),
    },
    "scalars": {
        "mass": ((), "particles", "number of particles"),
        "momentum": ((), "particles length time-1", "total momentum"),
        "energy": ((), "particles length2 time-2", "total kinetic energy"),
        "minimum_of_f": ((), "1", "minimum of f over its maximum"),
        "edge_error_low": ((), "1", "f at the window's lower edge, amplified as operator (6) does, over max f"),
        "edge_error_high": ((), "1", "f at the window's upper edge over max f"),
        "velocity_curvature": ((), "1", "largest second difference of f in v over max f; 0.5 is unresolved"),
        "spectral_tail": ((), "1", "largest amplitude in the highest eighth of wavenumbers over the largest of all"),
        "density_defect": ((), "1", "what the linearised step of operator (6) misses of the density, over its maximum"),
        "error_estimate": ((), "1", "estimated error of f over max f: the sum of its parts below"),
        "error_time": ((), "1", "of it, from the steps in time"),
        "error_x": ((), "1", "of it, from the waves in x that the grid cannot hold"),
        "error_v": ((), "1", "of it, from the spacing in v"),
        "error_window": ((), "1", "of it, from the edges of the velocity window"),
    },
    "budgets": {
        **{f"momentum_rate_{t}": ((), "particles length time-2", f"rate of momentum by {t}")
           for t in ("gravity", "friction", "collisions")},
        **{f"energy_rate_{t}": ((), "particles length2 time-3", f"rate of energy by {t}")
           for t in ("gravity", "friction", "noise", "collisions")},
        **{f"momentum_from_{t}": ((), "particles length time-1", f"momentum brought by {t} since time 0")
           for t in ("gravity", "friction", "collisions")},
        **{f"energy_from_{t}": ((), "particles length2 time-2", f"energy brought by {t} since time 0")
           for t in ("gravity", "friction", "noise", "collisions")},
        "mass_residual": ((), "particles", "mass minus its initial value"),
        "momentum_residual": ((), "particles length time-1", "momentum minus initial minus what the terms brought"),
        "energy_residual": ((), "particles length2 time-2", "energy minus initial minus what the terms brought"),
    },
    "moment_equations": {
        **{f"density_rate{t}": (("x",), "particles length-1 time-1", f"(3): rate of the density{t.replace('_', ' ')}")
           for t in ("", "_advection", "_compression", "_residual")},
        **{f"mean_velocity_rate{t}": (("x",), "length time-2", f"(4): rate of the mean velocity{t.replace('_', ' ')}")
           for t in ("", "_advection", "_pressure", "_gravity", "_friction", "_collisions", "_residual")},
        **{f"temperature_rate{t}": (("x",), "length2 time-3", f"(5): rate of the temperature{t.replace('_', ' ')}")
           for t in ("", "_advection", "_compression", "_heat_flux", "_friction", "_noise", "_collisions", "_residual")},
    },
}  # fmt: skip


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


def _coordinates(grid: PhaseSpaceGrid) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
    return {
        "x": ("x", grid.x, {"long_name": "position", "units": "length", "axis": "X", "bounds": "x_bounds"}),
        "v": ("v", grid.v, {"long_name": "velocity", "units": "length time-1", "bounds": "v_bounds"}),
    }


def _bounds(grid: PhaseSpaceGrid) -> dict[str, tuple[str, np.ndarray]]:
    half = grid.dx / 2
    return {
        "x_bounds": ("x", np.stack([grid.x - half, grid.x + half], axis=1)),
        "v_bounds": ("v", np.stack([grid.faces[:-1], grid.faces[1:]], axis=1)),
    }


PACKAGES = ("numpy", "scipy", "numba", "pyfftw", "xarray", "netCDF4")
_version = functools.cache(metadata.version)


def attributes(scene: Scene, method: str) -> dict[str, str | float]:
    """Provenance: the scene as one JSON text, version, command, seed, packages."""
    return {
        "Conventions": "CF-1.11",
        "title": "One-dimensional kinetic equation with friction, noise and collisions",
        "method": method,
        "scene": scene.model_dump_json(by_alias=True, exclude_none=True),
        "source": f"kinetic-solver {_version('kinetic-solver')}",
        "version": _version("kinetic-solver"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "seed": scene.particles.seed,
        "packages": json.dumps({name: _version(name) for name in PACKAGES}),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


STATUS_ATTRIBUTES = {
    "long_name": "state of the run",
    "flag_values": np.array([RUNNING, FINISHED, STOPPED], dtype="i1"),
    "flag_meanings": "running finished stopped",
}


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
        coordinates: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        self.grid, self.scene, self.method = grid, scene, method
        self._variables, self._more = variables, coordinates or {}
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
        for name, (dimension, values) in _bounds(self.grid).items():
            data[name] = ((dimension, "bounds"), values)
        data["status"] = ((), np.int8(self._status), STATUS_ATTRIBUTES)
        coordinates: dict[str, Any] = dict(_coordinates(self.grid))
        coordinates.update({name: (name, values) for name, values in self._more.items()})
        for name, times in self._times.items():
            coordinates[name] = (name, np.array(times), {"long_name": "time", "units": "time", "axis": "T"})
        dataset = xr.Dataset(data, coordinates, attributes(self.scene, self.method))
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
        coordinates: Mapping[str, np.ndarray] | None = None,
        after: float | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.exists() and not overwrite and after is None:
            raise SceneError(f"{self.path}: exists already; use --overwrite to replace it, or name another file with -o")
        if not self.path.parent.is_dir():
            raise SceneError(f"{self.path}: cannot be created (its folder does not exist)")
        self._grid, self._scene, self._method = grid, scene, method
        self._file: Any = None
        self._variables, self._more = variables, coordinates or {}
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
        for name, (dimension, values, attrs) in _coordinates(grid).items():
            variable = out.createVariable(name, "f8", (dimension,))
            variable.setncatts(attrs)
            variable[:] = values
        for name, values in self._more.items():
            out.createDimension(name, values.size)
            out.createVariable(name, "i4", (name,))[:] = values
        for name, (dimension, values) in _bounds(grid).items():
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


def open_run(path: str | Path) -> xr.Dataset:
    """A run's dataset, read lazily. Raises SceneError where there is none."""
    import xarray as xr

    try:
        dataset = xr.open_dataset(path)
    except (OSError, ValueError):
        raise SceneError(f"{path}: is not a readable netCDF file") from None
    if "scene" not in dataset.attrs:
        raise SceneError(f"{path}: was not written by kinetic-solver (it has no scene)")
    return dataset


def append(path: str | Path, dataset: xr.Dataset) -> None:
    """Add variables and attributes to a file whose run has finished."""
    import netCDF4

    with netCDF4.Dataset(path, "a") as out:
        for name, added in dataset.data_vars.items():
            values, dims = added.values, tuple(map(str, added.dims))
            for dimension, size in zip(dims, values.shape, strict=True):
                if dimension not in out.dimensions:
                    out.createDimension(dimension, size)
            variable = out.createVariable(str(name), "f8", dims)
            variable.setncatts(added.attrs)
            variable[:] = values
        out.setncatts(dataset.attrs)


def write_dataset(dataset: xr.Dataset, path: str | Path, overwrite: bool = False) -> None:
    """Write a whole dataset in the format of `NetCDFRecorder`, through a temporary file: all of it or nothing."""
    path = Path(path)
    if path.exists() and not overwrite:
        raise SceneError(f"{path}: exists already; use --overwrite to replace it, or name another file with -o")
    part = path.with_name(path.name + ".part")
    try:
        growing = [name for name in ("time",) if name in dataset.dims]
        dataset.to_netcdf(part, format="NETCDF3_64BIT_DATA", engine="netcdf4", unlimited_dims=growing)  # type: ignore[call-overload]
        part.replace(path)
    except OSError as error:
        raise SceneError(f"{path}: cannot be created ({error.strerror})") from None
    finally:
        part.unlink(missing_ok=True)
