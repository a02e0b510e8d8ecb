"""Whole files: read, added to, written at once."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinetic_solver.dataset import library
from kinetic_solver.dataset.header import needed_bytes
from kinetic_solver.dataset.schema import STOPPED
from kinetic_solver.errors import OutputExistsError, OutputFailed, SceneError
from kinetic_solver.scene import Scene

if TYPE_CHECKING:
    import xarray as xr


LONGEST_NAME = 230
"""Bytes of a file's name: 255 on all common file systems, less what a run adds to it (`.checkpoint.previous`)."""
NO_TIME = 9e36
"""A frame in the making has netCDF's fill value, 9.97e36, for its time."""


def open_netcdf(path: str | Path, source: str | None = None) -> xr.Dataset:
    """A netCDF file, read lazily; times are the numbers that the file has, whatever their units.

    Raises SceneError, which begins with `source` (the path), where there is none.
    """
    import xarray as xr

    where, there = source or str(path), Path(path)
    try:
        if not there.exists():
            raise SceneError(f"{where}: there is no such file")
        if there.is_dir():
            raise SceneError(f"{where}: is a folder; allowed: a netCDF file")
        if not os.access(there, os.R_OK):
            raise SceneError(f"{where}: may not be read; allowed: a file with permission to read it")
        # What xarray makes of times by itself differs between its versions ("seconds" became durations in some).
        with library.OPENING:
            return xr.open_dataset(there, engine="netcdf4", decode_times=False)
    except SceneError:
        raise
    except (OSError, ValueError, RuntimeError):
        if _is_scene(there):
            raise SceneError(f"{where}: is a scene, no dataset; run it first, and give the file that it writes") from None
        raise SceneError(f"{where}: is not a readable netCDF file") from None


def _is_scene(path: Path) -> bool:
    """Whether a file reads as TOML with tables in it, as scenes do."""
    import tomllib

    try:
        with path.open("rb") as file:
            return any(isinstance(value, dict) for value in tomllib.load(file).values())
    except (OSError, ValueError):
        return False


def open_run(path: str | Path) -> xr.Dataset:
    """A run's dataset, read lazily, without a frame that a killed run left in the making.

    Raises SceneError where there is none, and where the file is cut short or has no frame.
    """
    dataset = open_netcdf(path)
    try:
        if "scene" not in dataset.attrs:
            raise _no_scene(path)
        if "time" in dataset.dims:
            _check_length(Path(path))
            frames = int((dataset["time"].values < NO_TIME).sum())
            if frames == 0:
                raise SceneError(f"{path}: has no frame yet; allowed: a run that has written one")
            if frames < dataset.sizes["time"]:
                source = dataset.encoding.get("source")
                dataset = dataset.isel(time=slice(0, frames))
                dataset.encoding["source"] = source
    except SceneError:
        dataset.close()
        raise
    return dataset


def _check_length(path: Path) -> None:
    there = path.stat().st_size
    try:
        needed = needed_bytes(path)
    except (struct.error, IndexError):
        raise SceneError(f"{path}: is not a readable netCDF file") from None
    if needed is not None and there < needed:
        raise SceneError(f"{path}: is cut short: it has {there} of the {needed} bytes that its header speaks of")


def scene_of(dataset: xr.Dataset, source: str | Path | None = None) -> Scene:
    """The scene of a run's dataset.

    Raises SceneError, which begins with `source` (the file's name, where there is one), where it has none or a damaged one.
    """
    source = source or Path(dataset.encoding.get("source", "dataset")).name
    if "scene" not in dataset.attrs:
        raise _no_scene(source)
    try:
        return Scene.model_validate_json(dataset.attrs["scene"])
    except SceneError as error:
        raise SceneError(f"{source}: its scene cannot be read ({error})") from None


def _no_scene(source: str | Path) -> SceneError:
    return SceneError(f"{source}: was not written by kinetic-solver (it has no scene)")


