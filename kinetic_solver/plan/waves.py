"""The waves along x of a scene's start: which of them matter, how finely they will fold f in v, and what (6) makes of them.

Everything is computed when it is first asked for, and once.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.operators.fourier import relative_amplitudes
from kinetic_solver.plan.measured import LEAST_RTOL_OF_A_STEP
from kinetic_solver.plan.scales import Scales
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

DROPPED = 10.0
"""Waves of a relative amplitude below rtol over this are left out. Chosen: ten such waves in step make rtol."""
MOST_MODES = 20_000
"""Of a density step: more are asked for by mistake, not by need."""
VELOCITIES, MOST_VELOCITIES = 33, 513
"""At which a spectrum along x is taken, spread over the start's velocities: its largest amplitude varies little between them.
More, up to the second, where the start has parts narrower than their distance, so that none is missed."""
NOISELESS_MIXING = 1.1
"""Margin for the shortest wave in v where no noise smooths what is beyond it. Chosen."""
GAUGE_ROUND_OFF = 0.05
"""Of rtol, to the round-off of the global gauge; beyond it the local one is taken (operators/linearised/grid.py). Chosen."""


@dataclass(frozen=True)
class Waves:
    """Of the start that these scales belong to."""

    scales: Scales

    @functools.cached_property
    def amplitudes(self) -> Array:
        """The largest |f_k(v)| over a few velocities, over that of all k, for modes 0, 1, …"""
        return self._spectrum(np.ones_like(self.scales.density))

    @functools.cached_property
    def lifted_amplitudes(self) -> Array:
        """Likewise of f exp(S·periodic part of Φ), which is what evolves linearly under (6)."""
        phi = self.scales.scene.cross_section * self._potential
        return self._spectrum(np.exp(phi - phi.max()))

    @functools.cached_property
    def in_play(self) -> tuple[Array, Array]:
        """(k, ln(10 A_k/rtol)): the waves exp(ikx) whose relative amplitude A_k counts, k = 0 always among them.

        They are those of f; for (6) those of f exp(S·periodic part of Φ) as well.
        """
        scales, amplitude = self.scales, self.amplitudes
        scene, rtol = scales.scene, scales.rtol
        if scene.initial.step is not None:
            amplitude = amplitude[: self.step_modes + 1]
        if scales.amplifies and not scales.start.homogeneous:
            amplitude = np.maximum(amplitude, self.lifted_amplitudes[: amplitude.size])
        n = np.flatnonzero(amplitude > rtol / DROPPED)
        digits = np.log(DROPPED * amplitude[n] / rtol)
        if scales.amplified_shift:
            # Without a kernel's positivity what is not resolved spreads over all v, and (6) amplifies it in the slow tail.
            digits = digits + scales.amplification * scales.tail
        return 2 * math.pi / scene.pipe.length * n, digits

    @functools.cached_property
    def highest_mode(self) -> int:
        """The highest mode of the start that counts; 0 where nothing depends on x."""
        scene = self.scales.scene
        if self.scales.start.homogeneous:
            return 0
        if scene.initial.step is not None:
            return self.step_modes
        # A density wave is held however weak it is: on fewer points it would be taken for another.
        given = max((m.mode for m in scene.initial.density_modes if m.cos or m.sin), default=0)
        return max(given, self.highest(self.amplitudes))

    def highest(self, amplitude: Array) -> int:
        """The highest mode whose relative amplitude counts."""
        return int(np.flatnonzero(amplitude > self.scales.rtol / DROPPED)[-1])

    def beyond(self, nx: int) -> float:
        """The largest relative amplitude of the start's waves that nx points do not hold."""
        return float(self.amplitudes[nx // 2 + 1 :].max(initial=0.0))

    @functools.cached_property
    def step_modes(self) -> int:
        """Modes of a density step that noise has not damped away by the first time after the start at which anything is written.

        Raises SceneError where they are too many, or rtol finer than a step with collisions allows, unless grid.nx is given.
        """
        scales = self.scales
        scene, rtol = scales.scene, scales.rtol
        if scales.law is not None and rtol < LEAST_RTOL_OF_A_STEP and scene.grid.nx is None:
            raise SceneError(
                f"accuracy.rtol = {rtol:g}: with initial.step collisions are accurate to {LEAST_RTOL_OF_A_STEP:g} only "
                f"(products with a jump converge slowly in x); allowed: {LEAST_RTOL_OF_A_STEP:g} or more, smooth modes, or "
                "a given grid.nx"
            )
        theta, first = scales.narrowest, transition(scene.model, float(scales.times[1]))
        # The variance of displacement that is left once the velocity is known: what damps a wave at fixed v.
        variance = theta * first.decay**2 + first.velocity_variance
        covariance = theta * first.drift_time * first.decay + first.covariance
        rest = theta * first.drift_time**2 + first.displacement_variance - covariance**2 / variance
        n = np.arange(1, MOST_MODES)
        k = 2 * math.pi / scene.pipe.length * n
        alive = np.exp(-(k**2) * rest / 2) / n > rtol / DROPPED
        if alive[-1] and scene.grid.nx is None:
            raise SceneError(
                f"initial.step: at rtol = {rtol:g} a jump needs more than {MOST_MODES} modes at the first frame, "
                f"t = {float(scales.times[1]):g}; allowed: a later one (run.output_every), a larger accuracy.rtol, or "
                "a given grid.nx"
            )
        return int(np.flatnonzero(alive)[-1]) + 1 if alive.any() else 1

    @functools.cached_property
    def phase_mixing(self) -> float:
        """The largest v-wavenumber into which free motion turns the start's waves before noise damps them."""
        scales = self.scales
        noisy = scales.scene.model.friction * scales.scene.model.noise > 0
        found = mixing(scales.scene.model, *self.in_play, scales.narrowest, scales.end)
        return found * (1.0 if noisy else NOISELESS_MIXING)

    @property
    def gauge_range(self) -> float:
        """S·(max - min) over x of the periodic part of the start's Φ = ∫ρ dx."""
        scene = self.scales.scene
        if self.scales.start.homogeneous or not self.scales.amplifies:
            return 0.0
        return scene.cross_section * float(np.ptp(self._potential))

    @property
    def local_gauge(self) -> bool:
        """True where the exactly linearised step will need its local gauge (operators/linearised/grid.py)."""
        return float(np.finfo(float).eps) * math.exp(self.gauge_range) > GAUGE_ROUND_OFF * self.scales.rtol

    @functools.cached_property
    def _potential(self) -> Array:
        scene, x = self.scales.scene, self.scales.x
        return self.scales.start.density_integral(x) - scene.initial.density * x

    def _spectrum(self, weight: Array) -> Array:
        """Relative amplitudes along x of weight(x)·f."""
        s = self.scales
        reach = s.tail * math.sqrt(float(s.temperature.max()))
        low, high = float(s.mean_velocity.min()) - reach, float(s.mean_velocity.max()) + reach
        count = min(MOST_VELOCITIES, max(VELOCITIES, math.ceil((high - low) / math.sqrt(s.narrowest))))
        v = np.linspace(low, high, count)
        return relative_amplitudes(weight[:, None] * s.start.outline(s.x, v))


def mixing(model: Model, k: Array, digits: Array, theta: float, left: float) -> float:
    """The largest v-wavenumber at which free motion still leaves more than the dropped amplitude of waves k in x, within a time.

    A gas of temperature θ has waves of amplitude e^digits times the dropped one. f's joint characteristic function is Gaussian:
    at x-wavenumber k it has its peak at q = -kC/V with amplitude exp(-k²(D - C²/V)/2) and width V^(-1/2), where V, C, D are the
    variances and the covariance of velocity and displacement.
    """
    worst = 0.0
    for t in np.linspace(0, left, 65)[1:]:
        step = transition(model, float(t))
        e, b = step.decay, step.drift_time
        variance = theta * e * e + step.velocity_variance
        if variance == 0:
            continue
        covariance = theta * b * e + step.covariance
        rest = theta * b * b + step.displacement_variance - covariance**2 / variance
        room = 2 * (digits - k**2 * rest / 2)
        alive = room > 0
        q = k[alive] * covariance / variance + np.sqrt(room[alive] / variance)
        worst = max(worst, float(q.max(initial=0.0)))
    return worst
