"""Hermite functions He_n(w)/√n! by their recurrence."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array


def hermite_functions(w: Array, weight: Array, count: int) -> Array:
    """weight · He_n(w)/√n!, shape (count, len(w)), by forward recurrence: stable, and weighted from its start, so no overflow."""
    out = np.empty((count, *w.shape))
    out[0] = weight
    if count > 1:
        out[1] = w * weight
    for n in range(1, count - 1):
        out[n + 1] = (w * out[n] - math.sqrt(n) * out[n - 1]) / math.sqrt(n + 1)
    return out
