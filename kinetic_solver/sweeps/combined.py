"""The points of a sweep as one dataset, on one grid."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver.analysis.resampling import resample
from kinetic_solver.dataset import STOPPED, attributes, in_velocities, open_run, schema, velocity_axis
from kinetic_solver.dataset.schema import ORIGIN, SCALE, SCALED
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.machine import too_large
from kinetic_solver.scene import Scene
from kinetic_solver.sweeps.points import Point

KEPT = ("title", "method", "source", "version", "packages")
"""Attributes of a run that all have in common."""
OF_A_GRID = ("x", "v", SCALED, "bounds")
"""Dimensions that are the same in all points once they are on one grid."""


def combined(scene: Scene, values: Mapping[str, Sequence[Any]], points: Sequence[Point]) -> xr.Dataset:
    """Dimensions: the keys, then those of a run. Missing: what a failed point does not have, and times that others have.

    x and v are those of the points where they are the same; else there are as many as the finest has, in a window that holds
    all. x is over the pipe's length where that differs. Files are read one at a time: beside the dataset there is one run in
    memory. Raises SceneError where no point has anything, or memory is too small.
    """
    there = [(place, point) for place, point in enumerate(points) if point.scene is not None and point.file.exists()]
    if not there:
        raise SceneError(f"sweep: every point has failed; the first: {points[0].error}")
    form = _Form()
    for _, point in there:
        with _opened(point) as run:
            form.take(run)
    form.settle()
    first = form.bring(_read(there[0][1]))
    shape = tuple(len(listed) for listed in values.values())
    sizes = {
        **{dim: axis.size for dim, axis in form.axes.items()},
        **form.others,
        **{dim: first.sizes.get(dim, 0) for dim in OF_A_GRID},
    }
    needed = 8 * len(points) * sum(math.prod(sizes[dim] for dim in dims) for dims, _ in form.variables.values())
    if (why := too_large(needed)) is not None:
        raise SceneError(f"sweep: {len(points)} points {why}; set output.f = false, or fewer points of output.nx and output.nv")
    full = {name: np.full((len(points), *(sizes[dim] for dim in dims)), np.nan) for name, (dims, _) in form.variables.items()}
    statuses = np.full(len(points), STOPPED, dtype=np.int8)
    for place, point in there:
        run = first if place == there[0][0] else form.bring(_read(point))
        statuses[place] = int(run["status"])
        for name, (dims, _) in form.variables.items():
            if name in run:
                own = run[name].transpose(*dims).values
                full[name][place][tuple(slice(size) for size in own.shape)] = own
    data: dict[str, Any] = {
        name: ((*values, *dims), full.pop(name).reshape(*shape, *(sizes[dim] for dim in dims)), attrs)
        for name, (dims, attrs) in form.variables.items()
    }
    about = {"long_name": "state of the run", "flag_meanings": "running finished stopped"}
    data["status"] = (tuple(values), statuses.reshape(shape), about)
    errors = np.array([point.error for point in points], dtype=str).reshape(shape)
    data["error"] = (tuple(values), errors, {"long_name": "why the point failed"})
    axes = {str(name): axis for name, axis in first.coords.items()}
    axes |= {key: (key, _axis(listed), {"long_name": key}) for key, listed in values.items()}
    bounds = [name for name in ("x_bounds", "v_bounds", f"{SCALED}_bounds") if name in first]
    result = xr.Dataset(data, axes).assign({name: first[name] for name in bounds})
    common = {name: first.attrs[name] for name in KEPT if name in first.attrs}
    swept = json.dumps({key: list(listed) for key, listed in values.items()}, default=str)
    result.attrs = {**attributes(scene, points[0].method), **common, "swept": swept}
    return result


def _opened(point: Point) -> xr.Dataset:
    run = open_run(point.file)
    # The scales of scaled velocities are fields: every point has its own.
    run = run.reset_coords([name for name in run.coords if str(name).startswith((SCALE, ORIGIN))])
    return run.drop_dims("v") if run.sizes.get("v") == 1 else run


def _read(point: Point) -> xr.Dataset:
    with _opened(point) as run:
        return run.load()


class _Form:
    """What the runs have in common: `take` looks at each of them, `bring` puts one into it."""

    def __init__(self) -> None:
        self.variables: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {}
        """Name → dimensions, attributes; of all that is to be found in any run, but for bounds and the status."""
        self.axes: dict[str, np.ndarray] = {}
        """Of dimensions with coordinates, but for x and v, such as times: all of them that any run has."""
        self.others: dict[str, int] = {}
        """Sizes of dimensions without: the largest."""
        self._nx = 0
        self._windows: dict[str, set[tuple[float, float, int]]] = {}
        """By the name of the velocities."""
        self._lengths: set[float] = set()

    def take(self, run: xr.Dataset) -> None:
        self._nx = max(self._nx, run.sizes["x"])
        self._lengths.add(_length(run))
        over = velocity_axis(run)
        if over in run.dims:
            edges = run[f"{over}_bounds"].values
            self._windows.setdefault(over, set()).add((float(edges[0, 0]), float(edges[-1, 1]), len(edges)))
        for dim, size in run.sizes.items():
            name = str(dim)
            if name in run.coords and name not in OF_A_GRID:
                self.axes[name] = np.union1d(self.axes.get(name, []), run[name].values)
            elif name not in OF_A_GRID:
                self.others[name] = max(self.others.get(name, 0), size)
        for key, variable in run.data_vars.items():
            if key not in ("x_bounds", "v_bounds", f"{SCALED}_bounds", "status"):
                self.variables.setdefault(str(key), (tuple(map(str, variable.dims)), variable.attrs))

    @property
    def mixed(self) -> bool:
        """Whether some runs are over v and some over scaled velocities: then all are brought over v."""
        return len(self._windows) > 1

    def settle(self) -> None:
        """All runs have been looked at."""
        if self.mixed:
            for name, (dims, attrs) in list(self.variables.items()):
                if name.startswith((SCALE, ORIGIN)):
                    del self.variables[name]
                else:
                    self.variables[name] = (tuple("v" if dim == SCALED else dim for dim in dims), attrs)

    def bring(self, run: xr.Dataset) -> xr.Dataset:
        if run.sizes["x"] != self._nx:
            run = resample(run, nx=self._nx)
        over = velocity_axis(run)
        windows = self._windows.get("v" if self.mixed else over, set())
        if over in run.dims and (len(windows) > 1 or self.mixed):
            low, high = min(window[0] for window in windows), max(window[1] for window in windows)
            finest = min((right - left) / count for left, right, count in windows)
            nv = math.ceil((high - low) / finest - 1e-9)
            if self.mixed and over == SCALED:
                grid = PhaseSpaceGrid(1, nv, 1.0, low, high)
                scales = [name for name in run.data_vars if str(name).startswith((SCALE, ORIGIN))]
                edges = (("v", "bounds"), schema.bounds(grid)["v_bounds"][1])
                run = in_velocities(run.set_coords(scales), grid.v).assign(v_bounds=edges)
            else:
                run = resample(run, nv=nv, velocity_window=(low, high))
        if len(self._lengths) > 1:
            run = _over_length(run)
        return run.reindex({name: axis for name, axis in self.axes.items() if name in run.dims})


def _axis(listed: Sequence[Any]) -> np.ndarray:
    """Values of a key as a coordinate: numbers, or texts."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in listed):
        return np.array(listed)
    return np.array([value if isinstance(value, str) else json.dumps(value, default=str) for value in listed])


def _length(run: xr.Dataset) -> float:
    return float(run["x_bounds"].values[-1, 1] - run["x_bounds"].values[0, 0])


def _over_length(run: xr.Dataset) -> xr.Dataset:
    length = _length(run)
    x = ("x", run["x"].values / length, {"long_name": "position over the pipe's length", "units": "1", "axis": "X"})
    return run.assign_coords(x=x).assign(x_bounds=(("x", "bounds"), run["x_bounds"].values / length))
