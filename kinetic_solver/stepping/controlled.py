"""Steps under error control."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

from kinetic_solver.arrays import Array
from kinetic_solver.errors import StepTooSmall
from kinetic_solver.stepping.methods import Extrapolated
from kinetic_solver.stepping.protocol import Observer, count_of


class Controlled:
    """As few steps as keep the estimated error of each below tolerance(f)·(its length).

    Lengths are the interval over powers of two, so that substeps build few tables, and at most `longest`. With `fixed`, equal
    steps of at most that length instead. `error` adds up the estimates; `steps` and `rejected` count.
    """

    DEEPEST = 20

    def __init__(
        self,
        method: Extrapolated,
        tolerance: Callable[[Array], float],
        longest: float = math.inf,
        fixed: float | None = None,
        limited: Callable[[float], bool] | None = None,
    ) -> None:
        self.method = method
        self.tolerance = tolerance
        self.longest = longest
        self.fixed = fixed
        self.limited = limited or _warn_of_the_grid
        """Asked, with the length of steps below which errors fall no faster than the step, whether it is the grid that limits
        them: then what the longer step reached is good enough. May raise."""
        self.error = 0.0
        self.steps = 0
        self.rejected = 0
        self.shortest = math.inf
        """The shortest step taken."""
        self._limit = 1.0
        """Of the error over the tolerance; more where the grid, not the step, limits it."""
        self._length = longest

    def advance(self, f: Array, interval: float, observer: Observer) -> Array:
        if self.fixed is not None:
            count = count_of(interval, self.fixed)
            for n in range(count):
                f, error = self.method.step(f, interval / count)
                self._accept(error, interval / count)
                observer(f, interval * (n + 1) / count)
            return f
        # The place in the interval, in units of interval/2^DEEPEST: exact.
        whole, place = 2**self.DEEPEST, 0
        shallowest = self._level(interval, self.longest)
        level = max(shallowest, self._level(interval, self._length))
        failed, useless = math.inf, 0
        while place < whole:
            units, h = whole >> level, interval / 2**level
            new, error = self.method.step(f, h)
            allowed = self.tolerance(f) * h
            # A NaN is no small error. One that twice falls just as the step does is not the method's, but the grid's.
            excess = error / allowed if math.isfinite(error) else math.inf
            useless = useless + 1 if failed / 4 < excess < 1.5 * failed < math.inf else 0
            if excess > self._limit and useless == 2 and self.limited(2 * h):
                self._limit = 4 * failed  # the longer step was as good
            if not excess <= self._limit:
                if level == self.DEEPEST:
                    raise StepTooSmall(f"no step down to {h:.2g} keeps the error asked for")
                more = math.ceil(math.log2(excess) / self._order) if math.isfinite(excess) else 1
                level = min(self.DEEPEST, level + max(1, more))
                self.rejected += 1
                failed = excess
                continue
            failed = math.inf
            f, place, self._length = new, place + units, h
            self._accept(error, h)
            observer(f, interval * (place / whole))
            # Longer again, with a margin that spares rejections, where the place lies on the coarser lattice.
            if excess < 0.3 * self._limit / 2**self._order:
                self._length = 2 * h
                if level > shallowest and place % (2 * units) == 0:
                    level -= 1
        return f

    @property
    def _order(self) -> int:
        return self.method.lower_order or 1

    def _level(self, interval: float, length: float) -> int:
        """The least number of halvings that brings the interval down to `length`."""
        return min(self.DEEPEST, max(0, math.ceil(math.log2(interval / length) - 1e-9))) if length < interval else 0

    def _accept(self, error: float, h: float) -> None:
        self.error += error
        self.shortest = min(self.shortest, h)
        self.steps += 1


def _warn_of_the_grid(step: float) -> bool:
    warnings.warn(
        f"steps shorter than {step:.2g} no longer help: the grid limits the accuracy; widen grid.velocity_window or raise "
        "grid.nv",
        stacklevel=4,
    )
    return True
