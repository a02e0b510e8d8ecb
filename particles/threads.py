"""How many threads a loop over particles takes: one for fewer than 400 000 of them, where threads would wait more than they work.

On busy cores they wait for milliseconds at the end of every loop: 10⁴ particles were up to fifty times slower on two threads.
Results are the same at any number.
"""

from __future__ import annotations

from contextlib import AbstractContextManager

from kinetic_solver.threads import numba_threads

PARTICLES_OF_A_THREAD = 200_000


def threads_for(count: int) -> AbstractContextManager[None]:
    """As many threads as `count` particles are worth, and no more than there are; numba's setting is restored."""
    return numba_threads(count // PARTICLES_OF_A_THREAD)
