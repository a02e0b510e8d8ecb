"""The points of a sweep as one dataset, on one grid."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver.analysis.resampling import resample
from kinetic_solver.dataset import STOPPED, attributes, in_velocities, open_run, velocity_axis
from kinetic_solver.dataset.schema import ORIGIN, SCALE, SCALED
from kinetic_solver.errors import SceneError
from kinetic_solver.machine import too_large
from kinetic_solver.scene import Scene
from kinetic_solver.sweeps.points import Point

POINT = "point of the sweep"
"""The dimension along which points lie before they are put in their places."""
KEPT = ("title", "method", "source", "version", "packages")
"""Attributes of a run that all have in common."""


def combined(scene: Scene, values: Mapping[str, Sequence[Any]], points: Sequence[Point]) -> xr.Dataset:
    """Dimensions: the keys, then those of a run. Missing: what a failed point does not have, and times that others have.

    x and v are those of the points where they are the same; else there are as many as the finest has, in a window that holds
    all. x is over the pipe's length where that differs. Raises SceneError where no point has anything, or memory is too small.
    """
    runs = [_opened(point) for point in points]
    there = [run for run in runs if run is not None]
    if not there:
        raise SceneError(f"sweep: every point has failed; the first: {points[0].error}")
    there = _on_one_grid(there)
    bounds = {name: there[0][name] for name in ("x_bounds", "v_bounds", f"{SCALED}_bounds") if name in there[0]}
    status = [int(run["status"]) for run in there]
    there = [run.drop_vars([*bounds, "status"]) for run in there]
    needed = sum(there[0][name].nbytes for name in there[0].data_vars) * len(points) * 2
    if (why := too_large(needed)) is not None:
        raise SceneError(f"sweep: {len(points)} points {why}; set output.f = false, or fewer points of output.nx and output.nv")
    whole = xr.concat(there, POINT, data_vars="all", coords="minimal", compat="override", join="outer", combine_attrs="override")
    places = np.flatnonzero([run is not None for run in runs])
    shape = tuple(len(listed) for listed in values.values())
    data: dict[str, Any] = {}
    for name, variable in whole.data_vars.items():
        inside = variable.transpose(POINT, ...)
        full = np.full((len(points), *inside.shape[1:]), np.nan)
        full[places] = inside.values
        dims = [str(dimension) for dimension in inside.dims[1:]]
        data[str(name)] = ((*values, *dims), full.reshape(*shape, *inside.shape[1:]), variable.attrs)
    statuses = np.full(len(points), STOPPED, dtype=np.int8)
    statuses[places] = status
    about = {"long_name": "state of the run", "flag_meanings": "running finished stopped"}
    data["status"] = (tuple(values), statuses.reshape(shape), about)
    errors = np.array([point.error for point in points], dtype=str).reshape(shape)
    data["error"] = (tuple(values), errors, {"long_name": "why the point failed"})
    axes = {str(name): axis for name, axis in whole.coords.items()}
    axes |= {key: (key, _axis(listed), {"long_name": key}) for key, listed in values.items()}
    result = xr.Dataset(data, axes).assign(bounds)
    common = {name: there[0].attrs[name] for name in KEPT if name in there[0].attrs}
    swept = json.dumps({key: list(listed) for key, listed in values.items()}, default=str)
    result.attrs = {**attributes(scene, points[0].method), **common, "swept": swept}
    return result


def _opened(point: Point) -> xr.Dataset | None:
    if point.scene is None or not point.file.exists():
        return None
    with open_run(point.file) as run:
        found = run.load()
    # The scales of scaled velocities are fields: every point has its own.
    found = found.reset_coords([name for name in found.coords if str(name).startswith((SCALE, ORIGIN))])
    return found.drop_dims("v") if found.sizes.get("v") == 1 else found


def _axis(listed: Sequence[Any]) -> np.ndarray:
    """Values of a key as a coordinate: numbers, or texts."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in listed):
        return np.array(listed)
    return np.array([value if isinstance(value, str) else json.dumps(value, default=str) for value in listed])


def _on_one_grid(runs: list[xr.Dataset]) -> list[xr.Dataset]:
    nx = max(run.sizes["x"] for run in runs)
    runs = [run if run.sizes["x"] == nx else resample(run, nx=nx) for run in runs]
    if not all(SCALED in run.dims for run in runs):
        runs = [_over_v(run, runs) for run in runs]
    if any(velocity_axis(run) in run.dims for run in runs):
        runs = _on_one_window(runs)
    lengths = {_length(run) for run in runs}
    if len(lengths) > 1:
        runs = [_over_length(run) for run in runs]
    first = runs[0]
    axes = {name: first[name] for name in ("x", velocity_axis(first)) if name in first.coords}
    return [run.assign_coords(axes) for run in runs]


def _over_v(run: xr.Dataset, runs: list[xr.Dataset]) -> xr.Dataset:
    """A run over scaled velocities over the v of one that is not, where not all are."""
    if SCALED not in run.dims:
        return run
    other = next(other for other in runs if SCALED not in other.dims)
    scales = [name for name in run.data_vars if str(name).startswith((SCALE, ORIGIN))]
    found = in_velocities(run.set_coords(scales), other["v"].values)
    return found.assign(v_bounds=other["v_bounds"])


def _on_one_window(runs: list[xr.Dataset]) -> list[xr.Dataset]:
    bounds = [run[f"{velocity_axis(run)}_bounds"].values for run in runs]
    windows = {(float(edges[0, 0]), float(edges[-1, 1]), len(edges)) for edges in bounds}
    if len(windows) == 1:
        return runs
    low, high = min(window[0] for window in windows), max(window[1] for window in windows)
    finest = min((right - left) / count for left, right, count in windows)
    nv = math.ceil((high - low) / finest - 1e-9)
    return [resample(run, nv=nv, velocity_window=(low, high)) for run in runs]


def _length(run: xr.Dataset) -> float:
    return float(run["x_bounds"].values[-1, 1] - run["x_bounds"].values[0, 0])


def _over_length(run: xr.Dataset) -> xr.Dataset:
    length = _length(run)
    x = ("x", run["x"].values / length, {"long_name": "position over the pipe's length", "units": "1", "axis": "X"})
    return run.assign_coords(x=x).assign(x_bounds=(("x", "bounds"), run["x_bounds"].values / length))
