"""Everything that a plan means, built: how f is held, which collision operator acts, and what steps it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.linearised import GridLinearisedStep
from kinetic_solver.operators.velocity.kernel import RESOLVED
from kinetic_solver.plan import Plan, in_t
from kinetic_solver.solver.representation import Representation, collision_operator, make_representation
from kinetic_solver.solver.watched import watched_by
from kinetic_solver.stepping import Controlled, ExactStep, ExactSteps, Extrapolated, Fixed, Plain, Stepper

LINEARISED_ROUND_OFF = 0.05
"""Of rtol, to the round-off of the exactly linearised step of (6): it decides between its gauges. Chosen."""
FINER = (3, 9)
"""How many times denser the points may be on which a start is stepped to a time too early for the kernel on the plan's: odd, so
that the plan's points are among them. The kernel's width goes as the square root of short times."""
STRANG_COUNTS, LAWSON_COUNTS = (1, 2, 3, 4), (1, 2)
"""Steps of the base method that are extrapolated: to order 8, and to order 5. Why these: docs/performance.md."""


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
    scene, rtol = plan.inner, plan.inner.accuracy.rtol
    longest = math.inf if plan.time_step is None else plan.time_step
    if plan.law is None:
        return ExactSteps(Plain(representation.linear), longest)
    base = representation.split()
    if plan.stepping == "strang":
        assert plan.time_step is not None
        return Fixed(Extrapolated(base), plan.time_step)
    method = Extrapolated(base, STRANG_COUNTS if plan.symmetric else LAWSON_COUNTS)
    share = plan.error_share * rtol / plan.memory_time

    def tolerance(f: Array) -> float:
        return share * float(np.abs(f).max())

    if plan.stepping == "extrapolated":
        given, watched = scene.grid.time_step, watched_by(plan, representation)
        return Fixed(method, given, watched) if given is not None else Controlled(method, tolerance, longest, watched)
    step = representation.linearised(LINEARISED_ROUND_OFF * rtol)
    aside = in_t.shortest_exact_step(plan.scales, plan.waves, plan.grid, RESOLVED) if plan.shortest_step > 0 else 0.0
    early = Early(plan, aside) if aside > 0 and scene.initial.file is None else None
    # Where nx is open, a finer grid is the better way out of a step that loses its accuracy; but not of a jump.
    given = scene.grid.nx is not None or plan.waves.products_of_a_step
    fallback = Controlled(method, tolerance) if given else None
    start = representation.lifted_start(step)
    return ExactSteps(step, longest, plan.shortest_step, min(aside, longest), early, fallback, start, plan.waves.blur)


class Early:
    """f at a time too short for the kernel on the plan's velocity points: one step on denser points, on which the Maxwellian
    start is known as well."""

    def __init__(self, plan: Plan, resolved: float) -> None:
        """`resolved`: the time from which the plan's own points hold the kernel."""
        self.plan = plan
        self._resolved = resolved
        self._finer: dict[int, tuple[ExactStep, Any]] = {}

    def __call__(self, time: float) -> Array:
        factor = next((n for n in FINER if time * n**2 >= self._resolved), FINER[-1])
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
