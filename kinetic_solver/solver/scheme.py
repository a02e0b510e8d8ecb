"""Everything that a plan means, built: how f is held, which collision operator acts, and what steps it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions import PairCollisions
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.linearised import GridLinearisedStep
from kinetic_solver.operators.velocity.kernel import RESOLVED, resolution, resolved_spacing
from kinetic_solver.plan import Plan, in_t, kernel_sums, measured
from kinetic_solver.plan.choices import FINER_WHEN_EARLY
from kinetic_solver.solver.homogeneous import HomogeneousSteps
from kinetic_solver.solver.relaxing import relaxation
from kinetic_solver.solver.representation import Representation, collision_operator, make_representation
from kinetic_solver.solver.watched import watched_by
from kinetic_solver.stepping import (
    Controlled,
    Embedded,
    ExactStep,
    ExactSteps,
    Extrapolated,
    Fixed,
    Plain,
    Rate,
    Stepper,
    embedded_lawson,
    krogstad,
    largest,
)

LINEARISED_ROUND_OFF = 0.05
"""Of rtol, to the round-off of the exactly linearised step of (6): it decides between its gauges. Chosen."""
FINER = (FINER_WHEN_EARLY, 3 * FINER_WHEN_EARLY)
"""How many times denser the points may be on which a start is stepped to a time too early for the kernel on the plan's: odd, so
that the plan's points are among them. The kernel's width goes as the square root of short times."""
RELAXED = (1.0, 10.0)
"""(a, b): the longest exponential step is a/γ, or b rtol/(γ δ²) at the distance δ max f from the homogeneous state, if longer. Of
longer ones estimates see too little: without this bound Sρ = 10, t = 20/γ erred by 0.9 rtol (1e-4), with it by less than 0.2."""
STRANG_COUNTS, LAWSON_COUNTS = (1, 2, 3, 4), (1, 2)
"""Steps of the base method that are extrapolated: to order 8, and to order 5. Why these: docs/performance.md."""


ADDING = 0.5
"""The power of their number with which errors of steps add up that collisions of pairs have not yet forgotten: those of
neighbours are hardly alike. benchmarks/steps_error.py: with 1/2 errors scatter by a factor of 2.1 from scene to scene, with 1 by
2.4."""


@dataclass(frozen=True)
class Scheme:
    """Of one plan. Steps keep tables by their lengths, and nothing else, between calls."""

    plan: Plan
    representation: Representation
    operator: CollisionRate | None
    """For f on the plan's velocity points; None without collisions."""
    stepper: Stepper

    @property
    def exact(self) -> bool:
        return isinstance(self.stepper, ExactSteps)

    @property
    def from_the_start(self) -> bool:
        """True where a change of grid sends the run back to time 0: what is stepped is not what is seen."""
        return isinstance(self.stepper, ExactSteps | HomogeneousSteps)

    @property
    def density_defect(self) -> float:
        """What the exactly linearised step on velocity points has missed of the density so far (docs/output.md); that of the
        Hermite step is no measure of f's error after a long step."""
        step = self.stepper.exact if isinstance(self.stepper, ExactSteps) else None
        return step.density_defect if isinstance(step, GridLinearisedStep) else 0.0


def assemble(plan: Plan) -> Scheme:
    representation = make_representation(plan)
    return Scheme(plan, representation, collision_operator(plan), make_stepper(plan, representation))


def make_stepper(plan: Plan, representation: Representation) -> Stepper:
    """The stepper that the plan names."""
    longest = math.inf if plan.time_step is None else plan.time_step
    if plan.stepping == "homogeneous":
        return HomogeneousSteps(plan)
    if plan.law is None:
        return ExactSteps(Plain(representation.linear), longest)
    if plan.stepping == "exact":
        return _exact_steps(plan, representation, longest)
    if plan.stepping == "strang":
        assert plan.time_step is not None
        return Fixed(Extrapolated(representation.split()), plan.time_step)
    given, watched = plan.inner.grid.time_step, watched_by(plan, representation)
    if given is not None:
        return Fixed(_extrapolated(plan, representation), given, watched)
    method, limits = _method(plan, representation), (plan.first_step, plan.memory_time, _stable(plan))
    if not plan.scales.of_pairs:
        return Controlled(method, _tolerance(plan), longest, watched, *limits)
    return Controlled(method, _tolerance(plan), longest, watched, *limits, adding(plan), plan.stepping != "exponential")


def adding(plan: Plan) -> float:
    """ADDING where pairs, friction and noise forget errors; else 1: what a cooling gas keeps, or is amplified, has one sign."""
    model = plan.inner.model
    return ADDING if plan.scales.of_pairs and not plan.scales.slows and model.friction > 0 and model.noise > 0 else 1.0


