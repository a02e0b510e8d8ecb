"""Where momentum and energy come from and go to: rates by term, what each term has brought so far, and the residual."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions import FollowLeader
from kinetic_solver.operators.moments import totals, velocity_moments
from kinetic_solver.plan import in_t
from kinetic_solver.plan.moving_frame import Place
from kinetic_solver.solver.observation import Observation
from kinetic_solver.theory.ornstein_uhlenbeck import transition

HISTORY = 6
"""Ends of steps that the spline goes through when a frame is booked: as many as a quintic needs to begin with."""
NODES, WEIGHTS = legendre.leggauss(8)
"""On a piece of an exact step. Integrals up to a time within it are those of the polynomial through all of them. Chosen: four
left residuals of 1.5e-5 of what gravity brings, where a start has waves of mode 4 (tests/convergence/test_frames.py)."""
PRIMITIVE = legendre.legint(legendre.legvander(NODES, NODES.size - 1).T * WEIGHTS * (np.arange(NODES.size) + 0.5)[:, None])
"""From values at the nodes to Legendre coefficients of that polynomial's integral from 0."""


@dataclass(frozen=True)
class Mark:
    """Where the books stood: to come back to with `Ledger.rewind`, before the next record."""

    nodes: int
    integral: Array


@dataclass(frozen=True)
class _Piece:
    """An interval on which the integrals up to any time are known."""

    start: float
    end: float
    antiderivative: Array
    """Its Legendre coefficients on [-1, 1], one more than nodes; (nodes + 1, 4)."""

    def between(self, since: float, until: float) -> Array:
        half = (self.end - self.start) / 2
        places = (np.array([since, until]) - self.start) / half - 1
        at = legendre.legval(places, self.antiderivative)
        return np.asarray(half * (at[:, 1] - at[:, 0]))


