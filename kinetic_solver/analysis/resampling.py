"""Datasets of any method brought to other points.

In x the trigonometric interpolant: exact for the waves that a grid holds, whatever number of points they are asked for at. In v
the trigonometric interpolant over the window, or a quintic spline: whichever finds every other value from those between better
(the first converges faster where f vanishes at the window's edges; a window that cuts f is for the second). Mean velocity,
temperature and heat flux are made from interpolated densities of number, momentum, energy and its flux, of which they are ratios.
Tests: tests/interface/test_resampling.py.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import in_velocities, schema, velocity_axis
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.interpolation import through_splines, through_waves

RATIOS = ("mean_velocity", "temperature", "heat_flux")
"""Of the velocity moments, those that are no densities."""
ENDINGS = ("", "_replica")
"""Of the names of fields: as they are, and of every replica of particles."""


def resample(
    ds: xr.Dataset, nx: int | None = None, nv: int | None = None, velocity_window: tuple[float, float] | None = None
) -> xr.Dataset:
    """The dataset at `nx` uniform places, at the centres of `nv` cells of `velocity_window`; by default its own.

    Of a run over scaled velocities the window is of these.
    ds: of any method, dims (time, x, v) or without v. Totals and all that has neither x nor v stay as they are, and so do the
    moments over x where only v changes. Outside its window f is 0. Standard errors and error bars are interpolated linearly.
    Mean velocity, temperature and heat flux are missing where the nearest of the given ones is.
    Raises SceneError where there are no such axes, or where the numbers make no grid.
    """
    _check(ds, nx, nv, velocity_window)
    result = ds
    if nx is not None:
        grid = PhaseSpaceGrid(nx, 1, _length(ds), 0.0, 1.0)
        result = _along_x(result, grid.x, grid)
    if nv is not None or velocity_window is not None:
        grid = _velocities(ds, nv, velocity_window)
        result = _along_v(result, grid.v, replace(grid, scaled=velocity_axis(ds) == schema.SCALED))
    return result


def at(ds: xr.Dataset, x: ArrayLike | None = None, v: ArrayLike | None = None) -> xr.Dataset:
    """What has x, or v, at any places and velocities, as `resample` finds it; one number takes the dimension away.

    Places are on the periodic pipe. Raises SceneError where the dataset has no such axis, and for numbers that are not finite.
    """
    result = ds
    for name, given in (("x", x), ("v", v)):
        if given is None:
            continue
        places = np.asarray(given, dtype=float)
        if places.ndim > 1 or not np.isfinite(places).all():
            raise SceneError(f"{name} = {given!r}: allowed: a number, or a list of them")
        if ds.sizes.get(velocity_axis(ds) if name == "v" else name, 0) < (1 if name == "x" else 2):
            raise SceneError(f"{name}: the dataset has no such axis; allowed: one with fields over {name}")
        scaled = name == "v" and velocity_axis(ds) == schema.SCALED
        result = (
            in_velocities(result, np.atleast_1d(places))
            if scaled
            else (_along_x if name == "x" else _along_v)(result, np.atleast_1d(places), None)
        )
        result = result[[key for key, field in result.data_vars.items() if name in field.dims]]
        result = result.isel({name: 0}) if places.ndim == 0 else result
    return result


def _check(ds: xr.Dataset, nx: int | None, nv: int | None, window: tuple[float, float] | None) -> None:
    for name, wanted, least in (("nx", nx, 1), ("nv", nv, 2)):
        if wanted is not None and not (isinstance(wanted, int | np.integer) and wanted >= least):
            raise SceneError(f"{name} = {wanted!r}: allowed: a whole number, {least} or more")
    if nx is not None and "x" not in ds.dims:
        raise SceneError("nx: the dataset has no x; allowed: one of this software")
    if (nv is not None or window is not None) and ds.sizes.get(velocity_axis(ds), 0) < 2:
        raise SceneError("nv, velocity_window: the dataset has no velocities; allowed: one with f or w(v)")
    if window is not None and not (len(window) == 2 and -math.inf < window[0] < window[1] < math.inf):
        raise SceneError(f"velocity_window = {window!r}: allowed: two numbers, the smaller one first")


def _along_x(ds: xr.Dataset, places: Array, grid: PhaseSpaceGrid | None) -> xr.Dataset:
    own, length = ds["x"].values, _length(ds)
    waves = through_waves(own, places, length)
    fields: dict[str, xr.DataArray] = {}
    for ending in ENDINGS:
        names = [name + ending for name in ("density", *RATIOS) if name + ending in ds]
        if f"density{ending}" in names and len(names) > 1:
            fields |= _moments({name.removesuffix(ending): ds[name] for name in names}, waves, ending)
    for name, field in ds.data_vars.items():
        if "x" in field.dims and name not in fields and name != "x_bounds":
            linear = str(name).endswith(("_stderr", "_error"))
            near = np.stack([np.interp(places, own, row, period=length) for row in np.eye(own.size)], axis=1)
            matrix = near if linear else waves
            fields[str(name)] = _map(field, "x", lambda a, matrix=matrix: a @ matrix.T)
    return _replaced(ds, fields, "x", places, grid)


def _length(ds: xr.Dataset) -> float:
    if "x_bounds" in ds:
        return float(ds["x_bounds"].values[-1, 1] - ds["x_bounds"].values[0, 0])
    x = ds["x"].values
    if x.size < 2:
        raise SceneError("nx: the dataset has one place and no x_bounds, so that its length is not known")
    return float(x.size * (x[1] - x[0]))


def _moments(m: dict[str, xr.DataArray], waves: Array, ending: str) -> dict[str, xr.DataArray]:
    """ρ, u, θ and q at places, from ρ, ρu, ρ(u² + θ) and ρu³ + 3ρuθ + q there; `waves` is the matrix that interpolates."""
    rho = m["density"].transpose(..., "x").values
    given: dict[str, Array] = {name: m[name].transpose(..., "x").values for name in RATIOS if name in m}
    missing = np.isnan(next(iter(given.values()))) & ~np.isnan(rho)
    u = given.get("mean_velocity", np.zeros_like(rho))
    # Counted from their mean: u² would round θ away where the flow is much faster than the particles within it.
    reference = float(np.nanmean(u)) if np.isfinite(u).any() else 0.0
    u = np.where(missing, 0.0, u - reference)
    theta = np.where(missing, 0.0, given.get("temperature", 0.0))
    q = np.where(missing, 0.0, given.get("heat_flux", 0.0))
    densities = rho, rho * u, rho * (u**2 + theta), rho * u**3 + 3 * rho * u * theta + q
    rho, p, e, flux = (density @ waves.T for density in densities)
    # A missing value has a say in a place where its weight is half of that of all, or more.
    missing = missing @ np.abs(waves).T >= 0.5
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.where(missing, np.nan, p / rho)
        theta = e / rho - u**2
        q = flux - rho * u**3 - 3 * rho * u * theta
    found = {"density": rho, "mean_velocity": u + reference, "temperature": theta, "heat_flux": q}
    return {name + ending: _like(m[name], "x", found[name]) for name in m}


def _velocities(ds: xr.Dataset, nv: int | None, window: tuple[float, float] | None) -> PhaseSpaceGrid:
    own = ds[velocity_axis(ds)].values
    dv = (own[-1] - own[0]) / (own.size - 1)
    low, high = window or (float(own[0] - dv / 2), float(own[-1] + dv / 2))
    count = nv if nv is not None else max(2, round((high - low) / dv))
    return PhaseSpaceGrid(1, int(count), 1.0, low, high)


def _along_v(ds: xr.Dataset, velocities: Array, grid: PhaseSpaceGrid | None) -> xr.Dataset:
    over = velocity_axis(ds)
    own = ds[over].values
    fields: dict[str, xr.DataArray] = {}
    for name, field in ds.data_vars.items():
        if over in field.dims and name != f"{over}_bounds":
            linear = str(name).endswith(("_stderr", "_error"))
            fields[str(name)] = _map(field, over, lambda a, linear=linear: _over_v(own, a, velocities, linear))
    return _replaced(ds, fields, over, velocities, grid)


def _over_v(own: Array, values: Array, v: Array, linear: bool) -> Array:
    """Values (…, len(own)) at the velocities v; 0 outside the window."""
    half = (own[1] - own[0]) / 2
    inside = (v > own[0] - half) & (v < own[-1] + half)
    if linear or own.size < 12:
        matrix = np.stack([np.interp(v[inside], own, row) for row in np.eye(own.size)], axis=1)
    else:
        known = values[np.isfinite(values).all(axis=-1)]
        errors = [np.abs(known[..., ::2] @ way(own[::2], own[1::2]).T - known[..., 1::2]).max(initial=0.0) for way in WAYS]
        matrix = WAYS[int(np.argmin(errors))](own, v[inside])
    result = np.zeros((*values.shape[:-1], v.size))
    result[..., inside] = values @ matrix.T
    return result


def _waves(own: Array, v: Array) -> Array:
    """With the points' cells as the period."""
    return through_waves(own, v, float(own.size * (own[1] - own[0])))


