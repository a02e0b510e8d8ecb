"""Watches a run: stops it, with one line that says what to change, before a number that cannot be trusted is written."""

from __future__ import annotations

import warnings

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.operators.moments import moments
from kinetic_solver.plan import Plan
from kinetic_solver.scene import FOLLOW_LEADER
from kinetic_solver.theory.ornstein_uhlenbeck import transition

UNRESOLVED = 0.5
"""dv²|∂²f/∂v²|/max f at which a peak counts as unresolved: a Gaussian whose standard deviation is 1.4 dv."""
SHARE = 0.3
"""Of rtol, to each of the losses that a larger grid would mend: they add up."""


class Unresolved(SolverStopped):
    """`what` of the grid, "nx", "nv", "low" or "high" (the window's edges), does not resolve f; `value` says by how much."""

    def __init__(self, message: str, what: str, value: float) -> None:
        super().__init__(message)
        self.what, self.value = what, value


class Monitor:
    """Diagnostics of f, each relative to max f, and the decision that the grid no longer holds it.

    What exceeds `share` of rtol raises Unresolved where the grid was chosen for it; where [grid] gives the offending quantity,
    what exceeds rtol is warned of once, since what is given is kept. NaN, and peaks narrower than UNRESOLVED, always raise.
    Times are the frame's clock; messages give the scene's.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        """May be exchanged for one of another grid."""
        self.rtol = plan.inner.accuracy.rtol
        self.share = SHARE
        self._warned: dict[str, float] = {}
        self._amplify = plan.inner.operator == FOLLOW_LEADER
        # Until noise has smoothed a step in the density, waves in x are as short as the grid can hold, by definition.
        self._smooth_from = float(plan.times[1]) if plan.inner.initial.step is not None else 0.0

    def finite(self, f: Array, time: float) -> None:
        """The check of every step."""
        if not np.isfinite(f.sum()):
            raise SolverStopped(f"{self._when(time)}: f is no longer finite; reduce grid.time_step or accuracy.rtol")

    def check(self, f: Array, time: float, density_defect: float = 0.0) -> dict[str, float]:
        """All diagnostics; may raise Unresolved. `density_defect`: what the exactly linearised step says of its own error."""
        self.finite(f, time)
        grid, given = self.plan.grid, self.plan.inner.grid
        top = float(f.max())
        if not top > 0:
            raise SolverStopped(f"{self._when(time)}: f has no positive value left; reduce grid.time_step or accuracy.rtol")
        values = {
            "minimum_of_f": float(f.min()) / top,
            "edge_error_low": float(self.amplified(f, time)[0]) / top,
            "edge_error_high": float(np.abs(f[:, -1]).max()) / top,
            "velocity_curvature": float(np.abs(np.diff(f, n=2, axis=1)).max()) / top if grid.nv > 2 else 0.0,
            "spectral_tail": self._spectral_tail(f),
            "density_defect": density_defect,
        }
        # Without collisions the linear step is exact for whatever the points represent.
        if values["velocity_curvature"] > UNRESOLVED and (self.plan.inner.operator is not None or given.nv is not None):
            raise Unresolved(
                f"{self._when(time)}: the velocity distribution has become narrower than 1.4 dv = {1.4 * grid.dv:.3g} and is no "
                "longer resolved; raise grid.nv, narrow grid.velocity_window, or end the run earlier",
                "nv", values["velocity_curvature"],
            )  # fmt: skip
        low, high = values["edge_error_low"], values["edge_error_high"]
        self._bound(
            "low" if low > high else "high", max(low, high), given.velocity_window is not None, time,
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
            finer[0], -values["minimum_of_f"], any(getattr(given, name) is not None for name in finer), time,
            f"f has become negative by {-values['minimum_of_f']:.2g} of its maximum; "
            + ("shorten grid.time_step, or " if given.time_step is not None and self.plan.deposit else "")
            + "raise " + " and ".join(f"grid.{name}" for name in finer),
        )  # fmt: skip
        self._bound(
            "nx", values["spectral_tail"], given.nx is not None, time,
            f"the shortest waves in x carry {values['spectral_tail']:.2g} of f; raise grid.nx",
        )  # fmt: skip
        self._bound(
            "nx", density_defect, given.nx is not None, time,
            f"x is not resolved: the linearised step of operator (6) contradicts itself by {density_defect:.2g} of the density; "
            "raise grid.nx",
        )  # fmt: skip
        return values

    def _bound(self, what: str, value: float, given: bool, time: float, message: str) -> None:
        if value <= (1.0 if given else self.share) * self.rtol:
            return
        text = f"{self._when(time)}: {message} (accuracy.rtol = {self.rtol:g})"
        if not given:
            raise Unresolved(text, what, value)
        kind = message.split(";")[1]
        if value > 10 * self._warned.get(kind, 0.0):
            self._warned[kind] = value
            warnings.warn(text, stacklevel=2)

    def _when(self, time: float) -> str:
        return f"t = {self.plan.frame.place(time).time:.6g}"

    def amplified(self, f: Array, time: float) -> Array:
        """max|f| over x at every velocity, times what operator (6) can still make of it. Shape (nv,)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            size = np.exp(np.log(np.abs(f)) + self._exponents(f, time))
        return np.asarray(np.nan_to_num(size, nan=0.0, posinf=np.inf).max(axis=0))

    def waves(self, f: Array, time: float) -> Array:
        """The largest amplitude of every wave in x, likewise amplified, over the largest of all. Shape (nx//2 + 1,)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            size = np.exp(np.log(np.abs(np.fft.rfft(f, axis=0))) + self._exponents(f, time).max(axis=0))
        size = np.nan_to_num(size, nan=0.0, posinf=np.inf).max(axis=1)
        return np.asarray(size / size.max())

    def _exponents(self, f: Array, time: float) -> Array:
        """R w - R²θ/2 where positive, w = u - v, R = Sρ(1 - e^(-γt))/γ, t the time that is left; (nx, nv) or (1, 1)."""
        if not self._amplify:
            return np.zeros((1, 1))
        m = moments(self.plan.grid, f)
        left = max(0.0, self.plan.inner.run.end_time - time)
        gain = self.plan.inner.cross_section * m.density * transition(self.plan.inner.model, left).drift_time
        exponent = gain[:, None] * (m.mean_velocity[:, None] - self.plan.grid.v) - (gain**2 * m.temperature / 2)[:, None]
        return np.maximum(exponent, 0.0)

    def _spectral_tail(self, f: Array) -> float:
        """The largest |f_k(v)| in the highest eighth of wavenumbers over the largest of all; 0 where modes do not couple."""
        if self.plan.grid.nx < 3 or self.plan.inner.operator is None:
            return 0.0
        amplitude = np.abs(np.fft.rfft(f, axis=0)).max(axis=1)
        first = len(amplitude) - max(1, len(amplitude) // 8)
        return float(amplitude[first:].max() / amplitude.max())
