"""Steps of a method with an error estimate: as long as error control lets them be, or of equal length."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

from kinetic_solver.arrays import Array
from kinetic_solver.errors import StepTooSmall
from kinetic_solver.stepping.embedded import Embedded
from kinetic_solver.stepping.methods import Extrapolated
from kinetic_solver.stepping.protocol import Integral, Stalled, Step, Watched, count_of

DEEPEST = 20
"""Halvings of an interval: 10⁶ steps in it, beyond which error control gives up."""
WHOLE = 3 * 2**DEEPEST
"""An interval, in the units of which places and lengths are multiples: exact."""
MARGIN = 0.8
"""Of the error allowed to a longer step, below which the next step is that long. It spares rejections."""
CAUTION = 0.9
"""Of the length that should do, what is tried after a rejection."""
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
    """How far the interval is done, in units."""
    units: int | None = None
    """Of the next step; None at an interval's start."""
    failed: float = math.inf
    """Error over tolerance of the last rejected try of this step; inf where there was none."""
    useless: int = 0
    """Tries in a row whose error fell no faster than the step."""
    rate: Array | None = None
    """Of the state, where the method has found it already."""


class Controlled:
    """As few steps as keep the estimated error of each below tolerance(f)·(its length), or, where errors are forgotten within a
    time `memory`, below tolerance(f)·memory·(its length/memory)^adding, or that of a step of length `memory`.

    Lengths are the interval over powers of two, with `thirds` also over three times those, so that substeps build few tables, and
    at most `longest`. The `first` step is no longer than the estimate can be believed in a state of which nothing is known; what
    follows is at most twice as long each. Orders: those of the method. Test: tests/convergence/test_stepping.py.
    """

    def __init__(
        self,
        method: Embedded | Extrapolated,
        tolerance: Callable[[Array], float],
        longest: float = math.inf,
        watched: Watched | None = None,
        first: float = math.inf,
        memory: float = math.inf,
        stable: Callable[[Array], float] = lambda f: math.inf,
        adding: float = 1.0,
        thirds: bool = False,
    ) -> None:
        """What is `watched` is integrated over every step. No step is longer than `stable(f)`: beyond it what is too small to be
        estimated grows unseen. With the power `adding` of their number errors add up: 1 where they are all alike, 1/2 where each
        is another."""
        self.method = method
        self.tolerance = tolerance
        self.longest = longest
        self.watched = watched
        self.first = min(first, longest)
        self.memory = memory
        self.stable = stable
        self.adding = adding
        self.thirds = thirds
        self.order, self.error_order = method.order, method.error_order
        self._power = (self.error_order or 1) + 1 - adding
        """Of a step's length, with which its error over what is allowed falls."""

    def begin(self, state: Array, time: float) -> Pace:
        return Pace(self.first)

    def step(self, state: Array, memory: Pace, start: float, interval: float) -> Step | Stalled:
        rest = WHOLE - memory.place
        most = min(self.longest, self.stable(state)) / interval * WHOLE
        units = self._within(min(most, memory.length / interval * WHOLE if memory.units is None else memory.units), rest)
        limit, failed, useless = memory.limit, memory.failed, memory.useless
        while True:
            h = interval * (units / WHOLE)
            integral = _integral(self.watched, start + interval * (memory.place / WHOLE))
            new, error, rate = self.method.onward(state, h, integral, memory.rate)
            allowed = self.tolerance(state) * self._shared(min(h, self.memory))
            excess = error / allowed if math.isfinite(error) else math.inf  # a NaN is no small error
            useless = useless + 1 if SAME[0] * failed < excess < SAME[1] * failed < math.inf else 0
            if excess <= limit:
                later = self._later(excess, units, most, memory, interval, rate)
                elapsed = interval * ((memory.place + units) / WHOLE)
                return Step(new, elapsed, h, error, later, integral=None if integral is None else integral.value)
            if useless == 2:
                here = dataclasses.replace(memory, units=units, failed=failed, useless=useless)
                # The longer step was as good: its error, with some room, is what will do from now on.
                accepting = dataclasses.replace(here, limit=4 * failed)
                return Stalled(2 * h, accepting, here)
            if units <= WHOLE >> DEEPEST:
                raise StepTooSmall(f"no step down to {h:.2g} keeps the error asked for")
            shorter = (limit / excess) ** (1 / self._power) * CAUTION if math.isfinite(excess) else 0.5
            units = self._within(shorter * units, rest)
            failed = excess

    def _shared(self, h: float) -> float:
        """Times the tolerance, what is allowed to a step."""
        return h if math.isinf(self.memory) else self.memory * (h / self.memory) ** self.adding

    def _later(self, excess: float, units: int, most: float, memory: Pace, interval: float, rate: Array | None) -> Pace:
        """After a step that was accepted."""
        longer = min(2.0, max(1.0, (MARGIN * memory.limit / max(excess, 1e-300)) ** (1 / self._power)))
        length, place = interval * (units / WHOLE) * longer, memory.place + units
        if place == WHOLE:
            return Pace(length, memory.limit, rate=rate)
        return Pace(length, memory.limit, place, self._within(min(most, longer * units), WHOLE - place), rate=rate)

    def _within(self, units: float, rest: int) -> int:
        """The longest length of at most so many units of which the rest is a multiple."""
        most = min(units, WHOLE) * (1 + 1e-9)
        power = 2 ** math.floor(math.log2(max(1.0, most / 3)))
        while True:
            for found in (4 * power, 3 * power) if self.thirds else (3 * power,):
                if found <= most and rest % found == 0:
                    return found
            if power == 1:
                return math.gcd(3, rest)
            power //= 2


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
