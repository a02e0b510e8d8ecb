"""Where momentum and energy come from and go to: rates by term, what each term has brought so far, and the residual."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.moments import totals
from kinetic_solver.plan import in_t
from kinetic_solver.plan.moving_frame import Place
from kinetic_solver.solver.observation import Observation
from kinetic_solver.theory.ornstein_uhlenbeck import transition

HISTORY = 6
"""Ends of steps that the spline goes through when a frame is booked: as many as a quintic needs to begin with."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Of the Gauss-Legendre rule within an exact step."""


@dataclass(frozen=True)
class Mark:
    """Where the books stood: to come back to with `Ledger.rewind`, before the next record."""

    nodes: int
    integral: Array


class Ledger:
    """Books what each term of (2) brings to momentum and energy, from the run's states at the ends of its steps.

    dp/dt = gN - γp + c₁ and dE/dt = gp - 2γE + σγN + c₂, with c₁ = ∫∫v C and c₂ = ½∫∫v² C evaluated on f. Without collisions
    their solution is closed, and the residual, total - initial - Σ terms, is what drift-diffusion got wrong. With collisions
    p, E, c₁ and c₂ are integrated in time, and the residual holds that quadrature's error too: over exact steps by the four-point
    Gauss-Legendre rule, since f is known within them; else by a quintic spline through the ends of the steps, which
    `in_t.budget_step` keeps short enough unless grid.time_step says otherwise.
    """

    def __init__(self, start: Observation) -> None:
        plan = start.plan
        self.frame = plan.reference_frame
        self.model = plan.reference_frame.model
        self.collide = plan.law is not None
        self._mixing = in_t.mixing_times(plan.scales, plan.waves)
        self._nodes: list[tuple[float, Array, Array]] = []
        self._booked = 0
        self._integral: Array = np.zeros(4)
        """Of (p, E, c₁, c₂) over the exact steps since the last record."""
        self._dense = False
        """Whether f is known within the steps."""
        self.start(start)
        self.brought = {
            "momentum_from_gravity": 0.0,
            "momentum_from_friction": 0.0,
            "momentum_from_collisions": 0.0,
            "energy_from_gravity": 0.0,
            "energy_from_friction": 0.0,
            "energy_from_noise": 0.0,
            "energy_from_collisions": 0.0,
        }

    def start(self, seen: Observation) -> None:
        """The state at time 0."""
        self._nodes.clear()
        self._note(seen)
        self.initial = self._nodes[0][1]

    def step(self, seen: Observation) -> None:
        """A step has ended."""
        self._dense = seen.within is not None
        if self.collide and seen.within is not None:
            self._integrate(seen, seen.within, seen.since, seen.clock)
        self._note(seen)

    def mark(self) -> Mark:
        return Mark(len(self._nodes), self._integral)

    def rewind(self, mark: Mark) -> None:
        del self._nodes[mark.nodes :]
        self._integral = mark.integral

    def state(self) -> dict[str, Any]:
        """All that changes as a run goes on, as a tree (dataset/trees.py)."""
        return {
            "nodes": list(self._nodes),
            "booked": self._booked,
            "integral": self._integral,
            "dense": self._dense,
            "initial": self.initial,
            "brought": dict(self.brought),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self._nodes, self._booked, self._integral = list(state["nodes"]), state["booked"], state["integral"]
        self._dense, self.initial, self.brought = state["dense"], state["initial"], dict(state["brought"])

    def _note(self, seen: Observation) -> None:
        place = self.frame.place(seen.clock)
        self._nodes.append((place.time, np.array(place.totals(seen.totals)), _collisions(seen, seen.f, place)))

    def _integrate(self, seen: Observation, f_at: Callable[[float], Array], start: float, end: float) -> None:
        """Over a step whose f is known at any clock: in pieces while the start's waves mix."""
        within = self._mixing[(self._mixing > start) & (self._mixing < end)].tolist()
        for a, b in itertools.pairwise([start, *within, end]):
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                clock = (a + b) / 2 + (b - a) / 2 * node
                f, place = f_at(clock), self.frame.place(clock)
                sample = np.array([*place.totals(totals(seen.grid, f))[1:], *_collisions(seen, f, place)])
                self._integral = self._integral + (b - a) / 2 * weight / place.scale * sample

    def _book(self) -> None:
        """Integrate over the steps since the last record."""
        (start, before, _), (end, _, _) = self._nodes[self._booked], self._nodes[-1]
        mass, p, energy = (float(value) for value in before)
        h = end - start
        if h == 0:
            return
        g, gamma, noise = self.model.gravity, self.model.friction, self.model.noise * self.model.friction
        if self.collide:
            integral = self._integral if self._dense else self._spline_integral(start, end)
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
        self._nodes = self._nodes[-HISTORY:]
        self._booked = len(self._nodes) - 1
        self._integral = np.zeros(4)

    def _spline_integral(self, start: float, end: float) -> Array:
        times = [node[0] for node in self._nodes]
        values = np.array([(*total[1:], *change) for _, total, change in self._nodes])
        # Here, because it takes as long to load as all of NumPy twice: exact steps book without splines.
        from scipy.interpolate import make_interp_spline

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


def _collisions(seen: Observation, f: Array, place: Place) -> Array:
    """(c₁, c₂), by the laboratory's clock, of an f on the grid that is seen."""
    if seen.scheme.operator is None:
        return np.zeros(2)
    _, p, energy = totals(seen.grid, seen.scheme.operator.rate(f))
    return np.array(place.rates((p, energy)))
