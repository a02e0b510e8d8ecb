"""Where momentum and energy come from and go to: rates by term, what each term has brought so far, and the residual."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.moments import totals
from kinetic_solver.scene import Model
from kinetic_solver.velocity.ornstein_uhlenbeck import transition


class Ledger:
    """Books every substep's change of mass, momentum and energy under the term of (2) that caused it.

    Collisions are booked as the change they made. Gravity, friction and noise share a linear substep; theirs follow from
    its totals at the start, since those obey closed equations: dp/dt = gN - γp and dE/dt = gp - 2γE + σγN. The residual,
    total - initial - Σ terms, is then the error that drift-diffusion made: discretisation in v and the window's edges.
    """

    def __init__(self, grid: PhaseSpaceGrid, model: Model, f: Array) -> None:
        self.grid = grid
        self.model = model
        self.initial = np.array(totals(grid, f))
        self.now = self.initial.copy()
        self.brought = {
            "momentum_from_gravity": 0.0,
            "momentum_from_friction": 0.0,
            "momentum_from_collisions": 0.0,
            "energy_from_gravity": 0.0,
            "energy_from_friction": 0.0,
            "energy_from_noise": 0.0,
            "energy_from_collisions": 0.0,
        }

    def collision(self, after: Array) -> None:
        new = np.array(totals(self.grid, after))
        self.brought["momentum_from_collisions"] += new[1] - self.now[1]
        self.brought["energy_from_collisions"] += new[2] - self.now[2]
        self.now = new

    def linear(self, after: Array, h: float) -> None:
        mass, p, energy = self.now
        g, noise = self.model.gravity, self.model.noise * self.model.friction
        step = transition(self.model, h)
        e, shift = step.decay, step.velocity_shift
        p_new = e * p + shift * mass
        energy_new = e * e * energy + e * shift * p + mass * (shift**2 + step.velocity_variance) / 2
        gravity = g * mass * h
        work = g * (step.drift_time * p + step.displacement_shift * mass)  # g ∫p dt
        self.brought["momentum_from_gravity"] += gravity
        self.brought["momentum_from_friction"] += p_new - p - gravity
        self.brought["energy_from_gravity"] += work
        self.brought["energy_from_noise"] += noise * mass * h
        self.brought["energy_from_friction"] += energy_new - energy - work - noise * mass * h
        self.now = np.array(totals(self.grid, after))

    def record(self, collision_rate: Array | None) -> dict[str, float]:
        """Rates at this time, the amounts brought since time 0, and the residuals."""
        mass, p, energy = self.now
        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        _, c1, c2 = totals(self.grid, collision_rate) if collision_rate is not None else (0.0, 0.0, 0.0)
        change = self.now - self.initial
        moved = {
            kind: sum(value for name, value in self.brought.items() if name.startswith(kind)) for kind in ("momentum", "energy")
        }
        return {
            "momentum_rate_gravity": g * mass,
            "momentum_rate_friction": -gamma * p,
            "momentum_rate_collisions": c1,
            "energy_rate_gravity": g * p,
            "energy_rate_friction": -2 * gamma * energy,
            "energy_rate_noise": sigma * gamma * mass,
            "energy_rate_collisions": c2,
            **self.brought,
            "mass_residual": float(change[0]),
            "momentum_residual": float(change[1] - moved["momentum"]),
            "energy_residual": float(change[2] - moved["energy"]),
        }