WAYS = (_waves, through_splines)


def _map(field: xr.DataArray, dimension: str, along: Any) -> xr.DataArray:
    return _like(field, dimension, along(np.asarray(field.transpose(..., dimension).values, dtype=float)))


def _like(field: xr.DataArray, dimension: str, values: Array) -> xr.DataArray:
    """The values, whose last axis is `dimension`, with dimensions in the field's order, and its attributes."""
    dims = [str(name) for name in field.dims if name != dimension]
    return xr.DataArray(values, dims=[*dims, dimension], attrs=field.attrs).transpose(*field.dims)


def _replaced(
    ds: xr.Dataset, fields: dict[str, xr.DataArray], dimension: str, points: Array, grid: PhaseSpaceGrid | None
) -> xr.Dataset:
    """The dataset with these fields at these points instead of its own, and the bounds of the grid's cells, where it is one."""
    attrs, order = ds[dimension].attrs, list(ds.data_vars)
    rest = ds.drop_dims(dimension)
    of_cells, more = f"{dimension}_bounds", {}
    if grid is None:
        attrs = {name: value for name, value in attrs.items() if name != "bounds"}
        order = [name for name in order if name != of_cells]
    elif of_cells in ds:
        more = {of_cells: ((dimension, "bounds"), schema.bounds(grid)[of_cells][1])}
    found = rest.assign(fields).assign(more).assign_coords({dimension: (dimension, points, attrs)})
    return found[order]
