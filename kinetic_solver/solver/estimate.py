"""What a run knows of its own error, relative to max f, part by part."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.polynomial import legendre

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions import POINTS, RefinableRate
from kinetic_solver.operators.fourier import relative_amplitudes
from kinetic_solver.operators.transport import resolved_waves
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.operators.velocity.kernel import resolution, resolved_spacing
from kinetic_solver.plan import Plan, in_t, in_x, measured
from kinetic_solver.rounding import rounded
from kinetic_solver.scene import Model
from kinetic_solver.solver.cut_off import CutOff, cut_off, of_what_stays
from kinetic_solver.solver.kernel_error import Spectrum, kernel_error, spectrum_of
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.regrid import resize
from kinetic_solver.solver.scheme import adding
from kinetic_solver.theory.ornstein_uhlenbeck import transition

PARTS = {
    "error_time": "the steps in time (grid.time_step)",
    "error_x": "the waves in x (grid.nx)",
    "error_v": "the spacing in v (grid.nv)",
    "error_window": "the velocity window (grid.velocity_window)",
    "error_rounding": "rounding, amplified by follow-the-leader collisions (run.end_time, collisions.cross_section)",
}
"""Name in the dataset → what limits."""


class ErrorEstimate:
    """Each part is the largest since time 0, but for that of the steps, forgotten as the flow forgets them.

    - time: estimated errors of the steps under error control, with (6) their sum, times what it may make of them, with pairs the
      root of the sum of their squares; Strang's by its rule; exact steps have none.
    - x: the start's waves that the first grid leaves out, all together, of a step as they are at the first frame; what products
      of its waves miss, by their rule; with collisions besides the waves of the highest eighth, or what the linearised step
      of (6) misses of the density.
    - v: the shortest waves in v that the points hold, and what these make of the kernel of exact steps of (6); with (12) the
      difference that twice the points make to the collision rate, times how long it acts; with finite volumes their rule; in
      Hermite functions the last coefficients.
    - rounding: by how much (6) may amplify it where f spans so many decades that it is stepped in the local gauge.
    - window: f at its edges, amplified as (6) does until the end, or what is left of that which they cut off the start; and what
      exact steps of (6) keep within it.

    Held against true errors in tests/convergence/test_estimate.py.
    """

    def __init__(self, plan: Plan) -> None:
        scales = plan.scales
        self._of_steps = 0.0
        self._amplified = in_t.amplified_error(scales)
        if plan.stepping == "strang" and plan.time_step is not None:
            self._of_steps = in_t.strang_error(scales, plan.waves, plan.time_step)
        self._lost = plan.waves.beyond(plan.grid.nx) + in_x.error_of_step_products(scales, plan.waves, plan.grid.nx)
        self._parts = dict.fromkeys(PARTS, 0.0)
        self._cut_off: tuple[CutOff, ...] = ()
        self._start: Spectrum | None = None

    def step(self, seen: Observation) -> None:
        """A step has ended, with an estimate of its own error."""
        if seen.plan.stepping in ("extrapolated", "exponential", "homogeneous"):
            error = self._amplified * seen.error / float(np.abs(seen.f).max())
            self._of_steps = added_up(seen.plan, self._of_steps, seen.length, error)

    def parts(self, seen: Observation, diagnostics: dict[str, float]) -> dict[str, float]:
        """All parts, and `error_estimate`, their sum."""
        if seen.clock == 0:
            self._cut_off, self._start = cut_off(seen, diagnostics), spectrum_of(seen)
            return dict.fromkeys(("error_estimate", *PARTS), 0.0)  # what is shown then is the start itself
        now = {
            "error_x": _of_x(seen, diagnostics, self._lost * seen.plan.scales.rho_max / float(seen.moments.density.max())),
            "error_v": _of_v(seen) + (0.0 if self._start is None else kernel_error(seen, self._start)),
            "error_window": self._of_window(seen, diagnostics) + of_what_stays(seen),
            "error_rounding": _of_rounding(seen),
        }
        self._parts = {name: max(self._parts[name], now.get(name, 0.0)) for name in PARTS}
        self._parts["error_time"] = self._of_steps
        return {"error_estimate": self.total, **self._parts}

    def _of_window(self, seen: Observation, diagnostics: dict[str, float]) -> float:
        low = diagnostics["edge_error_low"]
        high = diagnostics["edge_error_high"] * in_t.amplified_error(seen.plan.scales, seen.clock)
        if not self._cut_off:
            return low + high
        cut_low, cut_high = (lost.after(seen) for lost in self._cut_off)
        return max(low, cut_low) + max(high, cut_high)

    def state(self) -> tuple[float, dict[str, float], tuple[CutOff, ...], Spectrum | None]:
        """All that changes as a run goes on."""
        return self._of_steps, dict(self._parts), self._cut_off, self._start

    def restore(self, state: tuple[float, dict[str, float], tuple[CutOff, ...], Spectrum | None]) -> None:
        self._of_steps, self._parts, self._cut_off, self._start = state[0], dict(state[1]), state[2], state[3]

    @property
    def total(self) -> float:
        return sum(self._parts.values())

    def limited_by(self) -> str:
        """The largest part, in words."""
        name = max(self._parts, key=lambda part: self._parts[part])
        return f"{PARTS[name]}: {self._parts[name]:.2g} of max f"


def added_up(plan: Plan, before: float, length: float, error: float) -> float:
    """What the errors of steps come to after one more, of this length and error: what was before is forgotten meanwhile, and
    errors add up as in scheme.adding."""
    kept = math.exp(-length / plan.memory_time) * before
    return kept + error if adding(plan) == 1 else math.hypot(kept, error)


def _of_x(seen: Observation, diagnostics: dict[str, float], lost: float) -> float:
    if seen.grid.nx == 1:
        return 0.0
    if seen.plan.law is None:  # waves do not couple
        return lost
    highest = _highest(seen) if seen.scheme.exact else diagnostics["spectral_tail"]
    return lost + max(highest, diagnostics["density_defect"])


ROUNDING, AMPLIFIED = 1e-19, 2.2
"""(a, b): rounding errs by a exp(b R_t) of max f, R_t at the time, or less: above the errors that were measured of waves of 30
and 85 % on pipes from 25 to 120 at R_t = 8 to 19, from 5e-12 at 8.1 to 0.25 at 19.2. On shorter pipes it is far less."""


def _of_rounding(seen: Observation) -> float:
    plan = seen.plan
    if not (seen.scheme.exact and plan.scales.amplifies and plan.waves.local_gauge):
        return 0.0
    reached = plan.scales.collision_rate * transition(plan.inner.model, seen.clock).drift_time
    return ROUNDING * in_t.grown(AMPLIFIED * reached)


HIGHEST = 3
"""Waves in x that are looked at, where an eighth of all are fewer, of many that the start does not have: what comes of waves 3
and 6 are multiples of 3. Chosen."""


def _highest(seen: Observation) -> float:
    """The height of the highest eighth of waves in x after exact steps of (6), which put what the points do not hold of their
    products among them: all together, twice the sum of their amplitudes; and of what steps take from the waves below these."""
    amplitude, taken = seen.waves_in_x, 1 - resolved_waves(seen.grid)
    above_the_start = amplitude.size - 1 - seen.plan.waves.highest_mode
    taken[-max(1, amplitude.size // 8, min(HIGHEST, above_the_start // 3)) :] = 1.0
    return 2 * float(amplitude @ taken)


def _of_v(seen: Observation) -> float:
    plan = seen.plan
    if plan.velocity == "hermite":
        return last_functions(seen)
    error = waves_in_v(seen)
    if plan.drift_diffusion != "kernel":
        order = measured.FINITE_VOLUME_ERROR[plan.drift_diffusion][1]
        planned = measured.RULE_SHARE * plan.inner.accuracy.rtol
        error += planned * (seen.grid.dv / plan.finite_volume_spacing) ** order
    return error + rate_error(seen, seen.clock)


def waves_in_v(seen: Observation) -> float:
    """The error that waves in v make which the points do not hold, judged by the amplitude a of the shortest that they hold.

    At the points, and in sums over them, exact steps that resolve their kernel err by waves of twice that wavenumber, which a
    smooth spectrum makes smaller than a². Between them, where f may be written, and where the kernel is band-limited, as without
    collisions it may be, err all waves that are left out, and what stands for them among the longer ones. Else it is about a.
    """
    amplitude = shortest_of(seen.waves_in_v)
    plan, grid = seen.plan, seen.grid
    if not seen.scheme.exact or plan.drift_diffusion != "kernel":
        return amplitude
    model, dv = plan.inner.model, grid.dv
    step = seen.clock if plan.time_step is None else plan.shortest_step
    resolved = model.friction * model.noise == 0 or dv <= resolved_spacing(model, step, resolution(plan.inner.accuracy.rtol)) * (
        1 + 1e-9
    )
    if not resolved and plan.law is not None:
        return amplitude
    same = (plan.output.nv, plan.output.low, plan.output.high) == (grid.nv, grid.low, grid.high)
    if resolved and ((same and not plan.reference_frame.moving) or plan.scene.output.f is False):
        return amplitude**2
    # A wave's height over max f: the longest, with which amplitudes are compared, is the mean of f over the window.
    mean = float(seen.moments.density.max()) / (grid.high - grid.low) / float(seen.f.max())
    return max(amplitude**2, 4 * mean * _left_out(seen.waves_in_v))


FLATTEST = 0.9
"""Of an amplitude to the next longer wave's, at most: beyond that it is rounding which is seen. Chosen."""


