"""The words of time stepping: substeps, rates, methods, and what a stepper is asked and answers.

Nothing here knows physics, or remembers anything: a stepper is handed its own memory with every call and hands a new one back,
so that whoever drives it may stop, repeat or resume at any step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kinetic_solver.arrays import Array

Substep = Callable[[Array, float], Array]
"""(f, dt) → f after dt of one part of the equation."""
Rate = Callable[[Array], Array]
"""f → ∂f/∂t by one part of the equation."""
Watched = Callable[[Array, Array, float], Array]
"""(f, its rate, time) → quantities whose integrals over time are wanted, shape (quantities,)."""


class Integral:
    """∫quantities dt over a step, by the weights that a method gives to its own stages: of its order, and about of its error.

    Test: tests/convergence/test_stepping.py.
    """

    def __init__(self, quantities: Watched, start: float) -> None:
        self.quantities = quantities
        self.start = start
        """The time at which the step begins."""
        self.value: Array = np.zeros(())

    def add(self, weight: float, f: Array, rate: Array, elapsed: float) -> None:
        """A stage, so long after the step began."""
        self.value = self.value + weight * self.quantities(f, rate, self.start + elapsed)


@dataclass(frozen=True)
class BaseMethod:
    """Equal steps over an interval, and what is known of their error: a series c₁ h^order + c₂ h^(order + stride) + …"""

    over: Callable[[Array, float, int, Integral | None], Array]
    """(f, interval, number of equal steps, what is to be added to on the way) → f after the interval."""
    order: int
    stride: int


@dataclass(frozen=True)
class Step:
    """One step that was taken."""

    state: Array
    """After it."""
    elapsed: float
    """Since the interval began; the interval itself, to the last bit, when it is over."""
    length: float
    error: float
    """Estimated max|error| that this step alone has made; 0 where it is exact, or where nothing estimates it."""
    memory: Any
    """To be handed back with the next call."""
    within: Callable[[float], Array] | None = None
    """The state at any time in the stretch, counted from where the interval began; None where only the ends are known."""
    moments: Callable[[Sequence[float]], Array | None] | None = None
    """∫v^n f dv, n = 0 … 3, at such times, (times, 4, nx), where they are to be had without the states: else None."""
    stretch: tuple[float, float] | None = None
    """The times, counted likewise, between which `within` and `moments` are good: the step, and what surrounds it."""
    side: bool = False
    """True where nothing will be built upon this state."""
    integral: Array | None = None
    """Of what is watched, over the step; None where nothing is."""


@dataclass(frozen=True)
class Stalled:
    """Steps shorter than `length` have errors that fall no faster than the step: something else than the step limits them.

    The driver decides: with the memory `accepting` the stepper takes the next step as good enough, with `insisting` it tries
    shorter ones still.
    """

    length: float
    accepting: Any
    insisting: Any

    def __str__(self) -> str:
        return (
            f"steps shorter than {self.length:.2g} no longer help: the grid limits the accuracy; widen grid.velocity_window or "
            "raise grid.nv"
        )


class Stepper(Protocol):
    """Fills an interval with steps."""

    @property
    def order(self) -> float:
        """Of the error at the end of an interval in the length of the steps; inf where they are exact."""
        ...

    @property
    def error_order(self) -> float | None:
        """Of the error that `Step.error` estimates; None where nothing is estimated, or nothing needs to be."""
        ...

    def begin(self, state: Array, time: float) -> Any:
        """The memory with which to start from this state at this time."""
        ...

    def step(self, state: Array, memory: Any, start: float, interval: float) -> Step | Stalled:
        """The next step in the interval that began at the time `start`, from a state and memory of the step before.

        Raises StepTooSmall or LostAccuracy where there is none; the state before is good.
        """
        ...


def count_of(interval: float, longest: float) -> int:
    """Equal steps of at most `longest` that fill the interval, rounding apart."""
    return max(1, math.ceil(interval / longest * (1 - 1e-12)))
