"""Particles drawn from a start, so many at once that a run can be stopped meanwhile: `Maxwellians` of a scene, or any f(x, v).

Of an f(x, v) the place is drawn by the inverse of the marginal in x, the velocity by that of the conditional in v.

f is tabulated once, on points so dense that what is between them adds 4e-5 of its variance to the narrowest part of f: a tenth of
what ten million particles can tell. Between two places of the table f is linear in x, so a particle takes its velocity from one
of the two, by chance. The numbers are counted (random.py): the same particles for any number
of threads.
Tests: tests/cross_validation/particles/test_starts.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.initial import GivenStart
from kinetic_solver.scene import Scene
from particles.random import PARTS, POSITIONS, VELOCITIES, standard_normals, uniforms
from particles.threads import over_particles

FINER_IN_X, FINER_IN_V = 16, 64
"""Points of the table: times those that resolve f along x, and to a standard deviation of its narrowest part. Cells of width dv
in which velocities are spread evenly add dv²/6 to their variance, a linear interpolant takes (k dx)²/12 from a wave. Chosen."""
MOST_PLACES, MOST_POINTS = 4096, 2**24
"""Of the table: 128 MiB of it."""
MARGINAL = 2**17
"""Places at which ∫ρ0 dx is tabulated: 1e-9 of the pipe's length."""


AT_ONCE = 2**20
"""Particles between two looks at whether to stop. Chosen: a tenth of a second."""


class Drawn(Protocol):
    """What independent particles can be drawn from."""

    def fill(self, x: Array, v: Array, first: int, key: NDArray[np.uint64]) -> None:
        """x in [0, length) and v, (n,) each, of the particles from `first` on."""


def draw(start: Drawn, count: int, keys: Sequence[NDArray[np.uint64]], look: Callable[[], None]) -> Iterator[tuple[Array, Array]]:
    """x and v (count,) of one replica after another. `look` is called after every `AT_ONCE` particles, and may raise."""
    since = 0
    for key in keys:
        x, v = np.empty(count), np.empty(count)
        for first in range(0, count, AT_ONCE):
            if since >= AT_ONCE:
                look()
                since = 0
            part = slice(first, min(first + AT_ONCE, count))
            start.fill(x[part], v[part], first, key)
            since += part.stop - first
        yield x, v


class Maxwellians:
    """Those of a scene's [initial]: positions by the inverse of ∫ρ0, to 1e-9 of the pipe's length."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.length = scene, scene.pipe.length
        self._places = self.length * np.linspace(0, 1, MARGINAL + 1)
        swept = initial.density_integral(scene, self._places)
        self._swept = swept / swept[-1]
        self._shares, self._means, self._temperatures = np.array(initial.beams(scene)).T

    def fill(self, x: Array, v: Array, first: int, key: NDArray[np.uint64]) -> None:
        scene, start, normals = self._scene, self._scene.initial, np.empty((x.size, 2))
        uniforms(x, POSITIONS, np.uint64(0), key[0], key[1], first)
        standard_normals(normals, VELOCITIES, np.uint64(0), key[0], key[1], first)
        if start.step is not None or start.pulse is not None or start.modes:
            x[:] = np.interp(x, self._swept, self._places)
        else:
            x *= self.length
        x[x >= self.length] = 0.0
        beam = np.zeros(x.size, dtype=np.int64)
        if self._shares.size > 1:
            uniforms(v, PARTS, np.uint64(0), key[0], key[1], first)
            beam = np.searchsorted(np.cumsum(self._shares)[:-1], v, side="right")
        theta = initial.temperature(scene, x, 1.0) * self._temperatures[beam]
        v[:] = initial.mean_velocity(scene, x, 0.0) + self._means[beam] + np.sqrt(theta) * normals[:, 0]


class Tabulated:
    """An f(x, v) of one's own, by its tables."""

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

    def fill(self, x: Array, v: Array, first: int, key: NDArray[np.uint64]) -> None:
        part = np.empty(x.size)
        uniforms(x, POSITIONS, np.uint64(0), key[0], key[1], first)
        uniforms(part, PARTS, np.uint64(0), key[0], key[1], first)
        uniforms(v, VELOCITIES, np.uint64(0), key[0], key[1], first)
        x[:] = np.interp(x, self._swept, self._places)
        x[x >= self.length] = 0.0
        tables = self._density, self._cumulative, self.length, self._low, self._dv
        over_particles(lambda of: _velocities(x[of], part[of], v[of], *tables), x.size)


@numba.njit(nogil=True, cache=True)
def _velocities(x, part, v, density, cumulative, length, low, dv):  # type: ignore[no-untyped-def]
    """Replace v, uniform numbers in [0, 1), by velocities at the places x; `part` are other such numbers."""
    places = density.size
    for i in range(x.size):
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
