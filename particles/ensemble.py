"""N particles as arrays, kept in the order of the cells they are in.

Cells are of equal width. The order within a cell is that of arrival, and blocks of particles are counted apart and fixed in
number, so that the order after a sort does not depend on threads. Nothing is allocated after the ensemble is built: 36 bytes a
particle, and 8 a cell and block.
Tests: tests/cross_validation/particles/test_ensemble.py.
"""

from __future__ import annotations

from dataclasses import astuple

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from particles.langevin import LangevinStep, advance, move
from particles.random import BLOCK, LANGEVIN, normals, scratch
from particles.threads import over_particles

BLOCKS = 64
"""At most; fewer where cells hold few particles, so that the blocks' counts take at most 8 bytes a particle, and where fewer than
`FEWEST` particles would be in each."""
FEWEST = 32 * BLOCK
"""So many that what a block costs beside its particles is nothing."""


def blocks_of(count: int, cells: int) -> int:
    return max(2, min(BLOCKS, count // cells, count // FEWEST))


def memory(count: int, cells: int) -> int:
    """Bytes."""
    return 36 * count + 8 * (blocks_of(count, cells) + 1) * cells


class Ensemble:
    """Positions x in [0, length) and velocities v, shape (n,). After a sort `starts` (cells + 1,) says where each cell begins.

    Takes over the arrays it is given. Raises SolverStopped in a step after which a place or a velocity is not finite.
    """

    def __init__(self, x: Array, v: Array, length: float, cells: int) -> None:
        self.length, self.cells = length, cells
        self.x, self.v = np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(v, dtype=float)
        self._other_x, self._other_v = np.empty_like(self.x), np.empty_like(self.v)
        self._cell = np.empty(self.x.size, dtype=np.int32)
        self._counts = np.empty((blocks_of(self.x.size, cells), cells), dtype=np.int64)
        self.starts: NDArray[np.int64] = np.empty(cells + 1, dtype=np.int64)

    @property
    def count(self) -> int:
        return int(self.x.size)

    def count_cells(self) -> None:
        """`starts` of particles that lie in the order of their cells already."""
        cell = np.minimum((self.x * (self.cells / self.length)).astype(np.int32), self.cells - 1)
        self.starts[0] = 0
        np.cumsum(np.bincount(cell, minlength=self.cells), out=self.starts[1:])

    def advance(self, step: LangevinStep, number: int, key: NDArray[np.uint64]) -> None:
        """The Langevin step, without sorting."""
        if advance(self.x, self.v, self.length, astuple(step), np.uint64(number), key[0], key[1]) > 0:
            raise _lost(number)

    def advance_and_sort(self, step: LangevinStep, number: int, key: NDArray[np.uint64]) -> None:
        """The same, after which particles lie in the order of their cells."""
        arrays, coefficients, lost = (self.x, self.v, self._cell, self._counts), astuple(step), []

        def move(blocks: slice) -> None:
            args = (self.length, coefficients, np.uint64(number), key[0], key[1], blocks.start, blocks.stop)
            lost.append(_advance_and_count(*arrays, *args))

        over_particles(move, self.count, len(self._counts))
        if sum(lost) > 0:
            raise _lost(number)
        _places(self._counts, self.starts)
        others = self._other_x, self._other_v
        over_particles(lambda blocks: _scatter(*arrays, *others, blocks.start, blocks.stop), self.count, len(self._counts))
        self.x, self._other_x = self._other_x, self.x
        self.v, self._other_v = self._other_v, self.v


def _lost(number: int) -> SolverStopped:
    return SolverStopped(
        f"step {number}: places or velocities of particles are not finite; reduce what [model] or [initial] gives"
    )


@numba.njit(nogil=True, cache=True)
def _advance_and_count(x, v, cell, counts, length, coefficients, step, k0, k1, begin, stop):  # type: ignore[no-untyped-def]
    """One Langevin step in place; the new cell of each particle; counts (blocks, cells) of them: of blocks from `begin` up to
    `stop`. Returns as `move` does."""
    blocks, cells = counts.shape
    per_length = cells / length
    bits, deviates = scratch()
    lost = 0
    for b in range(begin, stop):
        counts[b] = 0
        end = (b + 1) * x.size // blocks
        for first in range(b * x.size // blocks, end, BLOCK):
            last = min(first + BLOCK, end)
            normals(deviates, bits, LANGEVIN, first, step, k0, k1)
            lost += move(x[first:last], v[first:last], length, coefficients, deviates)
            for i in range(first, last):
                place = x[i] if x[i] >= 0.0 else 0.0  # NaN has no cell
                cell[i] = min(np.int32(place * per_length), np.int32(cells - 1))
            for i in range(first, last):
                counts[b, cell[i]] += 1
    return lost


@numba.njit(cache=True)
def _places(counts, starts):  # type: ignore[no-untyped-def]
    """Counts become the place at which a block's first particle of a cell goes; cells in order, blocks in order within one."""
    total = 0
    for c in range(counts.shape[1]):
        starts[c] = total
        for b in range(counts.shape[0]):
            n = counts[b, c]
            counts[b, c] = total
            total += n
    starts[counts.shape[1]] = total


@numba.njit(nogil=True, cache=True)
def _scatter(x, v, cell, places, new_x, new_v, begin, stop):  # type: ignore[no-untyped-def]
    """Of blocks from `begin` up to `stop`."""
    blocks = places.shape[0]
    for b in range(begin, stop):
        for i in range(b * x.size // blocks, (b + 1) * x.size // blocks):
            place = places[b, cell[i]]
            places[b, cell[i]] = place + 1
            new_x[place] = x[i]
            new_v[place] = v[i]
