"""Watches a run: stops it, with one line that says what to change, before a number that cannot be trusted is written."""

from __future__ import annotations

import warnings

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.moments import moments
from kinetic_solver.plan import Plan
from kinetic_solver.rules import frame_times
from kinetic_solver.scene import FOLLOW_LEADER
from kinetic_solver.velocity.ornstein_uhlenbeck import transition

UNRESOLVED = 0.5
"""dv²|∂²f/∂v²|/max f at which a peak counts as unresolved: a Gaussian whose standard deviation is 1.4 dv."""


class SolverStopped(RuntimeError):
    """A run that could not go on; the message is one line: when, what happened, what to change."""


class Monitor:
    """Diagnostics of f, each relative to max f, and the decision to stop.

    Losses that rtol bounds stop a run whose grid was chosen for it; where [grid] gives the offending quantity they are
    warned of once, since what is given is kept. NaN, and peaks narrower than UNRESOLVED, always stop.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.rtol = plan.scene.accuracy.rtol
        self._warned: dict[str, float] = {}
        self._amplify = plan.scene.operator == FOLLOW_LEADER
        # Until noise has smoothed a step in the density, waves in x are as short as the grid can hold, by definition.
        self._smooth_from = float(frame_times(plan.scene)[1]) if plan.scene.initial.step is not None else 0.0

    def finite(self, f: Array, time: float) -> None:
        """The check of every step."""
        if not np.isfinite(f.sum()):
            raise SolverStopped(f"t = {time:.6g}: f is no longer finite; reduce grid.time_step or accuracy.rtol")

    def check(self, f: Array, time: float, density_defect: float = 0.0) -> dict[str, float]:
        """All diagnostics; raises SolverStopped. `density_defect`: what the exactly linearised step says of its own error."""
        self.finite(f, time)
        grid, given = self.plan.grid, self.plan.scene.grid
        top = float(f.max())
        if not top > 0:
            raise SolverStopped(f"t = {time:.6g}: f has no positive value left; reduce grid.time_step or accuracy.rtol")
        values = {
            "minimum_of_f": float(f.min()) / top,
            "edge_error_low": self._edge_low(f, time) / top,
            "edge_error_high": float(np.abs(f[:, -1]).max()) / top,
            "velocity_curvature": float(np.abs(np.diff(f, n=2, axis=1)).max()) / top if grid.nv > 2 else 0.0,
            "spectral_tail": self._spectral_tail(f),
            "density_defect": density_defect,
        }
        # Without collisions the linear step is exact for whatever the points represent.
        if values["velocity_curvature"] > UNRESOLVED and (self.plan.scene.operator is not None or given.nv is not None):
            raise SolverStopped(
                f"t = {time:.6g}: the velocity distribution has become narrower than 1.4 dv = {1.4 * grid.dv:.3g} and is no "
                "longer resolved; raise grid.nv, narrow grid.velocity_window, or end the run earlier"
            )
        low, high = values["edge_error_low"], values["edge_error_high"]
        self._bound(
            "velocity_window", max(low, high), given.velocity_window is not None, time,
            f"f at the {'lower' if low > high else 'upper'} edge of the velocity window spoils {max(low, high):.2g} of max f; "
            "widen grid.velocity_window",
        )  # fmt: skip
        if time < self._smooth_from:
            return values
        # Transport in x, and the deposits of (12) above the linear one, are the two that are not positive.
        finer = [] if grid.nx == 1 else ["nx"]
        if self.plan.deposit not in (None, "linear") or not finer:
            finer.append("nv")
        self._bound(
            "negative", -values["minimum_of_f"], any(getattr(given, name) is not None for name in finer), time,
            f"f has become negative by {-values['minimum_of_f']:.2g} of its maximum; raise "
            + " and ".join(f"grid.{name}" for name in finer),
        )  # fmt: skip
        self._bound(
            "spectral_tail", values["spectral_tail"], given.nx is not None, time,
            f"the shortest waves in x carry {values['spectral_tail']:.2g} of f; raise grid.nx",
        )  # fmt: skip
        self._bound(
            "density_defect", density_defect, given.nx is not None, time,
            f"x is not resolved: the linearised step of operator (6) contradicts itself by {density_defect:.2g} of the density; "
            "raise grid.nx",
        )  # fmt: skip
        return values

    def _bound(self, name: str, value: float, given: bool, time: float, message: str) -> None:
        if value <= self.rtol:
            return
        text = f"t = {time:.6g}: {message} (accuracy.rtol = {self.rtol:g})"
        if not given:
            raise SolverStopped(text)
        if value > 10 * self._warned.get(name, 0.0):
            self._warned[name] = value
            warnings.warn(text, stacklevel=2)

    def _edge_low(self, f: Array, time: float) -> float:
        """f at the slow edge, times what operator (6) can still make of it in the time t that is left:
        exp(R w - R²θ/2), w = u - v, R = Sρ(1 - e^(-γt))/γ."""
        edge = np.abs(f[:, 0])
        if not self._amplify:
            return float(edge.max())
        m = moments(self.plan.grid, f)
        left = max(0.0, self.plan.scene.run.end_time - time)
        gain = self.plan.scene.cross_section * m.density * transition(self.plan.scene.model, left).drift_time
        exponent = gain * (m.mean_velocity - self.plan.grid.v[0]) - gain**2 * m.temperature / 2
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            amplified = np.exp(np.log(edge) + np.maximum(exponent, 0.0))
        return float(np.nan_to_num(amplified, nan=0.0, posinf=np.inf).max())

    def _spectral_tail(self, f: Array) -> float:
        """The largest |f_k(v)| in the highest eighth of wavenumbers over the largest of all; 0 where modes do not couple."""
        if self.plan.grid.nx < 8 or self.plan.scene.operator is None:
            return 0.0
        amplitude = np.abs(np.fft.rfft(f, axis=0)).max(axis=1)
        first = len(amplitude) - max(1, len(amplitude) // 8)
        return float(amplitude[first:].max() / amplitude.max())