def law_of_run(dataset: xr.Dataset) -> str | None:
    """The name of the collision law that a run was given beside its scene (docs/extending.md); None where it had none."""
    return None if "law" not in dataset.attrs else str(json.loads(dataset.attrs["law"])["name"])


def refuse_law(dataset: xr.Dataset) -> None:
    """Raises SceneError where a run had a law of its own, of which linear theory knows nothing."""
    if (name := law_of_run(dataset)) is not None:
        raise SceneError(f"law {name!r}: there is no linear theory of it here; allowed: a run of the scene's own collisions")


def refuse_existing(path: str | Path, overwrite: bool = False) -> None:
    """Raises OutputExistsError where the file exists and may not be replaced, SceneError where a file cannot have its name."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = str(path).encode(errors="replace").decode()
        raise SceneError(f"{shown}: is no name of a file to write; allowed: one in UTF-8") from None
    long = [part for part in Path(path).parts if len(part.encode()) > LONGEST_NAME]
    if long:
        raise SceneError(f"{long[0][:20]}…: is too long a name, {len(long[0])} letters; allowed: up to {LONGEST_NAME} bytes")
    if Path(path).is_dir():
        raise SceneError(f"{path}: is a folder; allowed: the name of a file")
    if Path(path).exists() and not overwrite:
        error = OutputExistsError(f"{path}: exists already; allowed: another name, or to overwrite it")
        error.path = Path(path)
        raise error


def append(path: str | Path, dataset: xr.Dataset) -> None:
    """Add variables and attributes to a file whose run has finished."""
    import netCDF4

    dataset.load()  # before, since reading takes the lock that is held below
    with library.calls(), netCDF4.Dataset(path, "a") as out:
        for name, added in dataset.data_vars.items():
            values, dims = added.values, tuple(map(str, added.dims))
            for dimension, size in zip(dims, values.shape, strict=True):
                if dimension not in out.dimensions:
                    out.createDimension(dimension, size)
            variable = out.createVariable(str(name), "f8", dims)
            variable.setncatts(added.attrs)
            variable[:] = values
        out.setncatts(dataset.attrs)


def abandon(dataset: Any) -> None:
    """Leave a netCDF4.Dataset open to the end of the process: where a file cannot be written, closing it fails too, and what the
    library then frees twice would crash the process."""
    import ctypes

    ctypes.pythonapi.Py_IncRef(ctypes.py_object(dataset))


@library.calls()
def mark_as_stopped(path: Path, reason: str) -> None:
    """The file of a run that could not be written further says so, in the room that its header has; if it can."""
    import netCDF4

    try:
        file = netCDF4.Dataset(path, "a")
    except (OSError, RuntimeError):
        return
    try:
        file.setncattr("stopped", reason)
        file["status"][...] = STOPPED
        file.close()
    except (OSError, RuntimeError):
        abandon(file)


def write_dataset(dataset: xr.Dataset, path: str | Path, overwrite: bool = False) -> None:
    """Write a whole dataset in the format of `NetCDFRecorder`, through a temporary file: all of it or nothing.

    Raises SceneError where the file cannot be created, OutputFailed where there is no room for it.
    """
    path = Path(path)
    refuse_existing(path, overwrite)
    part = path.with_name(path.name + ".part")
    try:
        part.touch()
    except OSError as error:
        raise SceneError(f"{path}: cannot be created ({error.strerror})") from None
    try:
        # A dimension that grows is the first of every variable that has it: in a sweep it is not.
        over_time = [variable.dims for variable in dataset.variables.values() if "time" in variable.dims]
        growing = ["time"] if over_time and all(dims[0] == "time" for dims in over_time) else []
        with library.OPENING:
            dataset.to_netcdf(part, format="NETCDF3_64BIT_DATA", engine="netcdf4", unlimited_dims=growing)  # type: ignore[call-overload]
        part.replace(path)
    except (OSError, RuntimeError) as error:
        raise OutputFailed(f"{path}: cannot be written ({getattr(error, 'strerror', None) or error})") from None
    finally:
        part.unlink(missing_ok=True)
