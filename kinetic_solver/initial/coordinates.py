"""The places and velocities of an f(x, v) that somebody else wrote, brought to what a run takes: ascending, uniform, one period.

What is the same numbers in another order or from another beginning stays exact. What is not uniform is interpolated (uneven.py),
what is another period is refused. Each change is said. Tests: tests/exact/test_file_coordinates.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.uneven import uniform_in_v, uniform_in_x

UNIFORM = 1e-6
"""Of the distance between two points, by which it may vary, beside what the coordinate's own precision makes of it."""
SAME_PERIOD = 1e-9
"""Relative difference of two periods that are one, for coordinates in double precision."""
DIGITS = 8.0
"""In units of the coordinate's precision: what storing it may have changed of a distance."""
WIDEST_GAP = 2.0
"""Of uneven places: how many times their widest gap the one to the next period may be. With a wider one there is no knowing
whether the period is the scene's. Chosen."""


@dataclass(frozen=True)
class Points:
    """f (nx, nv) over uniform, ascending points of one period; the places are `first` + L/nx·i."""

    f: Array
    first: float
    v: Array
    exact: tuple[str, ...] = ()
    """What was done without changing a number, in words."""
    changed: tuple[str, ...] = ()
    """What was done that leaves f as it was only to the accuracy of an interpolation, or drops some of it."""


def uniform_points(f: Array, x: Array, v: Array, bounds: Array | None, length: float, rtol: float, where: str) -> Points:
    """f (nx, nv) at x (nx,) and v (nv,), as given, on uniform points. `bounds` (nx, 2) are those of the cells, where known.

    Raises SceneError, which begins with `where`, for coordinates that are not numbers, do not go one way, or are of another
    period than `length`; and where f at both ends of a period that is written with both is not the same to rtol.
    """
    exact: list[str] = []
    changed: list[str] = []
    digits = {name: DIGITS * _epsilon(values) for name, values in (("x", x), ("v", v))}
    x, f = _ascending(x, f, 0, "x", exact, where)
    v, f = _ascending(v, f, 1, "v", exact, where)
    if v.size < 4:
        raise SceneError(f"{where}: has {v.size} velocities; allowed: 4 or more")
    first, f = _one_period(x, f, bounds, length, (rtol, digits["x"]), exact, changed, where)
    if not _uniform(v, digits["v"]):
        old = v.size
        v, f = uniform_in_v(v, f)
        changed.append(f"its {old} velocities are not equally far apart: f is interpolated at {v.size} that are, mass kept")
    return Points(np.ascontiguousarray(f), first, np.linspace(v[0], v[-1], v.size), tuple(exact), tuple(changed))


def _epsilon(values: Array) -> float:
    return float(np.finfo(values.dtype if values.dtype.kind == "f" else float).eps)


def _ascending(points: Array, f: Array, axis: int, name: str, exact: list[str], where: str) -> tuple[Array, Array]:
    if points.ndim != 1 or points.dtype.kind not in "fiu":
        raise SceneError(f"{where}: its coordinate {name} is of type {points.dtype}; allowed: numbers along {name}")
    points = points.astype(float)
    if not np.isfinite(points).all():
        raise SceneError(f"{where}: its coordinate {name} is not finite at {int((~np.isfinite(points)).sum())} of its points")
    gaps = np.diff(points)
    if (gaps < 0).all() and gaps.size:
        exact.append(f"its {name} descends: read from the other end")
        return points[::-1], np.flip(f, axis)
    if not (gaps > 0).all():
        at = int(np.flatnonzero(gaps <= 0)[0])
        raise SceneError(
            f"{where}: its {name} goes neither up nor down all the way ({points[at]:g}, then {points[at + 1]:g}); allowed: "
            "points in their order, each once"
        )
    return points, f


def _uniform(points: Array, digits: float) -> bool:
    if points.size < 3:
        return True
    mean = (points[-1] - points[0]) / (points.size - 1)
    return bool(np.abs(np.diff(points) - mean).max() <= UNIFORM * mean + digits * np.abs(points).max())


def _one_period(
    x: Array,
    f: Array,
    bounds: Array | None,
    length: float,
    tolerances: tuple[float, float],
    exact: list[str],
    changed: list[str],
    where: str,
) -> tuple[float, Array]:
    """(first place, f at uniform places). `tolerances`: rtol of f, and what the precision of x does to a distance."""
    rtol, digits = tolerances

    def same(period: float) -> bool:
        return abs(period - length) <= SAME_PERIOD * length + digits * max(length, float(np.abs(x).max()))

    span, uniform = float(x[-1] - x[0]), _uniform(x, digits)
    period = span * x.size / (x.size - 1) if x.size > 1 else length
    if x.size > 1 and same(span):
        _check_ends(x, f, rtol, where)
        exact.append(f"its last place, x = {x[-1]:g}, is its first one a period on, and left out")
        x, f = x[:-1], f[:-1]
        period = length
    elif bounds is not None and (x.size == 1 or not uniform or same(period)):
        period = float(bounds.max() - bounds.min())  # cells of another period contradict places of this one
    if uniform or bounds is not None:
        if not same(period):
            raise SceneError(f"{where}: its period is {period:.10g}, the scene's {length:.10g}")
        if uniform:
            if x.size > 1 and abs(x[0]) > digits * length:
                exact.append(f"its places begin at x = {x[0]:g}: waves are turned by that much")
            return float(x[0]), f
    gap, widest = length - float(x[-1] - x[0]), float(np.diff(x).max())
    if not 0 < gap <= WIDEST_GAP * widest:
        raise SceneError(
            f"{where}: its uneven places lie from {x[0]:.6g} to {x[-1]:.6g}, which does not fit one period, pipe.length = "
            f"{length:.10g}; allowed: places all over one period, or x_bounds"
        )
    first, even = uniform_in_x(x, f, length)
    changed.append(f"its {x.size} places are not equally far apart: f is interpolated at {len(even)} that are, mass kept")
    return first, even


def _check_ends(x: Array, f: Array, rtol: float, where: str) -> None:
    differs = float(np.abs(f[0] - f[-1]).max() / np.abs(f).max()) if np.any(f) else 0.0
    if differs > rtol:
        raise SceneError(
            f"{where}: its places go from {x[0]:g} to {x[-1]:g}, the same place one period on, where f differs by {differs:.2g} "
            f"of its maximum; allowed: the same f (to accuracy.rtol = {rtol:g}), or the last place left out"
        )
