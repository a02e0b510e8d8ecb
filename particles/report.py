"""What a run of particles says of itself: as attributes of its dataset, and in `describe`."""

from __future__ import annotations

import math

from particles.plan import ParticlePlan
from particles.single_file import sticking

STICKING = 0.1
"""Beyond this share single-file collisions depend on the step (`single_file.sticking`)."""


def report(plan: ParticlePlan) -> dict[str, str]:
    """Attributes: cells or probabilities, step, and a warning where they are not what a converged run needs."""
    said = {
        "time_step": "none: one exact step from frame to frame"
        if math.isinf(plan.time_step)
        else f"{plan.time_step:.6g} at most",
        "weight": f"{plan.weight:.6g} real particles each",
    }
    if not plan.single_file:
        path = f"mean free path 1/(Sρ) = {plan.mean_free_path:.4g}, at the largest density of the start"
        said["cells"] = f"{plan.cells}, of {plan.cell_width:.4g}; {path}"
        if plan.cell_width > plan.mean_free_path:
            said["warning"] = "cells are wider than the mean free path: raise particles.cells, and particles.count with them"
        return said
    said["overtakings"] = f"collisions with the probability S_C·w = {plan.probability:.4g}"
    stuck = sticking(plan.probability, plan.scene.model.friction * plan.longest_step)
    model = plan.scene.model
    if model.friction * model.noise > 0 and plan.sticks:
        said["overtakings"] += f"; {stuck:.2g} of the pairs that collide do so again before they part"
        if stuck > STICKING:
            said["warning"] = (
                f"{stuck:.2g} of the pairs that collide do so again before they part, ever more with shorter steps: the result "
                "depends on particles.time_step; raise particles.count"
            )
    return said


def rows(plan: ParticlePlan) -> list[tuple[str, str]]:
    """What `describe` says of the run."""
    particles, said = plan.scene.particles, report(plan)
    result = [("particles", f"{particles.count} in each of {particles.replicas} replicas; {said['weight']}")]
    if plan.law is not None:
        result += [(label, said[label]) for label in ("cells", "overtakings") if label in said]
    result += [("time step", said["time_step"]), ("memory", f"{plan.memory / 2**20:.3g} MiB")]
    return result + [(label, text) for label, text in said.items() if label == "warning"]
