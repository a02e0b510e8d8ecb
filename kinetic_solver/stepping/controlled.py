"""Steps of a method with an error estimate: as long as error control lets them be, or of equal length."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

from kinetic_solver.arrays import Array
from kinetic_solver.errors import StepTooSmall
from kinetic_solver.stepping.methods import Extrapolated
from kinetic_solver.stepping.protocol import Integral, Stalled, Step, Watched, count_of

DEEPEST = 20
"""Halvings of an interval: 10⁶ steps in it, beyond which error control gives up."""
MARGIN = 0.3
"""Of the error allowed to a step of twice the length, below which the next step is that long. It spares rejections."""
SAME = (1 / 4, 1.5)
"""An error per unit of time within these factors of that of the longer step before has fallen no faster than the step itself."""


@dataclass(frozen=True)
class Pace:
    """All that one step under error control hands to the next."""

    length: float
    """To try first in a new interval."""
    limit: float = 1.0
    """Of the error over the tolerance; larger where something else than the step limits the error."""
    place: int = 0
    """How far the interval is done, in units of interval/2^DEEPEST: exact."""
    level: int | None = None
    """Halvings of the interval that make the next step; None at an interval's start."""
    failed: float = math.inf
    """Error over tolerance of the last rejected try of this step; inf where there was none."""
    useless: int = 0
    """Tries in a row whose error fell no faster than the step."""


class Controlled:
    """As few steps as keep the estimated error of each below tolerance(f)·(its length).

    Lengths are the interval over powers of two, so that substeps build few tables, and at most `longest`.
    Orders: those of the method. Test: tests/convergence/test_stepping.py.
    """

    def __init__(
        self,
        method: Extrapolated,
        tolerance: Callable[[Array], float],
        longest: float = math.inf,
        watched: Watched | None = None,
    ) -> None:
        """What is `watched` is integrated over every step."""
        self.method = method
        self.tolerance = tolerance
        self.longest = longest
        self.watched = watched
        self.order, self.error_order = method.order, method.error_order

    def begin(self, state: Array, time: float) -> Pace:
        return Pace(self.longest)

    def step(self, state: Array, memory: Pace, start: float, interval: float) -> Step | Stalled:
        shallowest = _level(interval, self.longest)
        level = max(shallowest, _level(interval, memory.length)) if memory.level is None else memory.level
        limit, failed, useless = memory.limit, memory.failed, memory.useless
        while True:
            h = interval / 2**level
            integral = _integral(self.watched, start + interval * (memory.place / 2**DEEPEST))
            new, error = self.method.step(state, h, integral)
            allowed = self.tolerance(state) * h
            excess = error / allowed if math.isfinite(error) else math.inf  # a NaN is no small error
            useless = useless + 1 if SAME[0] * failed < excess < SAME[1] * failed < math.inf else 0
            if excess <= limit:
                step = self._accepted(new, error, excess, level, shallowest, memory, interval)
                return step if integral is None else dataclasses.replace(step, integral=integral.value)
            if useless == 2:
                here = dataclasses.replace(memory, level=level, failed=failed, useless=useless)
                # The longer step was as good: its error, with some room, is what will do from now on.
                accepting = dataclasses.replace(here, limit=4 * failed)
                return Stalled(2 * h, accepting, here)
            if level == DEEPEST:
                raise StepTooSmall(f"no step down to {h:.2g} keeps the error asked for")
            more = math.ceil(math.log2(excess) / self._expected_order) if math.isfinite(excess) else 1
            level = min(DEEPEST, level + max(1, more))
            failed = excess

    def _accepted(
        self, new: Array, error: float, excess: float, level: int, shallowest: int, memory: Pace, interval: float
    ) -> Step:
        units, whole, h = 2 ** (DEEPEST - level), 2**DEEPEST, interval / 2**level
        place, length = memory.place + units, h
        if excess < MARGIN * memory.limit / 2**self._expected_order:
            length = 2 * h
            if level > shallowest and place % (2 * units) == 0:  # where the place lies on the coarser lattice
                level -= 1
        later = Pace(length, memory.limit) if place == whole else Pace(length, memory.limit, place, level)
        return Step(new, interval * (place / whole), h, error, later)

    @property
    def _expected_order(self) -> int:
        """With which the estimate falls."""
        return self.error_order or 1


class Fixed:
    """Equal steps of at most `longest`, as few as fill the interval. The memory is the number of steps done in it."""

    def __init__(self, method: Extrapolated, longest: float, watched: Watched | None = None) -> None:
        self.method = method
        self.longest = longest
        self.watched = watched
        self.order, self.error_order = method.order, method.error_order

    def begin(self, state: Array, time: float) -> int:
        return 0

    def step(self, state: Array, memory: int, start: float, interval: float) -> Step:
        count = count_of(interval, self.longest)
        h, done = interval / count, memory + 1
        integral = _integral(self.watched, start + h * memory)
        new, error = self.method.step(state, h, integral)
        elapsed = interval if done == count else interval * done / count
        return Step(new, elapsed, h, error, done % count, integral=None if integral is None else integral.value)


def _integral(watched: Watched | None, time: float) -> Integral | None:
    return None if watched is None else Integral(watched, time)


def _level(interval: float, length: float) -> int:
    """The least number of halvings that brings the interval down to `length`."""
    return min(DEEPEST, max(0, math.ceil(math.log2(interval / length) - 1e-9))) if length < interval else 0
