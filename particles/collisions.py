"""Binary collisions of particles in the same cell by direct-simulation Monte Carlo (G. A. Bird 1994), for operators (6) and (12).

Any two particles of a cell of width Δx collide at the rate S w |v - v'|/Δx, w the number of real particles that each stands
for: the quadrature of (6) and (12) over the cell. Candidate pairs are a Poisson process of the majorant rate, in which
|v - v'| is replaced by the range of velocities in the cell, and are accepted with probability |v - v'|/range. Neither operator
widens that range, so the majorant holds all through the step: no bias, at any length of step.
Tests: tests/cross_validation/particles/test_collisions.py.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from particles.random import COLLISIONS, unit, words

FOLLOW = -1.0
"""In the place of a restitution coefficient: the faster particle takes the velocity of the slower, operator (6)."""


DRAWS = 2**24
"""Of one cell in one step, that a counter tells apart."""


def collide(
    v: Array,
    starts: NDArray[np.int64],
    rate: float,
    restitution: float,
    number: int,
    key: NDArray[np.uint64],
    tally: NDArray[np.int64],
) -> None:
    """Collisions over one step, in place: v (n,) sorted by cells, `starts` (cells + 1,).

    `rate` is S w h/Δx for the step h: the mean number of collisions of a pair, per |v - v'|. `restitution` is ε of (12), or
    `FOLLOW`. `tally` (cells, 2) receives candidates and collisions of each cell. (12) conserves momentum to round-off.
    Raises SolverStopped where a cell needs more draws than the generator's counter has.
    """
    _collide(v, starts, rate, restitution, np.uint64(number), key[0], key[1], tally)
    if tally[:, 0].max() >= DRAWS:
        raise SolverStopped(
            f"step {number}: more than {DRAWS} candidate pairs in a cell; raise particles.cells or reduce particles.time_step"
        )


@numba.njit(parallel=True, cache=True)
def _collide(v, starts, rate, restitution, step, k0, k1, tally):  # type: ignore[no-untyped-def]
    for cell in numba.prange(starts.size - 1):
        first, n = starts[cell], starts[cell + 1] - starts[cell]
        tally[cell, 0] = tally[cell, 1] = 0
        if n < 2:
            continue
        low = high = v[first]
        for i in range(first + 1, first + n):
            low, high = min(low, v[i]), max(high, v[i])
        width = high - low
        expected = 0.5 * n * (n - 1) * rate * width
        elapsed, draw = 0.0, 0
        while True:
            a, b, c, d = words(COLLISIONS, cell, step, draw, k0, k1)
            elapsed -= math.log(unit(d))
            if not elapsed <= expected or draw == DRAWS:  # NaN ends it too
                break
            draw += 1
            i = np.int64((a * np.uint64(n)) >> np.uint64(32))
            j = np.int64((b * np.uint64(n - 1)) >> np.uint64(32))
            j += j >= i
            u, w = v[first + i], v[first + j]
            if unit(c) * width < abs(u - w):
                tally[cell, 1] += 1
                if restitution < 0.0:
                    v[first + i] = v[first + j] = min(u, w)
                else:
                    middle, half = 0.5 * (u + w), 0.5 * restitution * (u - w)
                    v[first + i], v[first + j] = middle - half, middle + half
        tally[cell, 0] = draw
