"""ρ, u and θ at time 0, on the points of a period, and what the hydrodynamic method refuses to start from."""

from __future__ import annotations

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene


def refuse(scene: Scene) -> None:
    """Raises SceneError for a start that is no field of ρ, u and θ, or that is empty somewhere."""
    start = scene.initial
    if start.file is not None:
        raise SceneError("initial.file: is a state of another method; allowed for hydrodynamics: density, modes or step")
    if start.beams:
        raise SceneError(
            "initial.beams: have a heat flux, or no Gaussian of one temperature, from the start; allowed for hydrodynamics: "
            "mean_velocity and temperature"
        )
    if start.eigenmodes:
        raise SceneError("initial.eigenmodes: are of the kinetic equation; allowed for hydrodynamics: modes, velocity_modes")
    if start.step is not None and start.step.ratio == 0:
        raise SceneError("initial.step.ratio = 0: hydrodynamics has no mean velocity in a vacuum; allowed: above 0")
    points = scene.pipe.length * np.arange(4096) / 4096
    if (low := float(initial.density(scene, points).min()) / start.density) < 1e-6:
        raise SceneError(
            f"initial.modes: the density falls to {low:.1g} of its mean, and hydrodynamics has no mean velocity in a vacuum; "
            "allowed: 1e-6 or more"
        )


def start_fields(scene: Scene, x: Array) -> tuple[Array, Array, Array]:
    """(ρ, u, θ) at the points x of a period; a density step averaged over the cells between them, so that its mass is exact."""
    u0, theta0 = initial.start_state(scene)
    if scene.initial.step is None:
        rho = initial.density(scene, x)
    else:
        dx = scene.pipe.length / x.size
        edges = np.append(x, x[0] + scene.pipe.length) - dx / 2
        rho = np.diff(initial.density_integral(scene, edges)) / dx
    return rho, initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0)
