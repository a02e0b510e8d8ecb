"""Judges every state: whether its grid still holds it, before a number that cannot be trusted is written."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.laws import FollowTheLeader
from kinetic_solver.plan import Plan, in_v
from kinetic_solver.solver.estimate import last_functions, rate_error, shortest_of
from kinetic_solver.solver.observation import Observation
from kinetic_solver.theory.ornstein_uhlenbeck import transition

UNRESOLVED = 0.5
"""dv²|∂²f/∂v²|/max f at which a peak counts as unresolved: that of a Gaussian whose standard deviation is 1.4 dv."""
ROOM = 1.3
"""Points in v that are advised, over those that would just hold a peak: at least, for it becomes narrower still. Chosen."""
SHARE = 0.3
"""Of rtol, to each of the losses that a larger grid would mend, since they add up. Chosen."""
LAST_FUNCTIONS = 0.1
"""Of rtol, to the last two Hermite functions. Chosen: what lies beyond them is of their size."""
OVERRATED = 3.0
"""By how much the shortest waves in v are taken to exceed the error that they show (tests/convergence/test_estimate.py)."""
RATE_SHARE = 0.7
"""Of rtol, to the error of the collision rate, so that with the rest it stays below. Chosen."""
HIGHEST_WAVES = 1 / 4
"""Of the waves in v that are looked at where noise hardly acts: free motion passes many of them within one step."""

Quantity = Literal["nx", "nv", "low", "high"]
"""What of a grid may be too small: points, or the window's lower or upper edge."""


@dataclass(frozen=True)
class Problem:
    """A quantity of the grid that does not hold f."""

    what: Quantity
    value: float
    """By how much: the loss, over max f."""
    when: str
    message: str
    """What happened, and what to change."""

    def __str__(self) -> str:
        return f"{self.when}: {self.message}"


@dataclass(frozen=True)
class Judgement:
    diagnostics: dict[str, float]
    """For the dataset (docs/output.md), each relative to max f."""
    problem: Problem | None
    """The first that was found."""


@dataclass(frozen=True)
class _Loss:
    """That a larger `what` would mend."""

    what: Quantity
    value: float
    given: bool
    """Whether `[grid]` gives it: then it is warned of, not mended."""
    text: str
    """What happened, with "{}" for the value, and after a semicolon what to change."""


def free(plan: Plan, what: Quantity) -> bool:
    """Whether this quantity of the grid is rtol's to choose."""
    given = plan.inner.grid
    if what == "nx":
        return given.nx is None and plan.grid.nx > 1
    if what == "nv":
        return given.nv is None
    return plan.velocity == "points" and given.nv is None and given.velocity_window is None


def folds(plan: Plan) -> bool:
    """True where noise hardly acts beside collisions: free motion makes ever shorter waves in v, which may pass the shortest that
    dv holds in a few steps."""
    return plan.law is not None and not plan.law.linearises and plan.scales.noise_hardly_acts and plan.grid.nx > 1


