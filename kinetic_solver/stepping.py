"""How substeps are composed in time. Knows no physics: a substep is any callable (f, dt) → f, a rate any callable f → ∂f/∂t.

Two base methods, `strang` for collisions that have an exact substep and `lawson` for those that only have a rate; `Extrapolated`,
which raises a base method's order and estimates its error; and two steppers, `Controlled` and `ExactSteps`, that
fill an interval with steps. Why these: docs/performance.md.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from kinetic_solver.arrays import Array

Substep = Callable[[Array, float], Array]
Rate = Callable[[Array], Array]
BaseMethod = Callable[[Array, float, int], Array]
"""f, interval, number of equal steps → f after the interval."""
Observer = Callable[[Array, float], None]
"""Called as observer(f, elapsed) when a step is done."""


class StepTooSmall(RuntimeError):
    """The error asked for cannot be reached by any step."""


class LostAccuracy(RuntimeError):
    """An exact step could not be done accurately; the state before it is good."""


class Stepper(Protocol):
    def advance(self, f: Array, interval: float, observer: Observer) -> Array:
        """f after `interval`; the observer is told of every step. May raise StepTooSmall."""
        ...


def strang(outer: Substep, inner: Substep) -> BaseMethod:
    """Strang's (1968) splitting outer(h/2) inner(h) outer(h/2); the outer half steps of neighbouring steps are done as one.

    Order 2, error in even powers of h where both substeps are exact; positive where they are.
    Test: tests/convergence/test_stepping.py.
    """

    def method(f: Array, interval: float, steps: int) -> Array:
        h = interval / steps
        f = outer(f, h / 2)
        for _ in range(steps - 1):
            f = outer(inner(f, h), h)
        return outer(inner(f, h), h / 2)

    return method


def lawson(rate: Rate, linear: Substep) -> BaseMethod:
    """The classical fourth-order Runge-Kutta method in Lawson's (1967) variable exp(-tL) f: the linear part L is exact.

    Four rates and four linear half steps a step, none backwards in time. What rate and linear step both conserve is conserved to
    round-off. Stable for steps below about 2.8/|the rate's eigenvalue|. Order 4. Test: tests/convergence/test_stepping.py.
    """

    def method(f: Array, interval: float, steps: int) -> Array:
        h = interval / steps
        for _ in range(steps):
            k1 = rate(f)
            f, k1 = linear(f, h / 2), linear(k1, h / 2)
            k2 = rate(f + h / 2 * k1)
            k3 = rate(f + h / 2 * k2)
            k4 = rate(linear(f + h * k3, h / 2))
            f = linear(f + h / 6 * k1 + h / 3 * (k2 + k3), h / 2) + h / 6 * k4
        return f

    return method


class Extrapolated:
    """Richardson extrapolation: results of a base method with `counts` steps, combined so that errors h^p, p in `powers`, cancel.

    Strang's method with counts (1, 2, 3, 4) and powers (2, 4, 6) gives order 8, Lawson's with (1, 2) and (4,) order 5.
    Positivity is lost by terms of the order of the error. Orders, two-sided: tests/convergence/test_stepping.py.
    """

    def __init__(self, base: BaseMethod, counts: Sequence[int] = (1,), powers: Sequence[int] = ()) -> None:
        self.base = base
        self.counts = tuple(counts)
        self._weights = _weights(counts, powers)
        self._lower = np.append(0.0, _weights(counts[1:], powers[:-1])) if powers else self._weights
        self.lower_order = powers[-1] if powers else None
        """Order of the estimate: the error of the result without the last cancellation."""

    def step(self, f: Array, h: float) -> tuple[Array, float]:
        """(f after h, the estimated max|error| of the next lower order; 0 where nothing is extrapolated)."""
        finest = self.base(f, h, self.counts[-1])
        best, lower = finest.copy(), np.zeros_like(f)
        # Corrections to the finest result: what all results conserve stays, though the weights are rounded.
        for n, weight, low in zip(self.counts[:-1], self._weights, self._lower, strict=False):
            correction = self.base(f, h, n) - finest
            best += weight * correction
            lower += (weight - low) * correction
        return best, float(np.abs(lower).max())


def _weights(counts: Sequence[int], powers: Sequence[int]) -> Array:
    """w with Σ w = 1 and Σ w n^(-p) = 0 for each power p."""
    rows = [[float(n) ** -p for n in counts] for p in (0, *powers)]
    return np.asarray(np.linalg.solve(rows, np.eye(len(counts))[0]))


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
            count = _count(interval, self.fixed)
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


class ExactStep(Protocol):
    """A step of any length, exact in time, of states in whatever form makes it so."""

    def lift(self, f: Array) -> Any:
        """f in that form."""
        ...

    def propagate(self, lifted: Any, h: float) -> Any:
        """The lifted state after h. It may be kept: it is not changed later."""
        ...

    def lower(self, lifted: Any) -> Array:
        """f of a lifted state. `propagate` and this may raise LostAccuracy."""
        ...


class Plain:
    """An exact substep as an ExactStep: states are f itself."""

    def __init__(self, substep: Substep) -> None:
        self.propagate = substep

    def lift(self, f: Array) -> Array:
        return f

    def lower(self, lifted: Array) -> Array:
        return lifted


class ExactSteps:
    """A chain of exact steps, each at least `shortest` long, and from its states one exact step to every time between.

    So a step that is too short to be accurate is never built upon, and after the first link none is taken. `early`, if given,
    makes f at a time before `shortest`. Intervals are seen in equal pieces of at most `longest`. `fallback` takes over a step
    that loses its accuracy. `between`, if set, is called as between(f_at, start, end) for each piece before it is taken, where
    f_at(t) is f at any t of the piece. Times count from the first call.
    """

    def __init__(
        self,
        step: ExactStep,
        longest: float = math.inf,
        shortest: float = 0.0,
        early: Callable[[float], Array] | None = None,
        fallback: Stepper | None = None,
    ) -> None:
        self.step = step
        self.longest = longest
        self.shortest = shortest
        self.early = early
        self.fallback = fallback
        self.between: Callable[[Callable[[float], Array], float, float], None] | None = None
        self._links: list[tuple[float, Any]] = []
        """The chain's last lifted state, and the one before: (time, state)."""
        self._time = 0.0
        self._warned = False

    def advance(self, f: Array, interval: float, observer: Observer) -> Array:
        if not self._links:
            try:
                self._links = [(0.0, self.step.lift(f))]
            except LostAccuracy as lost:  # as the start is, so all that follows: nothing to return to
                if self.fallback is None:
                    raise
                warnings.warn(f"{lost}: the quadrature path takes over", stacklevel=2)
                return self.fallback.advance(f, interval, observer)
        count = _count(interval, self.longest)
        h, start = interval / count, self._time
        for n in range(count):
            if self.between is not None:
                self.between(self._f_at, start + n * h, start + (n + 1) * h)
            self._time = start + (n + 1) * h
            if self._far_enough(self._time, self._links[0][0]):
                lifted, f = self._step(self._links[0], self._time)
                self._links = [(self._time, lifted), self._links[0]]
            else:
                f = self._f_at(self._time)
            observer(f, (n + 1) * h)
        return f

    @property
    def chained(self) -> bool:
        """True once the chain has a link after its first."""
        return len(self._links) > 1

    def carry_over(self, step: ExactStep, convert: Callable[[Array], Array]) -> None:
        """Go on with another step, the chain's states being `convert` of what they were: on another grid."""
        self._links = [(time, step.lift(convert(self.step.lower(lifted)))) for time, lifted in self._links]
        self.step = step

    def _far_enough(self, time: float, since: float) -> bool:
        return time - since >= self.shortest * (1 - 1e-9)

    def _f_at(self, time: float) -> Array:
        link = self._links[0]
        if not self._far_enough(time, link[0]):
            if len(self._links) > 1:
                link = self._links[1]
            elif self.early is not None:
                return self._or_fall_back(lambda: (None, self.early(time)), link, time)[1]  # type: ignore[misc]
        return self._step(link, time)[1]

    def _step(self, link: tuple[float, Any], time: float) -> tuple[Any, Array]:
        """(lifted state, f) at the time, from a link of the chain."""
        # Equal times apart must be equal numbers, for substeps keep tables by them.
        h = float(f"{time - link[0]:.12e}")

        def exact() -> tuple[Any, Array]:
            new = self.step.propagate(link[1], h)
            return new, self.step.lower(new)

        return self._or_fall_back(exact, link, time)

    def _or_fall_back(self, exact: Callable[[], tuple[Any, Array]], link: tuple[float, Any], time: float) -> tuple[Any, Array]:
        try:
            return exact()
        except LostAccuracy as lost:
            if self.fallback is None:
                raise
            if not self._warned:
                self._warned = True
                warnings.warn(f"{lost}: the quadrature path takes over", stacklevel=2)
            f = self.fallback.advance(self.step.lower(link[1]), time - link[0], lambda f, elapsed: None)
            return self.step.lift(f), f


def _count(interval: float, longest: float) -> int:
    """Equal steps that fill the interval."""
    return max(1, math.ceil(interval / longest * (1 - 1e-12)))
