"""What is known beforehand of a dataset's errors other than chance: grid, step, cells, number of particles.

Errors are relative to the largest density, temperature and f, and for mean velocities to the larger of |u| and √θ.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability import structure_factor

EXACT = 1e-9
"""Relative error of the closed form: its own is below 1e-13 of max f (exact/solution.py); the rest is room for u and θ, ratios of
its moments."""
HIGHEST = 1000
"""The shortest wave for which `contact_excess` computes S(k); beyond it S - 1 is extrapolated."""
STEP, CELLS = 0.1, 0.025
"""Relative error of particles for a step as long as the shortest time, and for a cell as wide as the shortest length; both
errors are of second order. About twice the largest measured for (6) at R* = 0.3 and 1 and for (12) at ε = 0 and 0.5
(docs/particles_measured.md, "Convergence"; `benchmarks.particles_validation` asserts it)."""


def systematic_parts(dataset: xr.Dataset, scene: Scene) -> dict[str, float]:
    """Name of a source of error → bound on it. What is not known is left out."""
    method = dataset.attrs.get("method")
    if method == "exact":
        return {"closed form": EXACT}
    if method == "particles" and "initial" in dataset.attrs and scene.operator is not None:
        return {}  # the scene does not say what they started from, which cells and steps have to resolve
    if method == "particles":
        return _of_particles(scene)
    estimate = float(np.nanmax(dataset["error_estimate"])) if "error_estimate" in dataset else 0.0
    return {"grid": max(estimate, scene.accuracy.rtol)}


def _of_particles(scene: Scene) -> dict[str, float]:
    from particles.plan import make_plan

    if scene.operator is None:
        return {"exact steps": 0.0}
    try:
        plan = make_plan(scene)
    except SceneError:  # its start is no longer there
        return {}
    step, cells = plan.relative_step, plan.relative_width
    waves = scene.particles.count if plan.single_file else plan.cells
    return {"step": STEP * step**2, "cells": CELLS * cells**2, "finite N": contact_excess(scene, waves)}


def contact_excess(scene: Scene, waves: int) -> float:
    """g(0) - 1 = (2/N) Σ_m (S_m - 1): by how much pairs at contact exceed those of independent particles, N to a replica.

    The sum is over the waves that cells hold, or without cells as many as there are particles; for (6) it grows with their
    number, as its cube root. S is computed at 24 waves up to `HIGHEST` and taken to be a power of m between them, and S - 1 to
    fall as m^(-2/3) beyond. The fields' bias is less for R* ≤ 1, 0.28 of it at most (docs/particles_measured.md); beyond R* =
    1.3 that is not measured.
    """
    if scene.model.friction * scene.model.noise == 0:
        return 0.0
    last = max(8, waves)
    some = np.unique(np.round(np.geomspace(1, min(last, HIGHEST), 24)).astype(int))
    excess = np.maximum(structure_factor(scene, some.tolist()).values - 1, 1e-300)
    known = np.isfinite(excess)
    if not known[0]:
        return math.inf
    some, excess = some[known], excess[known]
    m = np.arange(1, some[-1] + 1)
    total = float(np.exp(np.interp(np.log(m), np.log(some), np.log(excess))).sum())
    total += 3 * excess[-1] * some[-1] ** (2 / 3) * max(0.0, last ** (1 / 3) - some[-1] ** (1 / 3))
    return 2 * total / scene.particles.count