class Monitor:
    """Looks at f, and at what (6) will still make of it.

    A loss beyond `share` of rtol is a Problem where the grid was chosen; where [grid] gives the offending quantity, one beyond
    rtol is warned of, and again when it is ten times worse. A NaN raises SolverStopped; a peak narrower than UNRESOLVED is
    always a Problem. It remembers nothing but what it has warned of.
    """

    def __init__(self, plan: Plan) -> None:
        self.warned: dict[str, float] = {}
        """Remedy → the largest loss that it was named for."""
        # Until noise has smoothed a step in the density, waves in x are as short as the grid can hold, by definition.
        self._smooth_from = float(plan.times[1]) if plan.inner.initial.step is not None else 0.0

    def finite(self, seen: Observation) -> None:
        """The check of every step. Raises SolverStopped."""
        if not seen.finite:
            raise SolverStopped(f"{_when(seen)}: f is no longer finite; {_shorter_steps(seen)}")

    def judge(self, seen: Observation, share: float = SHARE) -> Judgement:
        """All diagnostics of a state, and whether its grid holds it."""
        self.finite(seen)
        f, grid, scene = seen.f, seen.grid, seen.plan.inner
        top = float(f.max())
        if not top > 0:
            raise SolverStopped(f"{_when(seen)}: f has no positive value left; {_shorter_steps(seen)}")
        values = {
            "minimum_of_f": float(f.min()) / top,
            "edge_error_low": float(amplified(seen, slice(1))[0]) / top,
            "edge_error_high": float(np.abs(f[:, -1]).max()) / top,
            "velocity_curvature": float(np.abs(np.diff(f, n=2, axis=1)).max()) / top if grid.nv > 2 else 0.0,
            "spectral_tail": spectral_tail(seen),
            "density_defect": seen.scheme.density_defect,
        }
        # Without collisions the linear step is exact for whatever the points represent.
        if values["velocity_curvature"] > UNRESOLVED and (seen.plan.law is not None or scene.grid.nv is not None):
            now = ROOM * grid.nv * math.sqrt(values["velocity_curvature"] / UNRESOLVED)
            later = (grid.high - grid.low) * in_v.NARROWEST / math.sqrt(seen.plan.scales.theta_min)
            enough = math.ceil(max(now, later))
            text = (
                f"the velocity distribution has become narrower than 1.4 dv = {1.4 * grid.dv:.3g} and is no "
                f"longer resolved; raise grid.nv to {enough} or more"
                + (", or end the run before (run.end_time)" if seen.clock > 0 else "")
            )
            return Judgement(values, Problem("nv", values["velocity_curvature"], _when(seen), text))
        for loss in self._losses(seen, values):
            if (problem := self._bounded(loss, seen, share)) is not None:
                return Judgement(values, problem)
        # What is shown at the start is the start itself, not what the points make of it.
        return Judgement(values, _too_coarse(seen) if seen.clock > 0 else None)

    def _losses(self, seen: Observation, values: dict[str, float]) -> Iterator[_Loss]:
        plan, given = seen.plan, seen.plan.inner.grid
        low, high = values["edge_error_low"], values["edge_error_high"]
        edge: Quantity = "low" if low > high else "high"
        yield _Loss(
            edge,
            max(low, high),
            given.velocity_window is not None,
            f"f at the {'lower' if low > high else 'upper'} edge of the velocity window spoils {{}} of max f; "
            "widen grid.velocity_window",
        )
        if seen.clock < self._smooth_from:
            return
        if plan.scene.output.f is False and plan.law is None:
            return  # f rings at a jump that nothing smooths, where it is not looked at and waves do not couple
        # Transport in x, and the deposits of (12) above the linear one, are the two that are not positive.
        finer: list[Quantity] = [] if plan.grid.nx == 1 else ["nx"]
        if plan.deposit not in (None, "linear") or not finer:
            finer.append("nv")
        yield _Loss(
            finer[0],
            -values["minimum_of_f"],
            any(getattr(given, name) is not None for name in finer),
            "f has become negative by {} of its maximum; "
            + ("shorten grid.time_step, or " if given.time_step is not None and plan.deposit else "")
            + "raise "
            + " and ".join(f"grid.{name}" for name in finer),
        )
        yield _Loss(
            "nx",
            values["spectral_tail"],
            given.nx is not None,
            "the shortest waves in x carry {} of f; raise grid.nx",
        )
        yield _Loss(
            "nx",
            values["density_defect"],
            given.nx is not None,
            "x is not resolved: the linearised step of follow-the-leader collisions contradicts itself by {} of the density; "
            "raise grid.nx",
        )

    def _bounded(self, loss: _Loss, seen: Observation, share: float) -> Problem | None:
        rtol = seen.plan.inner.accuracy.rtol
        if loss.value <= (1.0 if loss.given else share) * rtol:
            return None
        text = f"{loss.text.format(f'{loss.value:.2g}')} ({seen.plan.tolerance})"
        if not loss.given:
            return Problem(loss.what, loss.value, _when(seen), text)
        remedy = loss.text.split(";")[1]
        if loss.value > 10 * self.warned.get(remedy, 0.0):
            self.warned[remedy] = loss.value
            warnings.warn(f"{_when(seen)}: {text}", stacklevel=2)
        return None


