"""Where the closure's momentum and energy come from and go to, by term, as the grid solver says of f.

dp/dt = gN - γp + c₁ and dE/dt = gp - 2γE + σγN + c₂, with c₁ = -∫Sρ²θ and c₂ = -∫(Suρ²θ + Cρ²θ^{3/2}). Their integrals over a
step are the Runge-Kutta method's own: the same nodes and weights, the same order 3. Test: tests/hydrodynamics/test_budgets.py.
"""

from __future__ import annotations

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.gas import Gas
from kinetic_solver.scene import Model


@numba.njit(cache=True)
def _sums(state: Array, drag: float, cooling: float) -> tuple[float, float, float, float, float]:
    """Of ρ, ρu, E and what collisions do to the latter two."""
    mass, momentum, energy, force, heat = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(state.shape[1]):
        rho, m = state[0, i], state[1, i]
        theta = (2 * state[2, i] - m * m / rho) / rho
        mass += rho
        momentum += m
        energy += state[2, i]
        force -= drag * rho * rho * theta
        heat -= drag * m * rho * theta + cooling * rho * rho * theta**1.5
    return mass, momentum, energy, force, heat


def sample(gas: Gas, state: Array, dx: float, frame: float) -> Array:
    """(p, E, c₁, c₂) in the laboratory of a state seen from a frame of that velocity, shape (4,)."""
    mass, p, energy, force, heat = _sums(state, gas.drag, gas.cooling)
    return dx * np.array([p + frame * mass, energy + frame * p + 0.5 * frame**2 * mass, force, heat + frame * force])


def budget(model: Model, time: float, start: Array, now: Array, at: Array, integral: Array) -> dict[str, float]:
    """The group `budgets` of a frame: `start` and `now` are mass, momentum and energy at time 0 and now, `at` the sample now, and
    `integral` its integral since time 0."""
    g, gamma, sigma = model.gravity, model.friction, model.noise
    mass, p, energy = (float(value) for value in now)
    brought = {
        "momentum_from_gravity": g * mass * time,
        "momentum_from_friction": -gamma * float(integral[0]),
        "momentum_from_collisions": float(integral[2]),
        "energy_from_gravity": g * float(integral[0]),
        "energy_from_friction": -2 * gamma * float(integral[1]),
        "energy_from_noise": sigma * gamma * mass * time,
        "energy_from_collisions": float(integral[3]),
    }
    gained = {kind: sum(value for name, value in brought.items() if name.startswith(kind)) for kind in ("momentum", "energy")}
    return {
        "momentum_rate_gravity": g * mass,
        "momentum_rate_friction": -gamma * p,
        "momentum_rate_collisions": float(at[2]),
        "energy_rate_gravity": g * p,
        "energy_rate_friction": -2 * gamma * energy,
        "energy_rate_noise": sigma * gamma * mass,
        "energy_rate_collisions": float(at[3]),
        **brought,
        "mass_residual": float(now[0] - start[0]),
        "momentum_residual": float(now[1] - start[1]) - gained["momentum"],
        "energy_residual": float(now[2] - start[2]) - gained["energy"],
    }
