"""Where momentum and energy come from and go to: rates by term, what each term has brought so far, and the residual."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_interp_spline

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.moments import totals
from kinetic_solver.plan.moving_frame import Frame, Place
from kinetic_solver.theory.ornstein_uhlenbeck import transition

Totals = tuple[float, float, float]
"""Mass, momentum, energy."""


class Ledger:
    """Books what each term of (2) brings to momentum and energy, from the run's states at the ends of its steps.

    dp/dt = gN - γp + c₁ and dE/dt = gp - 2γE + σγN + c₂, with c₁ = ∫∫v C and c₂ = ½∫∫v² C evaluated on f. Without collisions
    their solution is closed, and the residual, total - initial - Σ terms, is what drift-diffusion got wrong. With collisions
    p, E, c₁ and c₂ are integrated in time, and the residual holds that quadrature's error too: over exact steps by the four-point
    Gauss-Legendre rule (`over`), since the state is known at any time; else by a quintic spline through the ends of the steps
    (`step`), which Rules.budget_step keeps short enough unless grid.time_step says otherwise.
    """

    HISTORY = 6

    def __init__(
        self, grid: PhaseSpaceGrid, frame: Frame, operator: CollisionRate | None, f: Array, total: Totals | None = None
    ) -> None:
        self.grid = grid
        """Of the states to come; like `operator` it may be exchanged."""
        self.frame = frame
        self.model = frame.model
        self.operator = operator
        self._nodes: list[tuple[float, Array, Array]] = []
        self._booked = 0
        self._integral: Array = np.zeros(4)
        self._exact = False
        self.start(f, total)
        self.brought = {
            "momentum_from_gravity": 0.0,
            "momentum_from_friction": 0.0,
            "momentum_from_collisions": 0.0,
            "energy_from_gravity": 0.0,
            "energy_from_friction": 0.0,
            "energy_from_noise": 0.0,
            "energy_from_collisions": 0.0,
        }

    def start(self, f: Array, total: Totals | None = None) -> None:
        """The state at time 0."""
        self._nodes.clear()
        self.step(0.0, f, total)
        self.initial = self._nodes[0][1]

    def step(self, clock: float, f: Array, total: Totals | None = None) -> None:
        """A step has ended when the frame's clock shows this. `total`, where not to be summed from f: mass, momentum, energy."""
        place = self.frame.place(clock)
        here = np.array(place.totals(total or totals(self.grid, f)))
        self._nodes.append((place.time, here, self._collisions(f, place)))

    def over(self, state_at: Callable[[float], Array], start: float, end: float) -> None:
        """Integrate over a step, by the frame's clock, whose f is known at any time."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        for node, weight in zip(nodes, weights, strict=True):
            clock = (start + end) / 2 + (end - start) / 2 * node
            f, place = state_at(clock), self.frame.place(clock)
            sample = np.array([*place.totals(totals(self.grid, f))[1:], *self._collisions(f, place)])
            self._integral = self._integral + (end - start) / 2 * weight / place.scale * sample
            self._exact = True

    def mark(self) -> tuple[int, Array]:
        """To come back to with `rewind`, before the next record."""
        return len(self._nodes), self._integral

    def rewind(self, mark: tuple[int, Array]) -> None:
        del self._nodes[mark[0] :]
        self._integral = mark[1]

    def _collisions(self, f: Array, place: Place) -> Array:
        """(c₁, c₂)."""
        if self.operator is None:
            return np.zeros(2)
        _, p, energy = totals(self.grid, self.operator.rate(f))
        return np.array(place.rates((p, energy)))

    def _book(self) -> None:
        """Integrate over the steps since the last record."""
        (start, before, _), (end, _, _) = self._nodes[self._booked], self._nodes[-1]
        mass, p, energy = (float(value) for value in before)
        h = end - start
        if h == 0:
            return
        g, gamma, noise = self.model.gravity, self.model.friction, self.model.noise * self.model.friction
        if self.operator is not None:
            integral = self._integral if self._exact else self._spline_integral(start, end)
            momentum_time, energy_time, c1, c2 = (float(value) for value in integral)
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
        self._integral = np.zeros(4)

    def _spline_integral(self, start: float, end: float) -> Array:
        times = [node[0] for node in self._nodes]
        values = np.array([(*total[1:], *change) for _, total, change in self._nodes])
        return np.asarray(make_interp_spline(times, values, k=min(5, len(times) - 1)).integrate(start, end))

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
