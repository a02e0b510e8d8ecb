"""The velocity window, and how fine dv must be: every criterion is an upper bound of dv, or an edge of the window.

Bounds the errors of f over max f by what is cut off at the edges (amplified, with (6)), by the waves in v that dv cannot hold, by
kernels that it cannot resolve, and by the schemes that replace them. The rules in words: docs/rules.md.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.linear import FADED
from kinetic_solver.operators.velocity.kernel import resolution, resolved_spacing
from kinetic_solver.plan import in_finite_volumes, in_t, kernel_sums, measured
from kinetic_solver.plan.criterion import Criterion
from kinetic_solver.plan.scales import TAIL, Scales
from kinetic_solver.plan.waves import DROPPED, Waves
from kinetic_solver.scene import Deposit, DriftDiffusionScheme, Model, SteppingScheme
from kinetic_solver.stability.scaling import cooling_state
from kinetic_solver.theory.ornstein_uhlenbeck import bridge_variance, bridge_variances, half_transport_time, transition

LEAST_POINTS = 8
"""In v: fewer hold no distribution."""
NARROWEST = 2.0
"""Points to a standard deviation of the narrowest distribution, at least. Chosen: f is drawn from its points."""
EDGE_OF_COOLING = 100.0
"""At the window's edges what leaves at both meets, until collisions take it back: so many times more of it. Chosen: 3 to 4 were
seen."""
EIGENMODE_REACH, EIGENMODE_POINTS = 12.0, 1024
"""Thermal velocities and points on which the shapes of eigenmodes are looked at."""


@dataclass(frozen=True)
class Window:
    low: float
    high: float
    reason: str

    @property
    def width(self) -> float:
        return self.high - self.low


def window(scales: Scales) -> Window:
    """Mean ± tail of every Maxwellian that the flow passes through.

    For (6) the slow side reaches further by twice R_t√θ: once since dense places move that much slower, once since a disturbance
    there is amplified by up to exp(R_t w) (docs/theory_details.md, amplification).
    """
    low, high = scales.means
    thermal = math.sqrt(scales.theta_max)
    reach = scales.tail * thermal
    if scales.cooling:
        return _of_a_cooling_gas(scales, reach)
    if scales.amplified_shift:
        # The kernel is a shift then, periodic in v: what leaves above comes back in the slow tail, which (6) amplifies.
        reach = math.sqrt(scales.tail**2 + 2 * scales.amplification * scales.tail) * thermal
    reason = f"{scales.tail:.1f} standard deviations about the means from {low:.3g} to {high:.3g}"
    slower = 0.0
    if scales.amplifies:
        slower = 2 * scales.slowing
        reason += ", and the slow tail that follow-the-leader collisions amplify"
    return Window(low - reach - slower, high + reach, reason)


def _of_a_cooling_gas(scales: Scales, maxwellian: float) -> Window:
    """It starts from Maxwellians, and ends with exponential tails."""
    law = scales.law
    assert isinstance(law, Inelastic)
    state, (low, high) = cooling_state(law.restitution), scales.means
    held = state.f > scales.of_edges / (TAIL * EDGE_OF_COOLING) * state.f.max()
    reach = float(state.w[held][-1]) * math.sqrt(scales.theta_end)
    low, high = min(low - maxwellian, -reach), max(high + maxwellian, reach)
    return Window(low, high, "the start's standard deviations, and the exponential tails of a gas that cools")


def window_from_now_on(scales: Scales, mean_velocity: Array, temperature: Array, left: float) -> tuple[float, float]:
    """As `window`, for the rest of a run from its present fields: (low, high)."""
    step = transition(scales.scene.model, left)
    means = [float(mean_velocity.min()), float(mean_velocity.max())]
    means += [step.velocity_shift + mean * step.decay for mean in means]
    hottest = float(temperature.max())
    theta = max(hottest, min(hottest * step.decay**2 + step.velocity_variance, scales.theta_end))
    reach = scales.tail * math.sqrt(theta)
    slower = 0.0
    if scales.amplifies:
        assert scales.law is not None
        slower = 2 * scales.law.frequency(scales.rho_max, theta) * step.drift_time
    return min(means) - reach - slower, max(means) + reach


@dataclass(frozen=True)
class Schemes:
    """What dv has to serve on velocity points."""

    stepping: SteppingScheme
    drift_diffusion: DriftDiffusionScheme
    deposit: Deposit | None
    time_step: float | None


def spacings(scales: Scales, waves: Waves, schemes: Schemes) -> list[Criterion]:
    """Every bound of dv."""
    scene, model = scales.scene, scales.scene.model
    bounds = [narrowest(scales, waves, schemes)]
    if (q := waves.phase_mixing) > 0:
        bounds.append(Criterion(math.pi / q, "phase mixing of the initial waves"))
    if scene.initial.eigenmodes:
        bounds.append(Criterion(_eigenmodes(scales), "the eigenmodes"))
    if model.friction * model.noise > 0 and (scales.law is not None or schemes.drift_diffusion != "kernel"):
        bounds += _drift_diffusion(scales, waves, schemes)
    if schemes.deposit is not None:
        bounds.append(_deposit(scales, schemes.deposit))
    return bounds


def coarsest(scales: Scales, waves: Waves) -> float:
    """The dv that an exact step must keep below, however short it is."""
    _, digits = waves.in_play
    spectrum = max(math.sqrt(2 * float(digits.max()) / scales.theta_min), waves.phase_mixing)
    return min(math.pi / spectrum, math.sqrt(scales.theta_min) / NARROWEST)


def narrowest(scales: Scales, waves: Waves, schemes: Schemes) -> Criterion:
    """A Gaussian of variance θ has the spectrum exp(-θq²/2). The linear step moves waves exp(ikx) by τ before noise damps them
    (operators/linear.py), which shifts their spectrum by kτ."""
    longest = scales.end if schemes.stepping == "exact" else float(np.diff(scales.times).max())
    k, digits = waves.in_play
    model, longest = scales.scene.model, min(longest, schemes.time_step or math.inf)
    moved = _until_faded(model, k, longest)
    if scales.law is None:
        # Nothing is looked at before the first frame, and nothing couples: waves that have faded by then are never held.
        moved[faded_after(model, k, min(longest, float(scales.times[1])))] = 0.0
    shear = k * np.array([half_transport_time(model.friction, h) for h in moved.tolist()])
    spectrum = float((shear + np.sqrt(2 * digits / scales.theta_min)).max())
    return Criterion(min(math.pi / spectrum, math.sqrt(scales.theta_min) / NARROWEST), "the narrowest velocity distribution")


def faded_after(model: Model, k: Array, h: float) -> NDArray[np.bool_]:
    """Which of the waves k noise has damped away after h."""
    return np.asarray(k**2 * bridge_variance(model, h) / 2 > FADED)


LOOKED_AT = np.geomspace(1e-6, 1.0, 300)
"""Shares of the longest step at which it is looked for what noise damps away: 5 % apart. Chosen."""


def _until_faded(model: Model, k: Array, longest: float) -> Array:
    """The longest step that moves waves k: those that noise damps away within it are left out (operators/linear.py)."""
    h = longest * LOOKED_AT
    with np.errstate(divide="ignore"):
        gone = np.searchsorted(_bridges(model, longest), 2 * FADED / k**2)
    return np.asarray(h[np.minimum(gone, h.size - 1)])


@functools.lru_cache(maxsize=64)
def _bridges(model: Model, longest: float) -> Array:
    """`bridge_variances` at these shares of a step. Kept, for the scenes of a sweep have many in common; read only."""
    return bridge_variances(model, longest * LOOKED_AT)


def exact_step_spacing(scales: Scales, waves: Waves, h: float) -> float:
    """The largest dv that resolves the kernels of exact steps h, of which the local gauge takes two, and their sums with f."""
    resolved = resolved_spacing(scales.scene.model, h / 2 if waves.local_gauge else h, resolution(scales.rtol))
    return min(resolved, kernel_sums.largest_spacing(scales, waves, kernel_sums.links(scales, h), h))


def for_weak_noise(scales: Scales, waves: Waves, h: float | None) -> float:
    """The dv of finite volumes of order 8 in the kernel's place."""
    return min(in_finite_volumes.spacing(scales, waves, "finite-volume-8", h), steepest(scales))


