"""A chain of exact steps, and from it one exact step to any time between."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.rounding import rounded
from kinetic_solver.stepping.drive import advance
from kinetic_solver.stepping.protocol import Step, Stepper, Substep

SAME = 1e-9
"""Times that differ relatively by less are one: a link may lie at the end of an interval. Chosen: far above rounding."""


class ExactStep(Protocol):
    """A step of any length, exact in time, of states in whatever form makes it so."""

    def lift(self, f: Array) -> Any:
        """f in that form."""
        ...

    def propagate(self, lifted: Any, h: float) -> Any:
        """The lifted state after h. It may be kept: it is not changed later."""
        ...

    def lower(self, lifted: Any, blur: float = 0.0) -> Array:
        """f of a lifted state, blurred in x by a Gaussian of this variance. `propagate` and this may raise LostAccuracy."""
        ...

    def moments(self, lifted: Any, times: Sequence[float], blurs: Sequence[float]) -> Array | None:
        """∫v^n f dv, n = 0 … 3, of `lower(propagate(lifted, h), blur)` for each h of times and its blur, (times, 4, nx); None
        where f itself is to be asked for."""
        ...


class Plain:
    """An exact substep as an ExactStep: states are f itself."""

    def __init__(self, substep: Substep) -> None:
        self.propagate = substep

    def lift(self, f: Array) -> Array:
        return f

    def lower(self, lifted: Array, blur: float = 0.0) -> Array:
        return lifted

    def moments(self, lifted: Array, times: Sequence[float], blurs: Sequence[float]) -> None:
        return None


@dataclass(frozen=True)
class Link:
    """A state of the chain, in its lifted form."""

    time: float
    lifted: Any


@dataclass(frozen=True)
class Chain:
    """The memory of `ExactSteps`."""

    links: tuple[Link, ...]
    """The last, and the one before if there is one; none where the start itself could not be lifted."""
    time: float
    """What has been reached: a link, or a time between."""

    @property
    def begun(self) -> bool:
        """True once there is a link after the first."""
        return len(self.links) > 1


class ExactSteps:
    """A chain of exact steps, and from its states one exact step to every time between.

    Links lie at multiples of `spacing`, counted from time 0, each at least `shortest` after the one before. They depend on no
    interval: a time that is asked for costs one step from the chain, which nothing is built upon, so that however many are asked
    for, the answers are the same (tests/convergence/test_frames.py). A time less than `aside` after a link is reached from the
    link before it: since that costs nothing, `aside` may be the stricter. Before the second link a time less than `shortest` is
    reached by `early`, if given.
    `start` is the lifted state at time 0, where it is known better than from the state itself; `blur` is the variance by which a
    state must be blurred to be resolved, too early for any frame. `fallback` takes over a step that loses its accuracy, with a
    warning; without it LostAccuracy is raised.
    """

    order = math.inf
    error_order = None

    def __init__(
        self,
        step_of: ExactStep,
        spacing: float = math.inf,
        shortest: float = 0.0,
        aside: float = 0.0,
        early: Callable[[float], Array] | None = None,
        fallback: Stepper | None = None,
        start: Any = None,
        blur: Callable[[float], float] = lambda time: 0.0,
    ) -> None:
        self.exact = step_of
        self.spacing = spacing
        self.shortest = shortest
        self.aside = max(shortest, aside)
        self.early = early
        self.fallback = fallback
        self.start = start
        self.blur = blur
        self._warned = False

    def begin(self, state: Array, time: float) -> Chain:
        if time == 0 and self.start is not None:
            return Chain((Link(time, self.start),), time)
        try:
            return Chain((Link(time, self.exact.lift(state)),), time)
        except LostAccuracy as lost:  # as the start is, so all that follows: there is nothing to return to
            self._say(lost)
            return Chain((), time)

    def step(self, state: Array, memory: Chain, start: float, interval: float) -> Step:
        """To the next multiple of `spacing`, or to the end of the interval."""
        if not memory.links:
            assert self.fallback is not None
            return Step(advance(self.fallback, state, start, interval), interval, interval, 0.0, memory)
        before, after = self._around(memory.time)
        elapsed = min(interval, after - start)
        if start + interval - after < SAME * after:
            elapsed = interval
        time = start + elapsed
        links = memory.links
        if time > after * (1 - SAME) and self._far_enough(time, links[0]):
            lifted, f = self._from(links[0], time)
            links = (Link(time, lifted), links[0])
        else:
            f = self._at(memory, time)
        return Step(
            f,
            elapsed,
            time - memory.time,
            0.0,
            Chain(links, time),
            within=lambda t: self._at(memory, start + t),
            moments=lambda times: self._moments_at(memory, [start + t for t in times]),
            stretch=(before - start, after - start),
            side=links is memory.links,
        )

    def _around(self, time: float) -> tuple[float, float]:
        """The last multiple of `spacing` that is not after the time, and the next one."""
        if math.isinf(self.spacing):
            return 0.0, math.inf
        n = math.floor(time / self.spacing * (1 + SAME))
        return n * self.spacing, (n + 1) * self.spacing

    def begins(self, time: float) -> float:
        """When the step to this time begins: at a link of the chain, or where there is none yet, at 0."""
        before, _ = self._around(time)
        back = max(self.aside, SAME * time)  # a link itself is reached from the one before
        return max(0.0, before - self.spacing) if time - before < back else before

    def carried(self, memory: Chain, to: ExactSteps, convert: Callable[[Array], Array]) -> Chain:
        """The chain as the memory of another stepper, its states being `convert` of what they were: on another grid."""
        lower, lift = self.exact.lower, to.exact.lift
        return Chain(tuple(Link(link.time, lift(convert(lower(link.lifted)))) for link in memory.links), memory.time)

    def _far_enough(self, time: float, link: Link) -> bool:
        return time - link.time >= self.shortest * (1 - 1e-9)

    def _at(self, chain: Chain, time: float) -> Array:
        """f at any time after the chain's last link but one, by one step from the chain."""
        link = chain.links[0]
        if time - link.time < self.aside * (1 - SAME):
            if chain.begun:
                link = chain.links[1]
            elif self.early is not None and not self._far_enough(time, link):
                return self._or_fall_back(lambda: (None, self.early(time)), link, time)[1]  # type: ignore[misc]
        return self._from(link, time)[1]

    def _moments_at(self, chain: Chain, times: list[float]) -> Array | None:
        """Velocity moments at any times after the chain's last link: their closed form has no shortest step."""
        link = chain.links[0]
        if min(times) <= link.time:
            return None
        return self.exact.moments(link.lifted, [time - link.time for time in times], [self.blur(time) for time in times])

    def _from(self, link: Link, time: float) -> tuple[Any, Array]:
        """(lifted state, f) at the time, by one step from a link."""
        # Equal times apart must be equal numbers, for substeps keep tables by them.
        h = rounded(time - link.time)

        def exact() -> tuple[Any, Array]:
            new = self.exact.propagate(link.lifted, h)
            return new, self.exact.lower(new, self.blur(time))

        return self._or_fall_back(exact, link, time)

    def _or_fall_back(self, exact: Callable[[], tuple[Any, Array]], link: Link, time: float) -> tuple[Any, Array]:
        try:
            return exact()
        except LostAccuracy as lost:
            self._say(lost)
            assert self.fallback is not None
            f = advance(self.fallback, self.exact.lower(link.lifted), link.time, time - link.time)
            return self.exact.lift(f), f

    def _say(self, lost: LostAccuracy) -> None:
        """Warns, once, that the fallback takes over; raises what was lost where there is none."""
        if self.fallback is None:
            raise lost
        if not self._warned:
            self._warned = True
            warnings.warn(f"{lost}: the quadrature path takes over", stacklevel=2)
