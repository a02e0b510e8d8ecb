"""f(x, v) from a DataArray: what is between its points, and whether they are enough."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset.scaled import scales_of
from kinetic_solver.dataset.schema import SCALE, SCALED
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.looking import EDGE, Function, Table
from kinetic_solver.initial.periodic import coefficients, interpolated, tail
from kinetic_solver.interpolation import SAME_POINT, through_splines

if TYPE_CHECKING:
    import xarray as xr

RESOLVED = 3.0
"""Of rtol, that the shortest waves in v may carry: they exceed the error that they show by as much, and runs allow it to the f
that they write (solver/monitor.py, OVERRATED)."""
UNIFORM = 1e-6
"""Of the distance between two points, by which it may vary: coordinates that were stored in single precision pass."""
LOG_DEGREE, TAIL = 7, 1e3
"""Of splines of log f, and one over their relative error. Measured: 1e-4 to 1e-2 on the points of runs with (6)."""
ROUND_OFF = 1e-15
"""Of max f, by which the trigonometric interpolant errs at least."""
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
    nx = values.shape[0]
    if nx > 1 and not np.isclose((x[-1] - x[0]) * nx / (nx - 1), length, rtol=1e-6):
        raise SceneError(
            f"initial = {name}: its {nx} places cover {(x[-1] - x[0]) * nx / (nx - 1):.10g}; allowed: one period, "
            f"pipe.length = {length:.10g}"
        )
    f, table = between_points(values, float(x[0]), v, length, rtol)
    check(f, table, name, length, rtol)
    return f, table


def between_points(
    values: Array, first: float, v: Array, length: float, rtol: float, by_splines: bool = False
) -> tuple[Function, Table]:
    """f from `values` (nx, nv) at uniform places from `first` and uniform velocities v, and itself on places that begin at 0.

    Its velocities are taken as they are where they are asked for; between them is the trigonometric interpolant, or cubic
    splines, which do not ring where the points are few. Beyond them f is 0.
    """
    nx, nv = values.shape
    dv, own = (v[-1] - v[0]) / (nv - 1), first + length / nx * np.arange(nx)
    low, high = float(v[0] - dv / 2), float(v[-1] + dv / 2)
    # exp(-ik x_0): the first place need not be 0.
    along_x = coefficients(values) * np.exp(-2j * np.pi / length * first * np.arange(nx // 2 + 1))[:, None]

    def f(places: Array, velocities: Array) -> Array:
        same = places.shape == own.shape and np.allclose(places, own, rtol=0.0, atol=SAME_POINT * length / nx)
        there = values if same else interpolated(along_x, places, length)
        # Operator (6) amplifies the slow tail, in which an interpolant is no better than rounding of max f.
        nearest = np.rint((velocities - v[0]) / dv).astype(int)
        inside = (velocities > low) & (velocities < high)
        known = inside & (np.abs(velocities - v[0] - nearest * dv) <= SAME_POINT * dv)
        other = inside & ~known
        out = np.zeros((places.size, velocities.size))
        out[:, known] = there[:, nearest[known]]
        if by_splines and other.any():
            out[:, other] = there @ through_splines(v, np.clip(velocities[other], v[0], v[-1]), degree=3).T
        elif other.any():
            waves = interpolated(coefficients(there.T), velocities[other] - v[0], high - low).T
            out[:, other] = _with_tails(waves, there, v, velocities[other])
        return out

    known = f(length * np.arange(nx) / nx, v)
    return f, Table(known, low, high, _ends(known, low, dv, rtol))


def _with_tails(waves: Array, f: Array, v: Array, velocities: Array) -> Array:
    """The interpolant `waves` of f (nx, nv), with splines of log f where f is so small that their relative error is the less.

    The one errs by a share of max f, which (6) amplifies in the slow tail. f that is not positive has no logarithm, nor tails
    that are better than that.
    """
    if v.size <= LOG_DEGREE or not f.min() > 0:
        return waves
    inside = np.clip(velocities, v[0], v[-1])
    logs = np.exp(np.log(f) @ through_splines(v, inside, degree=LOG_DEGREE).T)
    small = TAIL * max(tail(f, 1), ROUND_OFF) * f.max()
    return np.where(logs < small, logs, waves)


def _ends(f: Array, low: float, dv: float, rtol: float) -> tuple[float, float]:
    """The edges of the cells between which f (nx, nv) is more than rtol/EDGE of its maximum."""
    top = f.max(axis=0)
    held = np.flatnonzero(top > rtol / EDGE * top.max())
    first, last = (int(held[0]), int(held[-1])) if held.size else (0, f.shape[1] - 1)
    return low + max(0, first - 1) * dv, low + min(f.shape[1], last + 2) * dv


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


def check(f: Function, table: Table, name: str, length: float, rtol: float) -> None:
    """Whether f has ended in v, is resolved and nowhere negative, to what the last frame of another run to the same rtol keeps.
    Raises SceneError."""
    nx, nv = table.f.shape
    top = float(table.f.max())
    if not top > 0:
        raise SceneError(f"initial = {name}: f is nowhere positive; allowed: some f > 0")
    edge = float(np.abs(table.f[:, [0, -1]]).max()) / top
    if edge > rtol:
        raise SceneError(
            f"initial = {name}: f has not ended at the edges of v from {table.v[0]:.4g} to {table.v[-1]:.4g}, {edge:.2g} of its "
            f"maximum is left; allowed: more velocities, or accuracy.rtol = {_at_least(edge)} or more"
        )
    if (missing := tail(table.f, 1)) > RESOLVED * rtol:
        raise SceneError(
            f"initial = {name}: {nv} velocities do not resolve f (its shortest waves carry {missing:.2g} of it); allowed: "
            f"denser velocities, or accuracy.rtol = {_at_least(missing / RESOLVED)} or more"
        )
    between = f(length * np.arange(nx) / nx, np.linspace(table.v[0], table.v[-1], BETWEEN * nv))
    between_x = f(length * np.arange(BETWEEN * nx) / (BETWEEN * nx), table.v)
    least = min(float(table.f.min()), float(between.min()), float(between_x.min())) / top
    if least < -rtol:
        raise SceneError(
            f"initial = {name}: f is negative at its points, or between them, by {-least:.2g} of its maximum; allowed: "
            f"0 or more there, as of denser points, or accuracy.rtol = {_at_least(-least)} or more"
        )


def _at_least(value: float) -> str:
    """In two digits, of no less than the value."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / digit) * digit:.2g}"