def steepest(scales: Scales) -> float:
    """The dv at which finite volumes keep order 8 in the whole window."""
    edges = window(scales)
    return in_finite_volumes.steepest(scales, (edges.low, edges.high))


def _drift_diffusion(scales: Scales, waves: Waves, schemes: Schemes) -> list[Criterion]:
    """Of the scheme between points in v: the kernel's width, or the finite volumes' error."""
    model, name, h = scales.scene.model, schemes.drift_diffusion, schemes.time_step
    if name != "kernel":
        weak = schemes.stepping == "exact" and scales.scene.grid.drift_diffusion is None
        dv = for_weak_noise(scales, waves, h) if weak else in_finite_volumes.spacing(scales, waves, name, h)
        return [Criterion(dv, f"the finite volumes' error of order {measured.FINITE_VOLUME_ERROR[name][1]}")]
    if schemes.stepping == "extrapolated" and scales.slows:
        # Its steps are shorter than the kernel needs: finite volumes take over in all of them (solver/representation.py).
        held = in_finite_volumes.spacing(scales, waves, "finite-volume-8", h)
        return [Criterion(held, "the finite volumes' error of order 8")]
    if schemes.stepping == "extrapolated" and scales.amplifies:
        # Finite volumes of order 8 take over in steps too short for the kernel, and some of an extrapolated step always are.
        factor, reference, power = measured.EXTRAPOLATED_STRANG_STEP
        shortest = factor / in_t.commutation_rate(scales, waves) * min(1.0, scales.rtol / reference) ** power
        return [
            Criterion(in_finite_volumes.spacing(scales, waves, "finite-volume-8", h), "the finite volumes' error of order 8"),
            Criterion(resolved_spacing(model, shortest), "the Ornstein-Uhlenbeck kernel of the steps to expect"),
        ]
    reason = "the Ornstein-Uhlenbeck kernel of one step"
    if schemes.stepping == "exact":
        longest = min(in_t.farthest_exact_step(scales), h or math.inf)
        return [Criterion(exact_step_spacing(scales, waves, longest), reason)]
    if schemes.stepping == "strang":
        # Finite volumes of order 8 take over where dv is too coarse for the kernel: no need to be finer than they ask.
        shortest = in_t.shortest_step_that_fills(scales, float(h or np.diff(scales.times).min()))
        return [
            Criterion(
                max(resolved_spacing(model, shortest), in_finite_volumes.spacing(scales, waves, "finite-volume-8", h)), reason
            )
        ]
    return []


