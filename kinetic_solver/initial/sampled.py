"""f(x, v) from a DataArray: what is between its points, and whether they are enough."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset.scaled import scales_of
from kinetic_solver.dataset.schema import SCALE, SCALED
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.looking import Function, Table
from kinetic_solver.initial.periodic import coefficients, interpolated, tail

if TYPE_CHECKING:
    import xarray as xr

UNIFORM = 1e-6
"""Of the distance between two points, by which it may vary: coordinates that were stored in single precision pass."""
BETWEEN = 4
"""Times denser points on which the interpolant is looked at."""


def from_data_array(given: xr.DataArray, name: str, length: float, rtol: float) -> tuple[Function, Table]:
    """The interpolant, and itself on points in x that begin at 0.

    Raises SceneError where the array is not (x, v) with uniform coordinates, x over one period of any beginning; where f is not
    finite, is negative at or between its points, has not fallen at the edges of v, or is not resolved in v.
    """
    if set(given.dims) == {"x", SCALED} and any(str(name).startswith(SCALE) for name in given.coords):
        s, origin = (float(value) for value in scales_of(given))
        given = (given / s).assign_coords({SCALED: origin + s * given[SCALED]}).rename({SCALED: "v"})
    if set(given.dims) != {"x", "v"}:
        raise SceneError(f"initial = {name}: has dimensions {', '.join(map(str, given.dims))}; allowed: x and v")
    values = given.transpose("x", "v").values
    if values.dtype.kind not in "fiu":
        raise SceneError(f"initial = {name}: is of type {values.dtype}; allowed: real numbers")
    values = values.astype(float)
    if not np.isfinite(values).all():
        raise SceneError(
            f"initial = {name}: f is not finite at {int((~np.isfinite(values)).sum())} of its points; allowed: numbers"
        )
    x, v = (_uniform(given, dim, name, least) for dim, least in (("x", 1), ("v", 8)))
    nx, nv = values.shape
    if nx > 1 and not np.isclose((x[-1] - x[0]) * nx / (nx - 1), length, rtol=1e-6):
        raise SceneError(
            f"initial = {name}: its {nx} places cover {(x[-1] - x[0]) * nx / (nx - 1):.10g}; allowed: one period, "
            f"pipe.length = {length:.10g}"
        )
    dv = (v[-1] - v[0]) / (nv - 1)
    low, high = float(v[0] - dv / 2), float(v[-1] + dv / 2)
    # exp(-ik x_0): the first place need not be 0.
    along_x = coefficients(values) * np.exp(-2j * np.pi / length * x[0] * np.arange(nx // 2 + 1))[:, None]

    def f(places: Array, velocities: Array) -> Array:
        there = interpolated(along_x, places, length)
        if velocities.shape == v.shape and np.allclose(velocities, v, rtol=0.0, atol=1e-12 * (high - low)):
            return there
        inside = (velocities > low) & (velocities < high)
        found = interpolated(coefficients(there.T), velocities[inside] - v[0], high - low)
        out = np.zeros((places.size, velocities.size))
        out[:, inside] = found.T
        return out

    table = Table(f(length * np.arange(nx) / nx, v), low, high, (low, high))
    _check(f, table, name, length, rtol)
    return f, table


def _uniform(given: xr.DataArray, dim: str, name: str, least: int) -> Array:
    if dim not in given.coords:
        raise SceneError(f"initial = {name}: has no coordinate {dim}; allowed: a DataArray with coordinates x and v")
    points = np.asarray(given[dim].values, dtype=float)
    if points.size < least:
        raise SceneError(f"initial = {name}: has {points.size} points in {dim}; allowed: {least} or more")
    if points.size > 1:
        mean = (points[-1] - points[0]) / (points.size - 1)
        if not (mean > 0 and np.abs(np.diff(points) - mean).max() <= UNIFORM * mean):
            raise SceneError(f"initial = {name}: its {dim} is not uniform; allowed: equally spaced, ascending points")
    return points


def _check(f: Function, table: Table, name: str, length: float, rtol: float) -> None:
    """To rtol, which is what the last frame of another run to the same rtol keeps."""
    nx, nv = table.f.shape
    top = float(table.f.max())
    if not top > 0:
        raise SceneError(f"initial = {name}: f is nowhere positive; allowed: some f > 0")
    edge = float(np.abs(table.f[:, [0, -1]]).max()) / top
    if edge > rtol:
        raise SceneError(
            f"initial = {name}: f has not ended at the edges of v from {table.v[0]:.4g} to {table.v[-1]:.4g}, {edge:.2g} of its "
            f"maximum is left; allowed: accuracy.rtol = {rtol:g}; give more velocities, or raise it"
        )
    if (missing := tail(table.f, 1)) > rtol:
        raise SceneError(
            f"initial = {name}: {nv} velocities do not resolve f (its shortest waves carry {missing:.2g} of it); allowed: "
            f"accuracy.rtol = {rtol:g}; give more points, or raise it"
        )
    between = f(length * np.arange(nx) / nx, np.linspace(table.v[0], table.v[-1], BETWEEN * nv))
    between_x = f(length * np.arange(BETWEEN * nx) / (BETWEEN * nx), table.v)
    least = min(float(table.f.min()), float(between.min()), float(between_x.min())) / top
    if least < -rtol:
        raise SceneError(
            f"initial = {name}: f is negative at its points, or between them, by {-least:.2g} of its maximum; allowed: "
            f"accuracy.rtol = {rtol:g}; give more points, or raise it"
        )
