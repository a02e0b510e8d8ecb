"""A twin of the closure in another discretisation and other variables: (3)-(5) as printed, Fourier transforms in x, DOP853 in
t."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.scene import INELASTIC, Scene

Twin = Callable[[Scene, int], Array]


@pytest.fixture(scope="session")
def primitive_twin() -> Twin:
    """twin(scene, n): (ρ, u, θ) at the scene's end on n points, n odd; for smooth flow, to 1e-11."""

    def twin(scene: Scene, n: int) -> Array:
        x = scene.pipe.length * np.arange(n) / n
        ik = 2j * np.pi * np.fft.rfftfreq(n, scene.pipe.length / n)
        g, gamma, sigma, s = scene.model.gravity, scene.model.friction, scene.model.noise, scene.cross_section
        inelastic = scene.operator == INELASTIC

        def rate(_: float, flat: Array) -> Array:
            rho, u, theta = y = flat.reshape(3, n)
            drho, du, dtheta = np.fft.irfft(ik * np.fft.rfft(y, axis=1), n=n, axis=1)
            momentum = 0.0 if inelastic else -s * rho**2 * theta
            square = -2 * s * u * rho**2 * theta
            if inelastic:
                square = -2 * s * (1 - scene.restitution**2) / np.sqrt(np.pi) * rho**2 * theta**1.5
            return np.concatenate(
                [
                    -u * drho - rho * du,
                    -u * du - (rho * dtheta + theta * drho) / rho + g - gamma * u + momentum / rho,
                    -u * dtheta - 2 * theta * du - 2 * gamma * (theta - sigma) - 2 * u * momentum / rho + square / rho,
                ]
            )

        u0, theta0 = initial.start_state(scene)
        start = [initial.density(scene, x), initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0)]
        end = scene.run.end_time
        return solve_ivp(rate, (0.0, end), np.concatenate(start), "DOP853", [end], rtol=1e-12, atol=1e-13).y.reshape(3, n)

    return twin