def _deposit(scales: Scales, deposit: Deposit) -> Criterion:
    """Of operator (12): the error of its rate adds up for as long as friction does not forget it."""
    coefficient, order = measured.DEPOSIT_ERROR[deposit]
    if scales.noise_hardly_acts:
        coefficient *= measured.NOISELESS_DEPOSIT
    lasting = min(scales.end, 1 / scales.forgetting if scales.forgetting > 0 else math.inf)
    gain = max(1.0, scales.collision_rate * lasting)
    dv = math.sqrt(scales.theta_min) * (scales.rtol / (coefficient * gain)) ** (1 / order)
    if scales.cooling:
        dv /= measured.COOLING_FINER
    return Criterion(dv, f"the {deposit} deposit of collision products")


def _eigenmodes(scales: Scales) -> float:
    """The dv that resolves the eigenmodes' shapes in v, which they keep: their spectra down to rtol/10 of ρ̄, and, for the
    monitor, the bends that they give to f."""
    scene, u0, theta0 = scales.scene, scales.start.mean_velocity, scales.start.temperature
    v = u0 + EIGENMODE_REACH * math.sqrt(theta0) * np.linspace(-1, 1, EIGENMODE_POINTS, endpoint=False)
    dv = float(v[1] - v[0])
    q = 2 * np.pi * np.fft.fftfreq(v.size, dv)
    background = initial.maxwellian(np.ones(1), np.full(1, u0), np.full(1, theta0), v)
    shapes = np.array([shape for _, shape in initial.eigenmode_shapes(scene, v, u0)])
    spectra = np.fft.fft(np.concatenate([background, shapes]), axis=1)
    bend = np.abs(np.fft.ifft(-(q**2) * spectra, axis=1)).sum(axis=0)
    shortest = np.abs(q)[np.abs(spectra).max(axis=0) * dv > scales.rtol / DROPPED].max()
    return min(math.pi / float(shortest), math.sqrt(background.max() / bend.max()) / 2)
