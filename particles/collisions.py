"""Binary collisions of particles in the same cell by direct-simulation Monte Carlo (G. A. Bird 1994), for any law of pairs.

Any two particles of a cell of width Δx collide at the rate S w |v - v'|/Δx, w the number of real particles that each stands
for: the quadrature of the law over the cell. Candidate pairs are a Poisson process of the majorant rate, in which
|v - v'| is replaced by the range of velocities in the cell, and are accepted with probability |v - v'|/range. No law of pairs
widens that range (laws/checks.py), so the majorant holds all through the step: no bias, at any length of step.
Tests: tests/cross_validation/particles/test_collisions.py.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.laws import PairLaw
from particles.random import COLLISIONS, unit, words
from particles.specialised import specialised
from particles.threads import over_particles

DRAWS = 2**24
"""Of one cell in one step, that a counter tells apart."""


def collide(
    v: Array,
    starts: NDArray[np.int64],
    rate: float,
    law: PairLaw,
    number: int,
    key: NDArray[np.uint64],
    tally: NDArray[np.int64],
) -> None:
    """Collisions over one step, in place: v (n,) sorted by cells, `starts` (cells + 1,).

    `rate` is S w h/Δx for the step h: the mean number of collisions of a pair, per |v - v'|. `tally` (cells, 2) receives
    candidates and collisions of each cell. What the law conserves is so to round-off.
    Raises SolverStopped where a cell needs more draws than the generator's counter has.
    """
    kind: Any = type(law)
    kernel, args = _kernel(kind), (v, starts, rate, law.numbers, np.uint64(number), key[0], key[1], tally)
    over_particles(lambda cells: kernel(*args, cells.start, cells.stop), v.size, starts.size - 1)
    if tally[:, 0].max() >= DRAWS:
        raise SolverStopped(
            f"step {number}: more than {DRAWS} candidate pairs in a cell; raise particles.cells or reduce particles.time_step"
        )


after: Any = None
"""Of the law (laws/law.py): bound by `specialised`."""


def _of_a_cell(v, first, n, rate, numbers, cell, step, k0, k1):  # type: ignore[no-untyped-def]
    """(candidates, collisions) of the particles from `first` on."""
    low = high = v[first]
    for i in range(first + 1, first + n):
        low, high = min(low, v[i]), max(high, v[i])
    width = high - low
    expected = 0.5 * n * (n - 1) * rate * width
    elapsed, draw, collisions = 0.0, 0, 0
    while True:
        a, b, c, d = words(COLLISIONS, cell, step, draw, k0, k1)
        elapsed -= math.log(unit(d))
        if not elapsed <= expected or draw == DRAWS:  # NaN ends it too
            return draw, collisions
        draw += 1
        i = np.int64((a * np.uint64(n)) >> np.uint64(32))
        j = np.int64((b * np.uint64(n - 1)) >> np.uint64(32))
        j += j >= i
        fast, slow = first + i, first + j
        if v[fast] < v[slow]:
            fast, slow = slow, fast
        r = v[fast] - v[slow]
        if unit(c) * width < r:
            collisions += 1
            # The one that came from behind is the one left behind.
            behind, ahead = after(r, *numbers)
            base = v[slow]
            v[fast], v[slow] = base + behind, base + ahead


def _cells(v, starts, rate, numbers, step, k0, k1, tally, begin, stop):  # type: ignore[no-untyped-def]
    for cell in range(begin, stop):
        first, n = starts[cell], starts[cell + 1] - starts[cell]
        tally[cell, 0] = tally[cell, 1] = 0
        if n > 1:
            tally[cell, 0], tally[cell, 1] = _of_a_cell(v, first, n, rate, numbers, cell, step, k0, k1)


@functools.cache
def _kernel(law: Any) -> Callable[..., None]:
    """The loop over cells for a class of laws."""
    one = specialised(_of_a_cell, law, {}, after=numba.njit(law.after))
    return specialised(_cells, law, {"nogil": True}, _of_a_cell=one)
