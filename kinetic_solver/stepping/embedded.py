"""Methods of order 4 that tell their error by what a step has computed anyway: four rates each, the last of which is the next
step's first."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.stepping.protocol import Integral, Rate, Substep

LATER = 3 / 5
"""Of the last stage's weight, that of the rate at the new state in the result of order 3 (S. Balac and F. Mahé 2013)."""


class Taken(NamedTuple):
    """A step, and two signs of its error, of the shape of f."""

    state: Array
    rate: Array
    """That of the new state."""
    lower: Array
    """What a result of order 3 differs by: how much rates depend on the stages."""
    curvature: Array
    """What rates bend by on the way: how much they depend on time, where they hardly depend on the stages."""
    change: Array
    """What the method does not know exactly makes of f in the step, about: its rate at the end, times h."""


class Signs(NamedTuple):
    """How a method's error is judged by its signs: where their sizes are a and c, and that of the change is n, a step errs by
    about G s (s/n)^p, s = hypot(b a, c). It is proportional to the rate, however weak that is beside f."""

    gain: float
    """G."""
    stages: float
    """b."""
    power: float
    """p."""


Size = Callable[[Array, Array], float]
"""(error, f) → how large it is beside f."""
OneStep = Callable[[Array, float, Array | None, Integral | None], Taken]
"""(f, h, rate of f if it is known, what stages are to be added to)."""


def largest(error: Array, f: Array) -> float:
    """max|error| over max|f|."""
    return float(np.abs(error).max() / np.abs(f).max())


class Embedded:
    """A method of order 4 with an estimate of its own error (`Signs`). Tests: tests/convergence/test_stepping.py."""

    order, error_order = 4, 4

    def __init__(self, one: OneStep, signs: Signs, size: Size = largest) -> None:
        self.one = one
        self.signs = signs
        self.size = size

    def onward(
        self, f: Array, h: float, integral: Integral | None = None, known: Array | None = None
    ) -> tuple[Array, float, Array]:
        """(f after h, the estimated error, of the size of max|f| where that is 1; the rate there). `known`: that of f, from the
        step before."""
        taken, (gain, stages, power) = self.one(f, h, known, integral), self.signs
        sign = math.hypot(stages * self.size(taken.lower, f), self.size(taken.curvature, f))
        if sign == 0:
            return taken.state, 0.0, taken.rate
        share = sign / max(sign, self.size(taken.change, f))
        return taken.state, gain * float(np.abs(f).max()) * sign * share**power, taken.rate


def embedded_lawson(rate: Rate, linear: Substep) -> OneStep:
    """A step of the classical Runge-Kutta method in Lawson's (1967) variable exp(-tL) f, as `lawson`, with both signs.

    Test: tests/convergence/test_stepping.py.
    """

    def one(f: Array, h: float, known: Array | None, integral: Integral | None) -> Taken:
        def seen(stage: Array, share: float, place: float, found: Array | None = None) -> Array:
            """The rate of a stage at place·h, whose weight is share·h."""
            found = rate(stage) if found is None else found
            if integral is not None:
                integral.add(share * h, stage, found, place * h)
            return found

        k1 = seen(f, 1 / 6, 0.0, known)
        half, k1 = linear(f, h / 2), linear(k1, h / 2)
        k2 = seen(half + h / 2 * k1, 1 / 3, 0.5)
        k3 = seen(half + h / 2 * k2, 1 / 3, 0.5)
        k4 = seen(linear(half + h * k3, h / 2), 1 / 6, 1.0)
        middle = k2 + k3
        new = linear(half + h / 6 * k1 + h / 3 * middle, h / 2) + h / 6 * k4
        last = rate(new)
        bend = linear(k1 - middle, h / 2) + k4
        return Taken(new, last, LATER * h / 6 * (last - k4), h / 6 * bend, h * last)

    return one
