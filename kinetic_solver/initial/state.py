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
    if np.ptp(mean_velocity) == np.ptp(temperature) == 0:
        mean_velocity, temperature = mean_velocity[:1], temperature[:1]  # of one shape at every x
    w = v[None, :] - mean_velocity[:, None]
    theta = temperature[:, None]
    return density[:, None] * np.exp(-(w**2) / (2 * theta)) / np.sqrt(2 * np.pi * theta)


def distribution(scene: Scene, x: Array, v: Array, density: Array | None = None) -> Array:
    """f at time 0 at any places and velocities, shape (nx, nv): Maxwellians, of the scene's density or the one given, or
    eigenmodes."""
    if scene.initial.eigenmodes:
        return eigenmode_state(scene, x, v, fields.start_state(scene)[0])
    rho = fields.density(scene, x) if density is None else density
    parts = [
        maxwellian(rho if share == 1 else share * rho, fields.mean_velocity(scene, x, u), fields.temperature(scene, x, theta), v)
        for share, u, theta in fields.beams(scene)
    ]
    return np.asarray(sum(parts[1:], parts[0]))


def initial_state(scene: Scene, grid: PhaseSpaceGrid, density: Array | None = None) -> Array:
    """f at time 0, shape (nx, nv), of what the scene starts from, a file included."""
    if scene.initial.file is not None:
        return from_file(scene, grid.x, grid.v)
    return distribution(scene, grid.x, grid.v, density)
