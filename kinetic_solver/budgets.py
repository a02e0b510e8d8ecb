"""Where momentum and energy come from and go to: rates by term, what each term has brought so far, and the residual."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from kinetic_solver.arrays import Array
from kinetic_solver.collisions.protocol import CollisionOperator
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.moments import totals
from kinetic_solver.scene import Model
from kinetic_solver.velocity.ornstein_uhlenbeck import transition


class Ledger:
    """Books what each term of (2) brings to momentum and energy, from the run's states at the ends of its steps.

    dp/dt = gN - γp + c₁ and dE/dt = gp - 2γE + σγN + c₂, with c₁ = ∫∫v C and c₂ = ½∫∫v² C evaluated on f. Without collisions
    their solution is closed, and the residual, total - initial - Σ terms, is what drift-diffusion got wrong. With collisions
    p, E, c₁ and c₂ are integrated in time by a quintic spline through the ends of this record's steps and of a few before; the
    residual then holds that quadrature's error too (Rules.budget_step keeps steps short enough for it to be small).
    """

    HISTORY = 6

    def __init__(self, grid: PhaseSpaceGrid, model: Model, operator: CollisionOperator | None, f: Array) -> None:
        self.grid = grid
        self.model = model
        self.operator = operator
        self.initial = np.array(totals(grid, f))
        self._nodes: list[tuple[float, Array, Array]] = []
        self._booked = 0
        self.step(0.0, f)
        self.brought = {
            "momentum_from_gravity": 0.0,
            "momentum_from_friction": 0.0,
            "momentum_from_collisions": 0.0,
            "energy_from_gravity": 0.0,
            "energy_from_friction": 0.0,
            "energy_from_noise": 0.0,
            "energy_from_collisions": 0.0,
        }

    def step(self, time: float, f: Array) -> None:
        """A step has ended at `time`."""
        change = totals(self.grid, self.operator.rate(f))[1:] if self.operator is not None else (0.0, 0.0)
        self._nodes.append((time, np.array(totals(self.grid, f)), np.array(change)))

    def _book(self) -> None:
        """Integrate over the steps since the last record."""
        (start, before, _), (end, _, _) = self._nodes[self._booked], self._nodes[-1]
        mass, p, energy = (float(value) for value in before)
        h = end - start
        if h == 0:
            return
        g, gamma, noise = self.model.gravity, self.model.friction, self.model.noise * self.model.friction
        if self.operator is not None:
            times = [node[0] for node in self._nodes]
            values = np.array([(*total[1:], *change) for _, total, change in self._nodes])
            spline = make_interp_spline(times, values, k=min(5, len(times) - 1))
            momentum_time, energy_time, c1, c2 = (float(value) for value in spline.integrate(start, end))
            work = g * momentum_time
            friction = (-gamma * momentum_time, -2 * gamma * energy_time)
        else:
            step = transition(self.model, h)
            e, shift = step.decay, step.velocity_shift
            p_new = e * p + shift * mass
            energy_new = e * e * energy + e * shift * p + mass * (shift**2 + step.velocity_variance) / 2
            work = g * (step.drift_time * p + step.displacement_shift * mass)  # g ∫p dt
            friction = (p_new - p - g * mass * h, energy_new - energy - work - noise * mass * h)
            c1 = c2 = 0.0
        self.brought["momentum_from_gravity"] += g * mass * h
        self.brought["momentum_from_friction"] += friction[0]
        self.brought["momentum_from_collisions"] += c1
        self.brought["energy_from_gravity"] += work
        self.brought["energy_from_noise"] += noise * mass * h
        self.brought["energy_from_friction"] += friction[1]
        self.brought["energy_from_collisions"] += c2
        self._nodes = self._nodes[-self.HISTORY :]
        self._booked = len(self._nodes) - 1

    def record(self) -> dict[str, float]:
        """Rates at the end of the last step, the amounts brought since time 0, and the residuals."""
        self._book()
        _, now, (c1, c2) = self._nodes[-1]
        mass, p, energy = (float(value) for value in now)
        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        change = now - self.initial
        moved = {
            kind: sum(value for name, value in self.brought.items() if name.startswith(kind)) for kind in ("momentum", "energy")
        }
        return {
            "momentum_rate_gravity": g * mass,
            "momentum_rate_friction": -gamma * p,
            "momentum_rate_collisions": float(c1),
            "energy_rate_gravity": g * p,
            "energy_rate_friction": -2 * gamma * energy,
            "energy_rate_noise": sigma * gamma * mass,
            "energy_rate_collisions": float(c2),
            **self.brought,
            "mass_residual": float(change[0]),
            "momentum_residual": float(change[1] - moved["momentum"]),
            "energy_residual": float(change[2] - moved["energy"]),
        }
