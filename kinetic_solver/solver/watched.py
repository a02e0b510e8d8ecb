"""What error-controlled steps integrate on their way, for the budgets: made of the stages at which their method looks."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.plan import Plan
from kinetic_solver.solver.representation import Representation
from kinetic_solver.stepping import Watched


def watched_by(plan: Plan, representation: Representation) -> Watched | None:
    """(state, its rate by collisions, clock) → (p, E, c₁, c₂) of budgets.py, over the laboratory's time by the frame's clock;
    None where no budgets are written, and where the method has no rates."""
    if plan.scene.output.budgets is False or not plan.integrates:
        return None
    frame, weights = plan.reference_frame, representation.weights()

    def quantities(state: Array, rate: Array, clock: float) -> Array:
        totals, rates = (np.stack([state.sum(axis=0), rate.sum(axis=0)]) @ weights).tolist()
        place = frame.place(clock)
        return np.array([*place.totals(totals)[1:], *place.rates(rates[1:])]) / place.scale

    return quantities
