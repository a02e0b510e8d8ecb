"""Fills an interval with a stepper's steps, where nobody has to decide anything on the way."""

from __future__ import annotations

import warnings
from collections.abc import Callable

from kinetic_solver.arrays import Array
from kinetic_solver.stepping.protocol import Stalled, Step, Stepper


def advance(
    stepper: Stepper, state: Array, start: float, interval: float, observer: Callable[[Step], None] = lambda step: None
) -> Array:
    """The state after the interval; `observer` is told of every step. What stalls is warned of, and accepted."""
    memory, elapsed = stepper.begin(state, start), 0.0
    while elapsed < interval:
        step = stepper.step(state, memory, start, interval)
        if isinstance(step, Stalled):
            warnings.warn(str(step), stacklevel=2)
            memory = step.accepting
            continue
        state, memory, elapsed = step.state, step.memory, step.elapsed
        observer(step)
    return state
