"""What a run of particles writes: the grid solver's schema, with standard errors and each replica's share."""

from __future__ import annotations

import numpy as np

from kinetic_solver.dataset import VARIABLES, Variables
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene
from particles.estimators import MODES


def written_bytes(scene: Scene, grid: PhaseSpaceGrid) -> int:
    """Of the arrays of one frame."""
    points = grid.nx * grid.nv * (2 + scene.particles.replicas) + 20 * scene.particles.replicas * (grid.nx + grid.nv)
    particles = 2 * scene.particles.count * scene.particles.replicas if scene.output.particles else 0
    return 8 * (points + particles)


def coordinates(scene: Scene, grid: PhaseSpaceGrid) -> dict[str, np.ndarray]:
    """Those beside time, x and v. One point in x holds no waves."""
    waves = min(MODES, (grid.nx - 1) // 2)
    particles = scene.particles
    result = {"replica": np.arange(particles.replicas, dtype=np.int32)}
    if waves:
        result["mode"] = np.arange(1, waves + 1, dtype=np.int32)
    if scene.output.particles:
        result["particle"] = np.arange(particles.count, dtype=np.int32)
    return result


def variables(scene: Scene, grid: PhaseSpaceGrid) -> Variables:
    """Group → name → (dimensions beside time, units, long name)."""
    known = {"x", "v", *coordinates(scene, grid)}
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

GROUPS = tuple(_TABLE)
"""The groups of `[output]` that particles have."""
