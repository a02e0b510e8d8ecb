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
OF_CURVATURE = 0.1
"""Of what rates are curved by within a step, the share that counts. Chosen among 0 … 3: with it the true errors of 3000 steps on
twenty-two scenes of benchmarks/random_scenes.py lie within a factor of 2 of what is foretold, without it 5."""


class Taken(NamedTuple):
    """A step, and two signs of its error: both are largest numbers of arrays like f."""

    state: Array
    rate: Array
    """That of the new state."""
    lower: float
    """What a result of order 3 differs by: how much rates depend on the stages."""
    curvature: float
    """What rates bend by on the way: how much they depend on time, where they hardly depend on the stages."""


OneStep = Callable[[Array, float, Array | None, Integral | None], Taken]
"""(f, h, rate of f if it is known, what stages are to be added to)."""


class Embedded:
    """A method of order 4 with an estimate of its own error.

    Both signs belong to lower orders. A step in which they are a and c, over max f, errs by about G hypot(a, c/10)^(5/4), the
    power with which an error of order 5 falls beside one of order 4. Tests: tests/convergence/test_stepping.py.
    """

    order, error_order = 4, 4

    def __init__(self, one: OneStep, gain: float) -> None:
        """`gain` is G."""
        self.one = one
        self.gain = gain

    def onward(self, f: Array, h: float, integral: Integral | None = None, known: Array | None = None) -> tuple[Array, float, Array]:
        """(f after h, the estimated max|error|, the rate there); `known` is the rate of f, from the step before."""
        taken = self.one(f, h, known, integral)
        top = float(np.abs(f).max())
        sign = math.hypot(taken.lower, OF_CURVATURE * taken.curvature) / top
        return taken.state, self.gain * top * sign ** ((self.order + 1) / self.order), taken.rate


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
        return Taken(new, last, LATER * h / 6 * largest(last - k4), h / 6 * largest(bend))

    return one


def largest(values: Array) -> float:
    return float(np.abs(values).max())
