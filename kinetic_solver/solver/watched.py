"""What error-controlled steps integrate on their way, for the budgets: made of the stages at which their method looks."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.plan import Plan
from kinetic_solver.solver.representation import Representation
from kinetic_solver.stepping import Watched


def watched_by(plan: Plan, representation: Representation) -> Watched | None:
    """(state, its rate by collisions, clock) → (p, E, c₁, c₂) of budgets.py, over the laboratory's time by the frame's clock,
    without momentum UM and energy U²M/2 of the frame itself, whose integrals are known (`ReferenceFrame.travelled`);
    None where no budgets are written, and where the method has no rates."""
    if plan.scene.output.budgets is False or not plan.integrates:
        return None
    frame, weights = plan.reference_frame, representation.weights()

    def quantities(state: Array, rate: Array, clock: float) -> Array:
        (_, p, energy), rates = (np.stack([state.sum(axis=0), rate.sum(axis=0)]) @ weights).tolist()
        place = frame.place(clock)
        by_collisions = [change / place.scale for change in place.rates(rates[1:])]
        return np.array([p, place.velocity * p + place.scale * energy, *by_collisions])

    return quantities