class Ledger:
    """Books what each term of (2) brings to momentum and energy, from the run's states at the ends of its steps.

    dp/dt = gN - γp + c₁ and dE/dt = gp - 2γE + σγN + c₂, with c₁ = ∫∫v C and c₂ = ½∫∫v² C evaluated on f. Without collisions
    their solution is closed, and the residual, total - initial - Σ terms, is what drift-diffusion got wrong. With collisions
    p, E, c₁ and c₂ are integrated in time, and the residual holds that quadrature's error too: over exact steps by Gauss-Legendre
    nodes, since f is known within them; over error-controlled steps by the stages at which Lawson's method looks; else, with
    Strang's, by a quintic spline through the ends of the steps, which `in_t.budget_step` keeps short enough unless
    grid.time_step says otherwise.
    """

    def __init__(self, start: Observation) -> None:
        plan = start.plan
        self.frame = plan.reference_frame
        self.model = plan.reference_frame.model
        self.collide = plan.law is not None
        self.splines = self.collide and plan.stepping != "exact" and not plan.integrates
        """Whether integrals over time are those of a spline."""
        self._watched = self.collide and plan.integrates
        """Whether steps bring their integrals, without the frame's own motion (watched.py)."""
        self._ends = in_t.budget_pieces(plan.scales, plan.waves)
        self._nodes: list[tuple[float, Array, Array]] = []
        self._booked = 0
        self._integral: Array = np.zeros(4)
        """Of (p, E, c₁, c₂) over the steps since the last record, but for those of a spline."""
        self._piece: _Piece | None = None
        """The last that was looked at."""
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
        if seen.integral is not None:
            self._integral = self._integral + seen.integral
        elif self.collide and seen.within is not None:
            self._integrate(seen)
        self._note(seen)

    def mark(self) -> Mark:
        return Mark(len(self._nodes), self._integral)

    def rewind(self, mark: Mark) -> None:
        del self._nodes[mark.nodes :]
        self._integral = mark.integral
        self._piece = None

    def state(self) -> dict[str, Any]:
        """All that changes as a run goes on, as a tree (dataset/trees.py)."""
        return {
            "nodes": list(self._nodes),
            "booked": self._booked,
            "integral": self._integral,
            "initial": self.initial,
            "brought": dict(self.brought),
            "piece": None if self._piece is None else (self._piece.start, self._piece.end, self._piece.antiderivative),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self._nodes, self._booked, self._integral = list(state["nodes"]), state["booked"], state["integral"]
        self.initial, self.brought = state["initial"], dict(state["brought"])
        self._piece = None if state["piece"] is None else _Piece(*state["piece"])

    def _note(self, seen: Observation) -> None:
        place = self.frame.place(seen.clock)
        change = _collisions(seen, place) if self.splines else np.zeros(2)
        self._nodes.append((place.time, np.array(place.totals(seen.totals)), change))

    def _integrate(self, seen: Observation) -> None:
        """Over a step, in pieces that no frame changes: between links, shorter ones while the start's waves mix."""
        assert seen.stretch is not None
        start, end = seen.stretch
        inner = self._ends[(self._ends > start) & (self._ends < end)].tolist()
        for a, b in itertools.pairwise([start, *inner, end]):
            since, until = max(a, seen.since), min(b, seen.clock)
            if since < until:
                if self._piece is None or (self._piece.start, self._piece.end) != (a, b):
                    self._piece = _Piece(a, b, PRIMITIVE @ self._samples(seen, a, b))
                self._integral = self._integral + self._piece.between(since, until)

    def _samples(self, seen: Observation, start: float, end: float) -> Array:
        """(p, E, c₁, c₂), by the laboratory's clock, at the nodes of an interval; (nodes, 4)."""
        assert seen.within is not None
        assert seen.moments_within is not None
        clocks = ((start + end) / 2 + (end - start) / 2 * NODES).tolist()
        all_moments = seen.moments_within(clocks)
        if all_moments is None:
            all_moments = np.array([velocity_moments(seen.grid, seen.within(clock)) for clock in clocks])
        operator = seen.scheme.operator
        assert isinstance(operator, FollowLeader)
        totals = (all_moments[:, :3].sum(axis=2) * seen.grid.dx).tolist()
        changes = np.transpose(operator.brought(all_moments, seen.grid.dx)).tolist()
        found = []
        for clock, (mass, p, energy), change in zip(clocks, totals, changes, strict=True):
            place = self.frame.place(clock)
            found.append([number / place.scale for number in (*place.totals((mass, p, energy / 2))[1:], *place.rates(change))])
        return np.array(found)

    def _book(self) -> None:
        """Integrate over the steps since the last record."""
        (start, before, _), (end, _, _) = self._nodes[self._booked], self._nodes[-1]
        mass, p, energy = (float(value) for value in before)
        h = end - start
        if h == 0:
            return
        g, gamma, noise = self.model.gravity, self.model.friction, self.model.noise * self.model.friction
        if self.collide:
            integral = self._spline_integral(start, end) if self.splines else self._integral
            if self._watched and self.frame.moving:
                own = np.array(self.frame.travelled(end)) - self.frame.travelled(start)
                integral = integral + np.append(mass * own, np.zeros(2))
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
        known = np.zeros(4)
        if self.frame.noiseless:
            # By the frame's clock what it moves is smooth, and its own motion, ever longer while the clock shows less, is known.
            places = [self.frame.place(self.frame.clock(time)) for time in times]
            mass = float(self._nodes[-1][1][0])
            u, scale = np.array([(place.velocity, place.scale) for place in places]).T
            values[:, 0] -= u * mass
            values[:, 1] -= u * u * mass / 2
            values /= scale[:, None]
            known[:2] = mass * (np.array(self.frame.travelled(end)) - self.frame.travelled(start))
            times, start, end = [self.frame.clock(time) for time in times], self.frame.clock(start), self.frame.clock(end)
        # Here, because it takes as long to load as all of NumPy twice: exact steps book without splines.
        from scipy.interpolate import make_interp_spline

        return known + make_interp_spline(times, values, k=min(5, len(times) - 1)).integrate(start, end)

    def record(self, seen: Observation) -> dict[str, float]:
        """Rates at the end of the last step, which is seen, the amounts brought since time 0, and the residuals."""
        self._book()
        _, now, _ = self._nodes[-1]
        c1, c2 = _collisions(seen, self.frame.place(seen.clock))
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


def _collisions(seen: Observation, place: Place) -> Array:
    """(c₁, c₂), by the laboratory's clock, of what is seen."""
    operator = seen.scheme.operator
    if operator is None:
        return np.zeros(2)
    if isinstance(operator, FollowLeader):
        p, energy = (float(rate) for rate in operator.brought(velocity_moments(seen.grid, seen.f), seen.grid.dx))
    else:
        _, p, energy = totals(seen.grid, operator.rate(seen.f))
    return np.array(place.rates((p, energy)))
