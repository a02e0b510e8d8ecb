"""Which stepper a plan means, and what fills the time before its first exact step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.plan import Plan
from kinetic_solver.solver.representation import Representation, make_representation
from kinetic_solver.stepping import Controlled, ExactStep, ExactSteps, Extrapolated, Plain, Stepper


def make_stepper(plan: Plan, representation: Representation, limited: Callable[[float], bool] | None = None) -> Stepper:
    """The stepper that the plan names."""
    scene, rtol = plan.inner, plan.inner.accuracy.rtol
    longest = math.inf if plan.time_step is None else plan.time_step
    if scene.operator is None:
        return ExactSteps(Plain(representation.linear))
    base = representation.split()
    if plan.stepping == "strang":
        return Controlled(Extrapolated(base), lambda f: math.inf, fixed=plan.time_step)
    method = Extrapolated(base, (1, 2, 3, 4), (2, 4, 6)) if plan.symmetric else Extrapolated(base, (1, 2), (4,))
    share = plan.error_share * rtol / plan.memory_time

    def tolerance(f: Array) -> float:
        return share * float(np.abs(f).max())

    if plan.stepping == "extrapolated":
        return Controlled(method, tolerance, longest, scene.grid.time_step, limited)
    step = representation.linearised(0.05 * rtol)
    early = Early(plan) if plan.shortest_step > 0 and scene.initial.file is None else None
    # Where nx is open, a finer grid is the better way out of a step that loses its accuracy.
    fallback = Controlled(method, tolerance) if scene.grid.nx is not None else None
    return ExactSteps(step, longest, plan.shortest_step, early, fallback)


class Early:
    """f at a time too short for the kernel on the plan's velocity points: one step on points three or nine times as dense,
    on which the Maxwellian start is known as well."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._finer: dict[int, tuple[ExactStep, Any]] = {}

    def __call__(self, time: float) -> Array:
        # The kernel's width goes as the square root of short times.
        factor = next((n for n in (3, 9) if time * n**2 >= self.plan.shortest_step), 9)
        if factor not in self._finer:
            grid = dataclasses.replace(self.plan.grid, nv=self.plan.grid.nv * factor)
            representation = make_representation(dataclasses.replace(self.plan, grid=grid))
            step: ExactStep = representation.linearised(0.05 * self.plan.scene.accuracy.rtol)
            self._finer[factor] = (step, step.lift(representation.start()))
        step, start = self._finer[factor]
        # Three or nine fine cells make one of the plan's, whose centre is the middle one's.
        return step.lower(step.propagate(start, time))[:, factor // 2 :: factor]
