"""A chain of exact steps."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, Protocol

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.stepping.protocol import Observer, Stepper, Substep, count_of


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
        count = count_of(interval, self.longest)
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
