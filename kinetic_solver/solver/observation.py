"""What the run looks at after every step: one immutable record, handed to all that watch it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import relative_amplitudes
from kinetic_solver.operators.moments import Moments, moments
from kinetic_solver.plan import Plan
from kinetic_solver.solver.scheme import Scheme


@dataclass(frozen=True)
class Observation:
    """A state of the run, on its grid of the moment."""

    scheme: Scheme
    clock: float
    """Of the frame of reference."""
    state: Array
    """As it is stepped: values at points, or Hermite coefficients; the first axis is x."""
    f: Array
    """At the grid's points, (nx, nv)."""
    since: float = -math.inf
    """The clock when the step that led here began."""
    error: float = 0.0
    """Estimated max|error| that this step made."""
    within: Callable[[float], Array] | None = None
    """f (nx, nv) at any clock of the stretch; None where only the ends of steps are known."""
    moments_within: Callable[[Sequence[float]], Array | None] | None = None
    """∫v^n f dv, n = 0 … 3, (clocks, 4, nx), likewise; None for an answer where f is to be asked for."""
    stretch: tuple[float, float] | None = None
    """Clocks between which these are good: that step, and what surrounds it."""
    side: bool = False
    """True where nothing is built upon this state: (6) will not amplify what is wrong with it."""
    integral: Array | None = None
    """Over that step, of what the scheme watches (solver/watched.py)."""

    @classmethod
    def of(
        cls,
        scheme: Scheme,
        clock: float,
        state: Array,
        since: float = -math.inf,
        error: float = 0.0,
        within: Callable[[float], Array] | None = None,
        moments_within: Callable[[Sequence[float]], Array | None] | None = None,
        stretch: tuple[float, float] | None = None,
        side: bool = False,
        integral: Array | None = None,
    ) -> Observation:
        state = np.ascontiguousarray(state)  # as a checkpoint gives it back: the order of sums is that of the memory
        points = scheme.representation.points(state)
        return cls(scheme, clock, state, points, since, error, within, moments_within, stretch, side, integral)

    @property
    def plan(self) -> Plan:
        return self.scheme.plan

    @property
    def grid(self) -> PhaseSpaceGrid:
        return self.scheme.plan.grid

    @property
    def length(self) -> float:
        """Of the step that led here; inf at the start."""
        return self.clock - self.since

    @property
    def time(self) -> float:
        """Of the laboratory."""
        return self.plan.reference_frame.place(self.clock).time

    @functools.cached_property
    def finite(self) -> bool:
        """Whether all of f are numbers."""
        return bool(np.isfinite(self.f.sum()))

    @functools.cached_property
    def moments(self) -> Moments:
        """Of f, (nx,) each."""
        return moments(self.grid, self.f)

    @functools.cached_property
    def waves_in_x(self) -> Array:
        """The largest amplitude of every wave in x over the largest of all, (nx//2 + 1,)."""
        return relative_amplitudes(self.f)

    @functools.cached_property
    def waves_in_v(self) -> Array:
        """Likewise in v, (nv//2 + 1,)."""
        return relative_amplitudes(self.f, axis=1)

    @functools.cached_property
    def totals(self) -> tuple[float, float, float]:
        """(mass, momentum, energy), in the frame of reference."""
        return self.scheme.representation.totals(self.state)
