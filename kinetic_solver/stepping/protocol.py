"""What substeps, methods and steppers are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from kinetic_solver.arrays import Array

Substep = Callable[[Array, float], Array]
Rate = Callable[[Array], Array]
BaseMethod = Callable[[Array, float, int], Array]
"""f, interval, number of equal steps → f after the interval."""
Observer = Callable[[Array, float], None]
"""Called as observer(f, elapsed) when a step is done."""


class Stepper(Protocol):
    def advance(self, f: Array, interval: float, observer: Observer) -> Array:
        """f after `interval`; the observer is told of every step. May raise StepTooSmall."""
        ...


def count_of(interval: float, longest: float) -> int:
    """Equal steps that fill the interval."""
    return max(1, math.ceil(interval / longest * (1 - 1e-12)))
