"""What a run of particles writes: the grid solver's schema, with standard errors and each replica's share."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import VARIABLES, Variables
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import INELASTIC, Scene
from particles.estimators import MODES
from particles.single_file import sticking

if TYPE_CHECKING:
    from particles.plan import ParticlePlan


def frame_times(scene: Scene) -> Array:
    """All times at which any group is written."""
    times = [scene.times(getattr(scene.output, group)) for group in _TABLE]
    merged = np.unique(np.concatenate(times))
    apart = np.diff(merged, prepend=-math.inf) > _tolerance(scene)
    return np.asarray(merged[apart])


def due(scene: Scene, group: str, time: float) -> bool:
    times = scene.times(getattr(scene.output, group))
    return bool(times.size) and bool(np.abs(times - time).min() <= _tolerance(scene))


def _tolerance(scene: Scene) -> float:
    """Times of two cadences are the same within this: rounding, far below any cadence."""
    cadences = [getattr(scene.output, group) for group in _TABLE]
    return 1e-6 * min([scene.output_every, *(float(c) for c in cadences if not isinstance(c, bool))])


def written_bytes(scene: Scene, grid: PhaseSpaceGrid) -> int:
    """Of the arrays of one frame."""
    points = grid.nx * grid.nv * (2 + scene.particles.replicas) + 20 * scene.particles.replicas * (grid.nx + grid.nv)
    particles = 2 * scene.particles.count * scene.particles.replicas if scene.output.particles else 0
    return 8 * (points + particles)


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
        said["cells"] = f"{plan.cells}, of {plan.cell_width:.4g}; mean free path 1/(Sρ) = {plan.mean_free_path:.4g}"
        if plan.cell_width > plan.mean_free_path:
            said["warning"] = "cells are wider than the mean free path: raise particles.cells, and particles.count with them"
        return said
    said["overtakings"] = f"collisions with the probability S_C·w = {plan.probability:.4g}"
    stuck = sticking(plan.probability, plan.scene.model.friction * plan.longest_step)
    model = plan.scene.model
    if model.friction * model.noise > 0 and (plan.scene.operator != INELASTIC or plan.scene.restitution == 0):
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
    if plan.scene.operator is not None:
        result += [(label, said[label]) for label in ("cells", "overtakings") if label in said]
    result += [("time step", said["time_step"]), ("memory", f"{plan.memory / 2**20:.3g} MiB")]
    return result + [(label, text) for label, text in said.items() if label == "warning"]


def coordinates(plan: ParticlePlan) -> dict[str, np.ndarray]:
    """Those beside time, x and v. One point in x holds no waves."""
    waves = min(MODES, (plan.grid.nx - 1) // 2)
    particles = plan.scene.particles
    result = {"replica": np.arange(particles.replicas, dtype=np.int32)}
    if waves:
        result["mode"] = np.arange(1, waves + 1, dtype=np.int32)
    if plan.scene.output.particles:
        result["particle"] = np.arange(particles.count, dtype=np.int32)
    return result


def variables(plan: ParticlePlan) -> Variables:
    """Group → name → (dimensions beside time, units, long name)."""
    known = {"x", "v", *coordinates(plan)}
    return {g: {name: row for name, row in table.items() if set(row[0]) <= known} for g, table in _TABLE.items()}


def _with_errors(group: str, names: tuple[str, ...]) -> dict[str, tuple[tuple[str, ...], str, str]]:
    table = {}
    for name in names:
        dimensions, units, text = VARIABLES[group][name]
        table[name] = (dimensions, units, text)
        table[f"{name}_stderr"] = (dimensions, units, f"standard error over replicas of {text}")
        if name != "f":
            table[f"{name}_replica"] = (("replica", *dimensions), units, f"share of each replica in {text}")
    return table


_TABLE: Variables = {
    "f": _with_errors("f", ("f",)),
    "moments": {
        **_with_errors("moments", ("density", "mean_velocity", "temperature", "velocity_distribution")),
        "heat_flux": VARIABLES["moments"]["heat_flux"],
    },
    "scalars": {
        **_with_errors("scalars", ("mass", "momentum", "energy")),
        "density_mode_real": (("replica", "mode"), "1", "real part of (1/L)∫ρ exp(-ikx) dx over the mean density"),
        "density_mode_imag": (("replica", "mode"), "1", "imaginary part of it"),
        "outside_window": ((), "1", "share of the particles outside the velocity window, missing in f"),
        "candidates": ((), "1", "candidate pairs since time 0, of all replicas"),
        "collisions": ((), "1", "collisions since time 0, of all replicas"),
    },
    "particles": {
        "position": (("replica", "particle"), "length", "positions, in no lasting order"),
        "velocity": (("replica", "particle"), "length time-1", "velocities, in the order of the positions"),
    },
}