def _exact_steps(plan: Plan, representation: Representation, longest: float) -> Stepper:
    scene = plan.inner
    step = representation.linearised(LINEARISED_ROUND_OFF * scene.accuracy.rtol)
    aside = in_t.shortest_exact_step(plan.scales, plan.waves, plan.grid, RESOLVED) if plan.shortest_step > 0 else 0.0
    early = Early(plan) if plan.shortest_step > 0 else None
    # Where nx is open, a finer grid is the better way out of a step that loses its accuracy; but not of a jump.
    given = scene.grid.nx is not None or plan.waves.products_of_a_step
    fallback = Controlled(_extrapolated(plan, representation), _tolerance(plan)) if given else None
    start = representation.lifted_start(step)
    return ExactSteps(step, longest, plan.shortest_step, min(aside, longest), early, fallback, start, plan.waves.blur)


def _method(plan: Plan, representation: Representation) -> Embedded | Extrapolated:
    """Of steps under error control."""
    law = plan.law
    if not plan.scales.of_pairs or law is None:
        return _extrapolated(plan, representation)
    if plan.stepping == "exponential":
        return Embedded(krogstad(_rate(plan), relaxation(plan)), measured.EXPONENTIAL_SIGNS, _size(plan))
    return Embedded(embedded_lawson(representation.rate, representation.linear), measured.LAWSON_SIGNS, _size(plan))


def _size(plan: Plan) -> Callable[[Array, Array], float]:
    """Of an error beside f: that of f, or of ∫v²f dv about the mean velocity if that is larger, each over its maximum. What is
    small beside f, but as wide as the window, is not small beside the temperature of a narrow f."""
    if plan.velocity == "hermite":
        return largest
    v = plan.grid.v

    def size(error: Array, f: Array) -> float:
        along_v = f.sum(axis=0)
        square = (v - along_v @ v / along_v.sum()) ** 2
        return max(largest(error, f), largest(error @ square, f @ square))

    return size


def _extrapolated(plan: Plan, representation: Representation) -> Extrapolated:
    counts = STRANG_COUNTS if plan.symmetric else LAWSON_COUNTS
    return Extrapolated(representation.split(), counts, None if plan.symmetric else measured.EXTRAPOLATED_GAIN)


def _tolerance(plan: Plan) -> Callable[[Array], float]:
    """Of a state, the error that its steps may make in a unit of time."""
    share = plan.error_share * plan.inner.accuracy.rtol / plan.memory_time
    return lambda f: share * float(np.abs(f).max())


def _stable(plan: Plan) -> Callable[[Array], float]:
    """The longest step of a state: of Lawson's method that at which its tail is stable; of the exponential method RELAXED,
    in which all but slow waves relax: a longer one only where their remainder, quadratic in what is left of them, is small."""
    friction, rtol = plan.inner.model.friction, plan.inner.accuracy.rtol
    if plan.stepping == "exponential":
        distance = relaxation(plan).distance
        relaxed, small = RELAXED
        return lambda f: max(relaxed, small * rtol / max(distance(f), rtol) ** 2) / friction
    operator = collision_operator(plan)
    if plan.stepping != "extrapolated" or not isinstance(operator, PairCollisions):
        return lambda f: math.inf

    def longest(f: Array) -> float:
        frequency = operator.collision_frequency_max(f)
        return in_t.STABLE / frequency if frequency > 0 else math.inf

    return longest


def _rate(plan: Plan) -> Rate:
    operator = collision_operator(plan)
    assert operator is not None
    return operator.rate


class Early:
    """f at a time too short for the kernel on the plan's velocity points: one step on denser points, on which the Maxwellian
    start is known as well."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._finer: dict[int, tuple[ExactStep, Any]] = {}

    def __call__(self, time: float) -> Array:
        factor = next((n for n in FINER if self._good(time, n)), FINER[-1])
        if factor not in self._finer:
            grid = dataclasses.replace(self.plan.grid, nv=self.plan.grid.nv * factor)
            representation = make_representation(dataclasses.replace(self.plan, grid=grid))
            step: ExactStep = representation.linearised(LINEARISED_ROUND_OFF * self.plan.inner.accuracy.rtol)
            known = representation.lifted_start(step)
            self._finer[factor] = (step, step.lift(representation.start()) if known is None else known)
        step, start = self._finer[factor]
        f = step.lower(step.propagate(start, time), self.plan.waves.blur(time))
        if isinstance(step, GridLinearisedStep):
            step.forget()  # every time is asked for once, and tables grow with the square of the points
        # `factor` fine cells make one of the plan's, whose centre is the middle one's.
        return f[:, factor // 2 :: factor]

    def _good(self, time: float, factor: int) -> bool:
        """Whether so many times denser points do for the kernel."""
        plan, dv = self.plan, self.plan.grid.dv / factor
        wide = dv <= resolved_spacing(
            plan.inner.model, time / 2 if plan.waves.local_gauge else time, resolution(plan.scales.rtol)
        )
        return wide and kernel_sums.good(plan.scales, plan.waves, dv, np.zeros(1), time)