def _too_coarse(seen: Observation) -> Problem | None:
    """Whether the Hermite functions are enough, or dv is fine enough, where it is rtol's to choose."""
    plan, rtol = seen.plan, seen.plan.inner.accuracy.rtol
    if plan.velocity == "hermite" and free(plan, "nv") and (tail := last_functions(seen)) > LAST_FUNCTIONS * rtol:
        text = f"the last Hermite functions carry {tail:.2g} of f; raise grid.nv ({plan.tolerance})"
        return Problem("nv", tail, _when(seen), text)
    if free(plan, "low"):  # an edge that cuts f, as a given window's may, has short waves of its own
        folding = folds(plan)
        error = shortest_of(seen.waves_in_v, HIGHEST_WAVES if folding else 0.0) / OVERRATED
        if plan.law is not None:
            error = max(error, rate_error(seen, seen.clock) / RATE_SHARE)
        if error > rtol:
            text = f"the spacing in v is too coarse by an estimated {error:.2g} of max f; raise grid.nv ({plan.tolerance})"
            return Problem("nv", error, _when(seen), text)
    return None


def _shorter_steps(seen: Observation) -> str:
    """What makes steps shorter."""
    given = seen.plan.inner.grid.time_step is not None
    return "reduce grid.time_step" if given else "reduce accuracy.rtol, or end the run before (run.end_time)"


def _when(seen: Observation) -> str:
    return f"t = {seen.time:.6g}"


def amplified(seen: Observation, velocities: slice = slice(None)) -> Array:
    """max|f| over x at these velocities, times what operator (6) can still make of what is built upon. Shape (velocities,)."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(np.exp(np.log(np.abs(seen.f[:, velocities])) + _exponents(seen, velocities)).max(axis=0))


def amplified_waves(seen: Observation) -> Array:
    """The largest amplitude of every wave in x, likewise amplified, over the largest of all. Shape (nx//2 + 1,)."""
    with np.errstate(divide="ignore"):
        size = (np.log(np.abs(np.fft.rfft(seen.f, axis=0))) + _exponents(seen).max(axis=0)).max(axis=1)
    return np.asarray(np.exp(size - size.max()))  # what rounding is amplified to may be no double


def _exponents(seen: Observation, velocities: slice = slice(None)) -> Array:
    """R w - R²θ/2 where positive, w = u - v, R = Sρ(1 - e^(-γt))/γ, t the time that is left; (nx, velocities) or (1, 1)."""
    scene, law = seen.plan.inner, seen.plan.law
    if not isinstance(law, FollowTheLeader) or seen.side:
        return np.zeros((1, 1))
    m = seen.moments
    left = max(0.0, scene.run.end_time - seen.clock)
    gain = law.cross_section * m.density * transition(scene.model, left).drift_time
    exponent = gain[:, None] * (m.mean_velocity[:, None] - seen.grid.v[velocities]) - (gain**2 * m.temperature / 2)[:, None]
    return np.where(exponent > 0, exponent, 0.0)  # 0 where there is no density: it has no mean velocity


def spectral_tail(seen: Observation) -> float:
    """The largest |f_k(v)| in the highest eighth of wavenumbers over the largest of all; 0 where modes do not couple."""
    if seen.grid.nx < 3 or seen.plan.law is None:
        return 0.0
    amplitude = seen.waves_in_x
    return float(amplitude[amplitude.size - max(1, amplitude.size // 8) :].max())
