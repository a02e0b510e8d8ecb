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
    frame = plan.reference_frame

    def quantities(state: Array, rate: Array, clock: float) -> Array:
        place = frame.place(clock)
        _, p, energy = place.totals(representation.totals(state))
        return np.array([p, energy, *place.rates(representation.totals(rate)[1:])]) / place.scale

    return quantities
