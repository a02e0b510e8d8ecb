"""Loops over particles in threads, one for each 200 000 particles: fewer are not worth starting one where the cores are busy.

Results are the same at any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable

from kinetic_solver.threads import over_rows

SECONDS_OF_A_PARTICLE = 1e-8
"""A step with sort on one core of an AMD EPYC (python -m benchmarks.particles_speed). All its loops take as many threads."""


def over_particles(work: Callable[[slice], None], count: int, rows: int | None = None) -> None:
    """`work` on all `count` particles, or on all of the `rows` that they lie in: cells, or blocks."""
    over_rows(work, count if rows is None else rows, count * SECONDS_OF_A_PARTICLE)
