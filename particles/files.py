"""Positions and velocities of particles from netCDF or CSV: starts of runs, and ensembles that others made.

A file has positions `position` or `x` and velocities `velocity` or `v`, over (particle), (replica, particle), or either of them
with a time. A dimension called time… is the time, one called replica… the replicas; the particles' may have any name. Files
written with `output.particles` are such files. A table in CSV has columns of these names (particles/tables.py).
Tests: tests/cross_validation/particles/test_files.py.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import open_netcdf, scene_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from particles.tables import PAIRS, read_table

if TYPE_CHECKING:
    import xarray as xr


def open_particles(path: str | Path, source: str | None = None) -> xr.Dataset:
    """A file that may hold particles, netCDF or `.csv`. Raises SceneError, which begins with `source` (the path)."""
    return read_table(path, source) if Path(path).suffix.lower() == ".csv" else open_netcdf(path, source)


def particle_names(dataset: xr.Dataset) -> tuple[str, str] | None:
    """The names of positions and velocities; None where the dataset holds none (x and v of a grid are no particles)."""
    for x, v in PAIRS:
        if x in dataset.variables and v in dataset.variables:
            dims = dataset[x].dims
            if dims and dims == dataset[v].dims and dims != (x,):
                return x, v
    return None


def frame_of_particles(dataset: xr.Dataset, frame: int = -1) -> tuple[Array, Array]:
    """x, v (replica, particle) of one frame of a dataset that `particle_names` knows; times are a first dimension `time…`."""
    names = particle_names(dataset)
    assert names is not None
    arrays = []
    for name in names:
        values = dataset[name]
        if (time := time_dimension(values)) is not None:
            values = values.isel({time: frame})
        replicas = _dimension(values, "replica")
        if values.ndim == 2 and replicas is not None:
            values = values.transpose(replicas, ...)
        if values.ndim not in (1, 2) or not values.size or (values.ndim == 2 and replicas is None):
            raise SceneError(
                f"{name}: has dimensions {', '.join(f'{d} = {n}' for d, n in dataset[name].sizes.items())}; "
                "allowed: (time,) (replica,) particle, with these two names, and at least one particle"
            )
        if values.dtype.kind not in "fiu":
            raise SceneError(f"{name}: is of type {values.dtype}; allowed: numbers")
        arrays.append(np.atleast_2d(np.asarray(values, dtype=float)))
    return arrays[0], arrays[1]


def time_dimension(values: xr.DataArray) -> str | None:
    """The one that is called time…"""
    return _dimension(values, "time")


def _dimension(values: xr.DataArray, name: str) -> str | None:
    return next((str(dim) for dim in values.dims if str(dim).startswith(name)), None)


def last_frame(dataset: xr.Dataset) -> int:
    """The last frame that is there: a stopped run leaves NaN in the frames to come."""
    names = particle_names(dataset)
    assert names is not None
    places = dataset[names[0]]
    time = time_dimension(places)
    if time is None:
        return -1
    frames = [n for n in range(places.sizes[time]) if np.isfinite(np.asarray(places.isel({time: n}), dtype=float)).any()]
    return frames[-1] if frames else -1


def holds_particles(path: str | Path) -> bool:
    """Whether a file holds particles and no f, so that particles alone can start from it."""
    try:
        with open_particles(path) as dataset:
            return particle_names(dataset) is not None and "f" not in dataset
    except SceneError:
        return False


def count_of(scene: Scene) -> tuple[int, int]:
    """(replicas, particles of each) in `initial.file`. Warns where positions lie outside the pipe: a run takes them modulo L."""
    x, _ = _read(scene)
    if (outside := outside_of_pipe(x, scene.pipe.length)) > 0:
        warnings.warn(
            f"initial.file = {scene.initial.file!r}: {outside} of its {x.size} positions lie outside [0, pipe.length = "
            f"{scene.pipe.length:g}): taken modulo the period",
            stacklevel=2,
        )
    return x.shape[0], x.shape[1]


def outside_of_pipe(x: Array, length: float) -> int:
    """How many positions are not in [0, length)."""
    return int(((x < 0) | (x >= length)).sum())


def start_from_file(scene: Scene) -> tuple[Array, Array]:
    """x in [0, length), v, each (replica, particle): the last frame of `initial.file` that a run has reached.

    Raises SceneError where it cannot be read, holds no particles, or ones that are not finite.
    """
    x, v = _read(scene)
    length = scene.pipe.length
    x = np.mod(x, length)
    x[x >= length] = 0.0
    return x, v


def _read(scene: Scene) -> tuple[Array, Array]:
    """As in the file."""
    path = scene.initial.file
    assert path is not None
    where = f"initial.file = {path!r}"
    with open_particles(path, where) as dataset:
        if particle_names(dataset) is None:
            raise SceneError(
                f"{where}: has no positions and velocities of particles ({what_is_read(dataset)}); "
                "the particles start from nothing else (runs write them with output.particles = true)"
            )
        if "scene" in dataset.attrs:
            theirs = scene_of(dataset, where).pipe.length
            if not np.isclose(theirs, scene.pipe.length, rtol=1e-9):
                raise SceneError(f"{where}: its period is {theirs:.10g}, the scene's {scene.pipe.length:.10g}")
        frame = last_frame(dataset)
        try:
            x, v = frame_of_particles(dataset, frame)
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from None
    if lost := int((~(np.isfinite(x) & np.isfinite(v))).sum()):
        raise SceneError(
            f"{where}: {'its' if frame < 0 else f'in frame {frame + 1}, the last one, its'} positions or velocities are not "
            f"finite for {lost} of {x.size} particles; allowed: numbers"
        )
    return x, v


def what_is_read(dataset: xr.Dataset) -> str:
    """The names that are looked for, and those that are there, in words."""
    there = ", ".join(map(str, list(dataset.variables)[:8])) or "none"
    return f"read are position and velocity, or x and v, both over particles; the file's variables: {there}"
