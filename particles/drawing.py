"""Particles drawn from an f(x, v): the place by the inverse of the marginal in x, the velocity by that of the conditional in v.

f is tabulated once, on points so dense that what is between them adds 4e-5 of its variance to the narrowest part of f: a tenth of
what ten million particles can tell. Between two places of the table f is linear in x, so a particle takes its velocity from one
of the two, by chance. The numbers are counted (random.py): the same particles for any number
of threads.
Tests: tests/cross_validation/particles/test_starts.py.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.initial import GivenStart
from particles.random import PARTS, POSITIONS, VELOCITIES, uniforms

FINER_IN_X, FINER_IN_V = 16, 64
"""Points of the table: times those that resolve f along x, and to a standard deviation of its narrowest part. Cells of width dv
in which velocities are spread evenly add dv²/6 to their variance, a linear interpolant takes (k dx)²/12 from a wave. Chosen."""
MOST_PLACES, MOST_POINTS = 4096, 2**24
"""Of the table: 128 MiB of it."""
MARGINAL = 2**17
"""Places at which ∫ρ0 dx is tabulated: 1e-9 of the pipe's length."""


class Drawing:
    """The tables of one start."""

    def __init__(self, start: GivenStart) -> None:
        self.length = length = start.length
        low, high = start.window
        nv = math.ceil(FINER_IN_V * (high - low) / math.sqrt(start.narrowest(np.zeros(1))))
        nx = 1 if start.homogeneous else min(MOST_PLACES, FINER_IN_X * start.table.f.shape[0])
        while nx * nv > MOST_POINTS and nx > 2 * start.table.f.shape[0]:
            nx //= 2
        self._dv, self._low = (high - low) / nv, low
        x = length * np.arange(nx) / nx
        # The interpolant of an array may dip below 0 by as little as was allowed at the door: nothing is drawn there.
        f = np.maximum(start.distribution(x, low + self._dv * (np.arange(nv) + 0.5)), 0.0)
        self._density = f.sum(axis=1)
        # Where there are no particles none is drawn, but for rounding: then with a velocity from anywhere.
        f[self._density == 0] = f.mean(axis=0)
        self._cumulative = np.zeros((nx, nv + 1))
        np.cumsum(f, axis=1, out=self._cumulative[:, 1:])
        self._cumulative /= self._cumulative[:, -1:]
        self._places = length * np.linspace(0, 1, MARGINAL + 1)
        swept = start.density_integral(self._places[:-1])
        # Rounding, and the dips, must not make it fall.
        self._swept = np.maximum.accumulate(np.append(swept, start.mean_density * length)) / (start.mean_density * length)

    def draw(self, count: int, key: NDArray[np.uint64]) -> tuple[Array, Array]:
        """x in [0, length) and v of independent particles, (count,) each."""
        x, part, v = np.empty(count), np.empty(count), np.empty(count)
        uniforms(x, POSITIONS, np.uint64(0), key[0], key[1])
        uniforms(part, PARTS, np.uint64(0), key[0], key[1])
        uniforms(v, VELOCITIES, np.uint64(0), key[0], key[1])
        x = np.interp(x, self._swept, self._places)
        x[x >= self.length] = 0.0
        _velocities(x, part, v, self._density, self._cumulative, self.length, self._low, self._dv)
        return x, v


@numba.njit(parallel=True, cache=True)
def _velocities(x, part, v, density, cumulative, length, low, dv):  # type: ignore[no-untyped-def]
    """Replace v, uniform numbers in [0, 1), by velocities at the places x; `part` are other such numbers."""
    places = density.size
    for i in numba.prange(x.size):
        place = x[i] / length * places
        row = min(int(place), places - 1)
        after = (row + 1) % places
        here, there = (1.0 - (place - row)) * density[row], (place - row) * density[after]
        if part[i] * (here + there) >= here and there > 0.0:
            row = after
        sums = cumulative[row]
        first, last = 0, sums.size - 1
        while last - first > 1:
            middle = (first + last) // 2
            if sums[middle] <= v[i]:
                first = middle
            else:
                last = middle
        v[i] = low + dv * (first + (v[i] - sums[first]) / (sums[last] - sums[first]))