def _left_out(amplitude: Array) -> float:
    """The sum of the amplitudes of all waves in v that are shorter than the points hold, as a geometric series after the last but
    one (of the last, at an even number of points, only the cosine is held), its ratio that of the last quarter."""
    last, quarter = shortest_of(amplitude), amplitude.size // 4
    before = shortest_of(amplitude[: amplitude.size - quarter]) if quarter else last
    ratio = min(FLATTEST, (last / before) ** (1 / max(1, quarter))) if before > 0 else FLATTEST
    return last * ratio / (1 - ratio)


def shortest_waves(f: Array, share: float = 0.0) -> float:
    """The amplitude of the shortest waves in v, this share of them but at least two, over the largest of all."""
    return shortest_of(relative_amplitudes(f, axis=1), share)


def shortest_of(amplitude: Array, share: float = 0.0) -> float:
    """The largest of the last amplitudes, likewise."""
    return float(amplitude[-max(2, int(share * amplitude.size)) :].max())


def last_functions(seen: Observation) -> float:
    """The largest of the last two Hermite coefficients over the largest of all."""
    size = np.abs(seen.state).max(axis=0)
    return float(size[-2:].max() / size.max())


def rate_error(seen: Observation, time: float) -> float:
    """Of a collision rate that has an error in dv, by this time, over max f; 0 for the others.

    The rate's own error is ΔC, by the difference that twice as many points in v make. What it does to f is ∫exp(-νs) K(s) ΔC ds
    over 0 < s < time: friction and noise, K, smooth its short waves in v, and collisions, unless elastic, forget it at a rate ν,
    here that of the mean density and temperature. Held against true errors in tests/convergence/test_estimate.py.
    """
    operator, f, plan = seen.scheme.operator, seen.f, seen.plan
    if plan.law is None or plan.law.linearises or not isinstance(operator, RefinableRate):
        return 0.0
    nv = f.shape[1]
    half_cells = (1 / nv - 1 / (2 * nv)) / 2
    finer = resize(f, 2 * nv, axis=1, shift=half_cells)
    rate = resize(operator.on(2 * nv).rate(finer), nv, axis=1, shift=-half_cells)
    difference = (operator.rate(f) - rate) / (1 - 0.5 ** POINTS.get(plan.deposit or "", math.inf))
    if time == 0:
        return 0.0
    if plan.scales.cooling:
        # θ forgets most slowly: as fast as the frame shrinks.
        return float(np.abs(difference).max() / f.max()) * min(time, 1 / plan.scales.forgetting)
    model, forgotten = plan.inner.model, _forgetting(seen)
    decay = model.friction + forgotten
    acting = min(time, RESPONSE_ENDS / decay) if decay > 0 else time
    acting = 2 ** (math.ceil(TIMES_PER_OCTAVE * math.log2(acting)) / TIMES_PER_OCTAVE)
    return float(np.abs(difference @ _response(seen.grid, model, forgotten, acting).T).max() / f.max())


