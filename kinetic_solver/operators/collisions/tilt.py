"""Operator (6)'s substep, compiled: a module of its own, so that runs in exact steps need not load numba."""

from __future__ import annotations

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.compiling import watch
from kinetic_solver.threads import over_rows

watch()

LARGEST_EXPONENT = 500.0
"""Largest exponent of one piece of a substep. The logarithm of the largest double is 709; f itself needs some of that."""
SECONDS_OF_A_POINT = 4e-9
"""One exponential, one core of an AMD EPYC (python -m benchmarks.collision_operator)."""


def tilted(f: Array, v: Array, s: float) -> Array:
    """f (nx, nv) exp(-s n v), n = Σ_j f_j, brought back to the same n at every x."""
    out = np.ascontiguousarray(f).copy()

    def of(rows: slice) -> None:
        # What is not finite stops a run with a line of its own.
        with np.errstate(all="ignore"):
            _row(v, s, out[rows])

    over_rows(of, len(f), f.size * SECONDS_OF_A_POINT)
    return out


@numba.guvectorize(["void(float64[::1], float64, float64[::1])"], "(n),(),(n)", nopython=True, cache=True, writable_args=("row",))
def _row(v, s, row):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(v.size):
        total += row[j]
    # One piece, unless exp would overflow; pieces compose exactly.
    pieces = 1 + int(abs(s * total) * (v[-1] - v[0]) / LARGEST_EXPONENT)
    for _ in range(pieces if total != 0.0 else 0):
        flux = 0.0
        for j in range(v.size):
            flux += row[j] * v[j]
        mean = flux / total  # about the mean velocity the exponent is small where f is large
        new = 0.0
        for j in range(v.size):
            row[j] *= np.exp(-s * total / pieces * (v[j] - mean))
            new += row[j]
        scale = total / new
        for j in range(v.size):
            row[j] *= scale
