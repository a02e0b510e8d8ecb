"""The times of one cadence."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array

SAME_TIME = 1e-6
"""Of the shortest cadence: far above rounding of multiples of a cadence, far below what anyone wants to tell apart."""


def multiples(cadence: float, end: float) -> Array:
    """0, every cadence, and the end; a multiple that is the end but for `SAME_TIME` of a cadence makes no frame beside it."""
    times = cadence * np.arange(math.floor(end / cadence + SAME_TIME) + 1)
    if times.size == 1 or end - times[-1] > SAME_TIME * cadence:
        return np.append(times, end)
    times[-1] = end
    return times