def _forgetting(seen: Observation) -> float:
    """1/time; in few digits, so that its tables serve more than once."""
    law, m = seen.plan.law, seen.moments
    if law is None or law.dissipation == 0:
        return 0.0
    mean = float(m.density.mean())
    theta = float((m.density * m.temperature).mean()) / mean
    return rounded(law.frequency(mean, theta) * law.dissipation / 2, FEW_DIGITS) if theta > 0 else 0.0


FEW_DIGITS = 5
"""Binary digits of a rate at which collisions forget: 3 %, as exact as its rule is."""
DOUBLINGS = 6
"""Of the first part of the time, on which the response to an error is integrated by `NODES` Gauss-Legendre nodes."""
NODES = 3
RESPONSE_ENDS = 8.0
"""Times over its slowest decay after which a response has ended: exp(-8)."""
TIMES_PER_OCTAVE = 8
"""To which times are rounded up, by 9 % at most, so that a table serves more than one look."""


@functools.lru_cache(maxsize=8)
def _response(grid: PhaseSpaceGrid, model: Model, forgotten: float, time: float) -> Array:
    """R(t) = ∫exp(-forgotten·s) K(s) ds over 0 < s < t, (nv, nv), by R(2t) = R(t) + exp(-forgotten·t) K(t) R(t)."""
    kernel = OrnsteinUhlenbeckKernel(grid, model)
    places, weights = legendre.leggauss(NODES)
    t = time / 2**DOUBLINGS
    whole = np.zeros((grid.nv, grid.nv))
    for place, weight in zip(places.tolist(), weights.tolist(), strict=True):
        s = t * (1 + place) / 2
        whole += t / 2 * weight * math.exp(-forgotten * s) * kernel.matrix(s)
    for n in range(DOUBLINGS):
        whole += math.exp(-forgotten * t * 2**n) * (kernel.matrix(t * 2**n) @ whole)
    return whole


ENOUGH_FOR_RATE, ENOUGH_FOR_WAVES = 0.05, 40.0
"""The collision rate is to be good to this share of rtol, and f's waves in v are kept down to rtol over this, where nv shrinks.
Chosen."""


def enough_velocities(seen: Observation) -> int:
    """The nv, on the same window, that would do for operator (12) to the end of the run."""
    plan = seen.plan
    nv, rtol = plan.grid.nv, plan.inner.accuracy.rtol
    if plan.deposit is None or plan.velocity == "hermite" or plan.drift_diffusion != "kernel":
        return nv
    error = rate_error(seen, plan.inner.run.end_time)
    by_deposit = nv * (error / (ENOUGH_FOR_RATE * rtol)) ** (1 / POINTS[plan.deposit]) if error > 0 else 0.0
    waves = int(np.flatnonzero(seen.waves_in_v > rtol / ENOUGH_FOR_WAVES)[-1])
    return min(nv, max(math.ceil(by_deposit), 2 * waves + 4))
