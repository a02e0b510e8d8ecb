"""The homogeneous state of (12) on the solver's grid, and the linear relaxation towards it: shared by all runs of a process."""

from __future__ import annotations

import functools
import math

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.collisions import on_points
from kinetic_solver.operators.relaxation import Generators, Relaxation
from kinetic_solver.plan import Plan
from kinetic_solver.rounding import rounded
from kinetic_solver.scene import Model
from kinetic_solver.stability.inelastic import inelastic_flow

KEPT = 2
"""Grids whose tables stay for the next run: that of a run's beginning, and what it shrank to."""


def relaxation(plan: Plan) -> Relaxation:
    """About the homogeneous state at the mean density, for a plan with (12), friction and noise, on velocity points."""
    assert isinstance(plan.law, Inelastic)
    density = rounded(float(plan.scales.density.mean()))
    return Relaxation(_generators(plan.grid, plan.inner.model, plan.law, density, plan.deposit or "quintic"))


@functools.lru_cache(maxsize=KEPT)
def _generators(grid: PhaseSpaceGrid, model: Model, law: Inelastic, density: float, deposit: str) -> Generators:
    width, mean = math.sqrt(model.noise), model.gravity / model.friction
    flow = inelastic_flow(law.restitution, law.cross_section * density * width / model.friction)
    f = density * flow.distribution((grid.v - mean) / width).real / width
    return Generators(grid, model, on_points(law, grid.v, deposit), f)
