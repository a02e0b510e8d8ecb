"""Where a function f(x, v) has its velocities, and how many points resolve it: found by looking at it.

Nothing is known of the function but its values. What lies between all points that are looked at is missed: parts of f narrower
than a four-thousandth of the pipe, or of the velocities looked at first. `grid.velocity_window` says where to look instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.periodic import amplitudes, tail

Function = Callable[[Array, Array], Array]
"""f(x, v) for x (nx,) and v (nv,), shape (nx, nv)."""

WIDER, TRIES = 8.0, 7
"""How many times wider the next window to look at is, and how often one is looked at. Chosen."""
PLACES, VELOCITIES, SOME = 64, 4096, 256
"""At so many places, besides those where it is largest, and at so many velocities f is looked at until its window is known; the
third, at how many velocities to find out how many places resolve it. Chosen."""
EDGE = 40.0
"""A window ends where f has fallen to rtol over this, as those of Maxwellians do (plan/scales.py)."""
DROPPED = 10.0
"""f is resolved where its shortest waves are rtol over this (plan/waves.py)."""
MOST_IN_X, MOST_IN_V = 4096, 16384
"""Points: more are asked for by functions with jumps, which no number of points resolves."""
MOST_IN_ALL = 2**24
"""Points: 128 MiB of f."""
MARGIN = 0.05
"""Of its width, by which a window that was found is wider than f: so a jump at an end of f is seen as one. Chosen."""
SAME = 1e-13
"""Of max f: what differs less along x is the same. Rounding of functions of x and v."""


@dataclass(frozen=True)
class Table:
    """f at uniform places from 0, and at the centres of velocity cells."""

    f: Array
    """(nx, nv)."""
    low: float
    high: float
    ends: tuple[float, float]
    """Between which f is more than rtol/40 of its maximum."""

    @property
    def dv(self) -> float:
        return (self.high - self.low) / self.f.shape[1]

    @property
    def v(self) -> Array:
        return centres(self.low, self.high, self.f.shape[1])


def centres(low: float, high: float, count: int) -> Array:
    return low + (high - low) / count * (np.arange(count) + 0.5)


def look(f: Function, name: str, length: float, first: tuple[float, float], rtol: float) -> Table:
    """f on as many points as resolve it to rtol/10, in a window beyond which it is below rtol/40 of its maximum. `first` is
    looked at first; wider windows are about its middle.

    Raises SceneError where there is no such window, or more points would be needed than `MOST_IN_X` or `MOST_IN_V`.
    """
    places = length * np.arange(MOST_IN_X) / MOST_IN_X
    highest = f(places, np.linspace(*first, PLACES)).argmax(axis=0)
    few = np.union1d(places[:: MOST_IN_X // PLACES], places[highest])
    ends = _ends(f, name, few, first, rtol)
    margin = MARGIN * (ends[1] - ends[0])
    low, high = ends[0] - margin, ends[1] + margin
    nx = _places(f, name, length, centres(low, high, SOME), rtol)
    nv = 64
    while True:
        if nx * nv > MOST_IN_ALL:
            raise SceneError(
                f"initial = {name}: {nx} places times {nv} velocities would be needed to hold f; allowed: {MOST_IN_ALL} points; "
                "raise accuracy.rtol"
            )
        whole = f(length * np.arange(nx) / nx, centres(low, high, nv))
        if (missing := tail(whole, 1)) <= rtol / DROPPED:
            return _whole(Table(whole, low, high, ends), name, rtol)
        nv *= 2
        if nv > MOST_IN_V:
            raise SceneError(
                f"initial = {name}: {MOST_IN_V} velocities from {low:.4g} to {high:.4g} do not resolve f (its shortest waves "
                f"carry {missing:.2g} of it, accuracy.rtol = {rtol:g}); allowed: a smooth f, or a larger accuracy.rtol"
            )


def _places(f: Function, name: str, length: float, v: Array, rtol: float) -> int:
    """nx: from the spectrum on as many places as there may be, where nothing that matters is overlooked."""
    dense = f(length * np.arange(MOST_IN_X) / MOST_IN_X, v)
    if np.abs(dense - dense[0]).max() <= SAME * dense.max():
        return 1
    if (missing := tail(dense, 0)) > rtol / DROPPED:
        raise SceneError(
            f"initial = {name}: {MOST_IN_X} places do not resolve f (its shortest waves along x carry {missing:.2g} of it, "
            f"accuracy.rtol = {rtol:g}); allowed: a smooth f of the period pipe.length = {length:g}, or a larger rtol"
        )
    waves = int(np.flatnonzero(amplitudes(dense, 0) > rtol / DROPPED)[-1])
    nx = 32
    while 7 * nx < 16 * waves:  # the highest eighth of the waves is below rtol/10
        nx *= 2
    return min(nx, MOST_IN_X)


def _ends(f: Function, name: str, x: Array, first: tuple[float, float], rtol: float) -> tuple[float, float]:
    """Wider and wider about the middle until f has fallen at both edges, then narrower until it has nowhere fallen before."""
    middle, reach = (first[0] + first[1]) / 2, (first[1] - first[0]) / 2
    for _ in range(TRIES):
        v = middle + reach * np.linspace(-1, 1, VELOCITIES)
        top = f(x, v).max(axis=0)
        if top.max() > 0 and max(top[0], top[-1]) <= rtol / EDGE * top.max():
            break
        reach *= WIDER
    else:
        what = "is 0 at all" if not top.max() > 0 else f"does not fall below rtol/{EDGE:g} of its maximum at the"
        raise SceneError(
            f"initial = {name}: f {what} velocities from {v[0]:.3g} to {v[-1]:.3g}; allowed: an f that ends, or a given "
            "grid.velocity_window"
        )
    while True:
        held = np.flatnonzero(top > rtol / EDGE * top.max())
        low, high = float(v[max(0, held[0] - 1)]), float(v[min(v.size - 1, held[-1] + 1)])
        if high - low > 0.9 * (v[-1] - v[0]):
            return float(v[0]), float(v[-1])
        v = np.linspace(low, high, VELOCITIES)
        top = f(x, v).max(axis=0)


def _whole(table: Table, name: str, rtol: float) -> Table:
    """Raises SceneError where f is negative."""
    least, most = float(table.f.min()), float(table.f.max())
    if least < -rtol / DROPPED * most:
        raise SceneError(
            f"initial = {name}: f is negative, {-least / most:.2g} of its maximum; allowed: 0 or more, but for "
            f"accuracy.rtol/{DROPPED:g} = {rtol / DROPPED:g}"
        )
    return table
