"""f at time 0, on the points of a grid."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import fields
from kinetic_solver.initial.eigenmodes import eigenmode_state
from kinetic_solver.initial.from_file import from_file
from kinetic_solver.scene import Scene


def maxwellian(density: Array, mean_velocity: Array, temperature: Array, v: Array) -> Array:
    """ρ N(v; u, θ), shape (nx, nv)."""
    w = v[None, :] - mean_velocity[:, None]
    theta = temperature[:, None]
    return density[:, None] * np.exp(-(w**2) / (2 * theta)) / np.sqrt(2 * np.pi * theta)


def initial_state(scene: Scene, grid: PhaseSpaceGrid, density: Array | None = None) -> Array:
    """f at time 0, shape (nx, nv): Maxwellian, of the scene's density or the one given, or what the scene starts from instead."""
    if scene.initial.file is not None:
        return from_file(scene, grid.x, grid.v)
    u0, theta0 = fields.start_state(scene)
    if scene.initial.eigenmodes:
        return eigenmode_state(scene, grid.x, grid.v, u0)
    return maxwellian(
        fields.density(scene, grid.x) if density is None else density,
        fields.mean_velocity(scene, grid.x, u0),
        fields.temperature(scene, grid.x, theta0),
        grid.v,
    )
