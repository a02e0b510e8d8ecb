"""What a run knows of its own error, relative to max f, part by part."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions import Inelastic
from kinetic_solver.operators.collisions.inelastic import POINTS
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.plan import Plan
from kinetic_solver.plan.rules import FINITE_VOLUME_ERROR, Rules
from kinetic_solver.scene import FOLLOW_LEADER
from kinetic_solver.solver.regrid import resize

PARTS = {
    "error_time": "the steps in time (grid.time_step)",
    "error_x": "the waves in x (grid.nx)",
    "error_v": "the spacing in v (grid.nv)",
    "error_window": "the velocity window (grid.velocity_window)",
}


class ErrorEstimate:
    """Each part is the largest since time 0, but for that of the steps, forgotten as the flow forgets them.

    - time: estimated errors of the extrapolated steps, times what (6) may make of them; Strang's by its rule; exact steps have
      none.
    - x: the waves of the highest eighth, or what the linearised step of (6) misses of the density; without collisions none,
      but for the waves of a density step that the grid leaves out.
    - v: the shortest waves in v that the points hold; with (12) the difference that twice the points make to the collision
      rate, times how long it acts; with finite volumes their rule; in Hermite functions the last coefficients.
    - window: f at its edges, the slow one amplified as (6) does.

    Held against true errors in tests/convergence/test_estimate.py.
    """

    def __init__(self, plan: Plan, rules: Rules) -> None:
        self.plan = plan
        """May be exchanged for one of another grid."""
        self._of_steps = 0.0
        self._amplified = math.exp(0.3 * rules.amplification()) if plan.inner.operator == FOLLOW_LEADER else 1.0
        if plan.stepping == "strang" and plan.time_step is not None:
            self._of_steps = rules.strang_coefficient() * (rules.rate() * plan.time_step) ** 2
        self._collision_rate = rules.collision_rate() * (1 - plan.inner.restitution**2)
        self._finite_volumes = 0.0
        if plan.velocity != "hermite" and plan.drift_diffusion != "kernel":
            order = FINITE_VOLUME_ERROR[plan.drift_diffusion][1]
            self._finite_volumes = plan.inner.accuracy.rtol / rules.finite_volume_spacing(plan.drift_diffusion) ** order
        self._parts = dict.fromkeys(PARTS, 0.0)

    def step(self, error: float, length: float, f: Array) -> None:
        """A step of this length has ended, with this estimate of its own error."""
        if self.plan.stepping == "extrapolated":
            kept = math.exp(-length / self.plan.memory_time)
            self._of_steps = kept * self._of_steps + self._amplified * error / float(np.abs(f).max())

    def parts(
        self, state: Array, f: Array, clock: float, diagnostics: dict[str, float], operator: CollisionRate | None
    ) -> dict[str, float]:
        """All parts, and `error_estimate`, their sum."""
        now = {"error_window": max(diagnostics["edge_error_low"], diagnostics["edge_error_high"])}
        if clock > 0:
            now |= {"error_x": self._of_x(f, diagnostics), "error_v": self._of_v(state, f, clock, operator)}
        self._parts = {name: max(self._parts[name], now.get(name, 0.0)) for name in PARTS}
        if clock == 0:
            return dict.fromkeys(("error_estimate", *PARTS), 0.0)  # what is shown then is the start itself
        self._parts["error_time"] = self._of_steps if clock > 0 else 0.0
        return {"error_estimate": sum(self._parts.values()), **self._parts}

    @property
    def total(self) -> float:
        return sum(self._parts.values())

    def limited_by(self) -> str:
        """The largest part, in words."""
        name = max(self._parts, key=lambda part: self._parts[part])
        return f"{PARTS[name]}: {self._parts[name]:.2g} of max f"

    def enough_velocities(self, f: Array, clock: float, operator: CollisionRate | None) -> int:
        """The nv, on the same window, with which the collision rate would be good to a twentieth of rtol, and f's waves to a
        fortieth."""
        nv, rtol = self.plan.grid.nv, self.plan.inner.accuracy.rtol
        if not isinstance(operator, Inelastic) or self._finite_volumes:
            return nv
        error = self.of_deposits(f, self.plan.inner.run.end_time, operator)
        order = POINTS[operator.deposit]
        by_deposit = nv * (error / (0.05 * rtol)) ** (1 / order) if error > 0 else 0.0
        amplitude = np.abs(np.fft.rfft(f, axis=1)).max(axis=0)
        waves = int(np.flatnonzero(amplitude > rtol / 40 * amplitude.max())[-1])
        return min(nv, max(math.ceil(by_deposit), 2 * waves + 4))

    def _of_x(self, f: Array, diagnostics: dict[str, float]) -> float:
        if self.plan.grid.nx == 1:
            return 0.0
        if self.plan.inner.operator is None:
            if self.plan.inner.initial.step is None:
                return 0.0  # waves do not couple, and those of the start are all there
            amplitude = np.abs(np.fft.rfft(f, axis=0)).max(axis=1)
            return float(amplitude[-1] / amplitude.max())
        return max(diagnostics["spectral_tail"], diagnostics["density_defect"])

    def _of_v(self, state: Array, f: Array, clock: float, operator: CollisionRate | None) -> float:
        if self.plan.velocity == "hermite":
            size = np.abs(state).max(axis=0)
            return float(size[-2:].max() / size.max())
        error = self.shortest_waves(f)
        if self._finite_volumes:
            order = FINITE_VOLUME_ERROR[self.plan.drift_diffusion][1]
            error += self._finite_volumes * self.plan.grid.dv**order
        if isinstance(operator, Inelastic):
            error += self.of_deposits(f, clock, operator)
        return error

    def shortest_waves(self, f: Array, share: float = 0.0) -> float:
        """The amplitude of the shortest waves in v, this share of them but at least two, over the largest of all."""
        amplitude = np.abs(np.fft.rfft(f, axis=1)).max(axis=0)
        return float(amplitude[-max(2, int(share * amplitude.size)) :].max() / amplitude.max())

    def _acting(self, time: float) -> float:
        """How long an error of the collision rate adds up: friction forgets it, and collisions, but for elastic ones."""
        return min(time, 1 / (self.plan.inner.model.friction + self._collision_rate))

    def of_deposits(self, f: Array, clock: float, operator: Inelastic) -> float:
        """max|ΔC|/max f, ΔC the difference that twice as many points in v make, times how long it acts."""
        nv = f.shape[1]
        half_cells = (1 / nv - 1 / (2 * nv)) / 2
        finer = resize(f, 2 * nv, axis=1, shift=half_cells)
        rate = resize(operator.on(2 * nv).rate(finer), nv, axis=1, shift=-half_cells)
        return float(np.abs(operator.rate(f) - rate).max() / f.max()) * self._acting(clock)
