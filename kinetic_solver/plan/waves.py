"""The waves along x of a scene's start: which of them matter, how finely they will fold f in v, and what (6) makes of them.

Everything is computed when it is first asked for, and once.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.fourier import relative_amplitudes
from kinetic_solver.plan.measured import LEAST_RTOL_OF_A_STEP
from kinetic_solver.plan.mixing import mixing
from kinetic_solver.plan.refusal import MORE_RTOL, Refused, Remedy
from kinetic_solver.plan.scales import Scales
from kinetic_solver.theory.ornstein_uhlenbeck import bridge_variance, transition

DROPPED = 10.0
"""Waves of a relative amplitude below rtol over this are left out. Chosen: what is left out, all waves together, is that much
below rtol."""
MOST_MODES = 20_000
"""More are asked for by mistake, not by need."""
MOST_OF_A_STEP = {"none": 20_000, "global": 17_000, "products": 2_500}
"""Modes of a density step: without collisions, with (6) in the global gauge, and where products need twice as many."""
BUDGETS_OF_A_STEP = (16.0, 1000)
"""(a, n): budgets want a step's waves as of an a-th of the first frame's time, but no more than n. Chosen."""
MORE_NOISE = (Remedy("model.friction", "more"), Remedy("model.noise", "more"))
SMOOTH, GIVEN_NX = "initial.modes in its place", "a given grid.nx"
"""What else mends a density step that is refused."""
RANGE_OF_A_STEP = 16.0
"""Of SΦ, beyond which a density step takes the local gauge: what the grid misses of f exp(SΦ) is divided by as much where
that is least. Chosen."""
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
        phi = self.scales.cross_section * self._potential
        return self._spectrum(np.exp(phi - phi.max()))

    @functools.cached_property
    def in_play(self) -> tuple[Array, Array]:
        """(k, ln(10 A_k/rtol)): the waves exp(ikx) whose relative amplitude A_k counts, k = 0 always among them.

        They are those of f; for (6) those of f exp(S·periodic part of Φ) as well.
        """
        scales, amplitude = self.scales, self.amplitudes
        scene, rtol = scales.scene, scales.rtol
        if scene.initial.step is not None:
            amplitude = self._of_a_step(amplitude)
        if scales.amplifies and not scales.start.homogeneous:
            lifted = self.lifted_amplitudes
            lifted = self._of_a_step(lifted) if scene.initial.step is not None else lifted[: amplitude.size]
            amplitude = np.maximum(amplitude, lifted)
        together = _together(amplitude)
        # Many waves, each too small to count, may count together.
        amplitude = np.where(amplitude > rtol / DROPPED, amplitude, together)
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
        """The mode beyond which all together do not count."""
        return int(np.flatnonzero(_together(amplitude) > self.scales.rtol / DROPPED)[-1])

    def beyond(self, nx: int) -> float:
        """The relative amplitude of all the start's waves together that nx points do not hold; of a step's, and where nothing
        couples them, what is left of it at the first frame."""
        first = float(self.scales.times[1])
        if self.scales.scene.initial.step is None or nx == 1:
            left_out = self.amplitudes[nx // 2 + 1 :]
            if self.scales.law is None:
                k = 2 * math.pi / self.scales.scene.pipe.length * (nx // 2 + 1 + np.arange(left_out.size))
                left_out = left_out * np.exp(-(k**2) * bridge_variance(self.scales.scene.model, first) / 2)
            return float(left_out.sum())
        left_out = self._left_out(first)
        jump = float(np.ptp(self.scales.density)) / self.scales.rho_max
        return min(jump, float(left_out[min(nx // 2, left_out.size) - 1]))

    @functools.cached_property
    def step_modes(self) -> int:
        """Modes of a density step that must be held at the first time after the start at which anything is written: what all
        others together leave of f is below rtol/DROPPED.

        With operator (6) in the global gauge they are those of f exp(SΦ), and what is left out counts exp(S·range of Φ) times
        where that is least. Raises Refused where they are more than MOST_OF_A_STEP, unless grid.nx is given.
        """
        scene, first, rtol = self.scales.scene, float(self.scales.times[1]), self.scales.rtol
        local = self.products_of_a_step and self.scales.amplifies
        if local and rtol < LEAST_RTOL_OF_A_STEP and scene.grid.nx is None:
            raise Refused(
                f"accuracy.rtol: with initial.step f is accurate to {LEAST_RTOL_OF_A_STEP:g} only, where collisions are so many "
                "that follow-the-leader steps take the local gauge",
                (MORE_RTOL, Remedy("collisions.cross_section", "less")),
                (SMOOTH, GIVEN_NX),
            )
        allowed = self.scales.rtol / DROPPED
        left_out = self._left_out(first)
        if scene.grid.nx is not None and self._left_at_fixed_velocity(first) == 0:
            return min(left_out.size, scene.grid.nx // 2)  # nothing damps the others: dv must hold what becomes of them
        if left_out[-1] <= allowed:
            enough = _first_below(left_out, allowed)
            if self.followed_from_the_start:
                earlier = self._left_out(first / BUDGETS_OF_A_STEP[0])
                enough = max(enough, min(BUDGETS_OF_A_STEP[1], _first_below(earlier, allowed)))
            return enough
        if scene.grid.nx is not None:
            return min(left_out.size, scene.grid.nx // 2)
        unseen = scene.output.f is False and self.scales.law is None
        if self._left_at_fixed_velocity(first) == 0 and not unseen:
            hidden = ("output.f = false",) if self.scales.law is None else ()
            raise Refused(
                "initial.step: without noise a jump in f stays a jump, which no waves can hold",
                MORE_NOISE,
                (*hidden, SMOOTH, GIVEN_NX),
            )
        raise Refused(
            f"initial.step: a jump needs more than {left_out.size} modes at the first frame, t = {first:g}",
            (Remedy("run.output_every", "more"), MORE_RTOL, *MORE_NOISE),
            (SMOOTH, GIVEN_NX),
        )

    @property
    def products_of_a_step(self) -> bool:
        """True where a step's waves are multiplied with each other: with (12), and with (6) in the local gauge."""
        scales = self.scales
        stepped = scales.scene.initial.step is not None
        return stepped and scales.law is not None and (not scales.amplifies or self.local_gauge)

    @property
    def followed_from_the_start(self) -> bool:
        """True where budgets look at a step's waves before the first frame."""
        scales = self.scales
        return scales.amplifies and not self.products_of_a_step and scales.scene.output.budgets is not False

    def blur(self, time: float) -> float:
        """The variance by which a step that is stepped in the global gauge must be blurred at a time, for its modes to do."""
        if self.scales.scene.initial.step is None or not self.scales.amplifies or self.products_of_a_step:
            return 0.0
        return max(0.0, self._resolved_spread - self._left_at_fixed_velocity(time))

    @functools.cached_property
    def _resolved_spread(self) -> float:
        """Of displacement at fixed velocity, at which the modes of a step do."""
        from scipy.optimize import brentq

        allowed, first = self.scales.rtol / DROPPED, float(self.scales.times[1])

        def excess(t: float) -> float:
            beyond = self._left_out(t)
            return math.log(max(float(beyond[min(self.step_modes, beyond.size) - 1]), 1e-300) / allowed)

        if excess(first) > 0:
            return 0.0
        return self._left_at_fixed_velocity(brentq(excess, 1e-9 * first, first, rtol=1e-6))

    def _left_at_fixed_velocity(self, time: float) -> float:
        """The variance of displacement that is left once the velocity is known: what damps a wave of f."""
        theta, step = self.scales.narrowest, transition(self.scales.scene.model, time)
        variance = theta * step.decay**2 + step.velocity_variance
        covariance = theta * step.drift_time * step.decay + step.covariance
        whole = theta * step.drift_time**2 + step.displacement_variance
        return max(0.0, whole - covariance**2 / variance) if step.velocity_variance else 0.0

    def _left_out(self, time: float) -> Array:
        """What is left of f, over its maximum, by the waves of a density step beyond the first n = 1, 2, … together."""
        from scipy.special import exp1

        scene, law, theta = self.scales.scene, self.scales.law, self.scales.narrowest
        spread = self._left_at_fixed_velocity(time)
        if scene.output.f is False and law is None:  # a density forgets its waves as the velocities mix them
            step = transition(scene.model, time)
            spread = theta * step.drift_time**2 + step.displacement_variance
        kind = "none" if law is None else "products" if self.products_of_a_step else "global"
        n = np.arange(1, MOST_OF_A_STEP[kind] + 1)
        damping = (2 * math.pi / scene.pipe.length) ** 2 * spread / 2
        size = (
            2
            / math.pi
            * float(np.ptp(self.scales.density))
            / self.scales.rho_max
            * (math.exp(self.gauge_range) if kind == "global" else 1.0)
        )
        last = damping * (n[-1] + 0.5) ** 2
        beyond = float(exp1(last)) / 2 if damping > 0 else math.inf
        terms = np.exp(-damping * n**2) / n
        if scene.output.f is False and law is None:  # those of mean velocity and temperature carry k√spread, once and twice
            terms *= 1 + 2 * damping * n**2
            beyond += math.exp(-last)
        return np.asarray(size * (np.cumsum(terms[::-1])[::-1] - terms + beyond))

    @functools.cached_property
    def phase_mixing(self) -> float:
        """The largest v-wavenumber into which free motion turns the start's waves before noise damps them."""
        scales = self.scales
        noisy = scales.scene.model.friction * scales.scene.model.noise > 0
        found = mixing(scales.scene.model, *self.in_play, scales.narrowest, scales.end, float(scales.times[1]))
        return found * (1.0 if noisy else NOISELESS_MIXING)

    def _of_a_step(self, amplitude: Array) -> Array:
        """Of the modes that are held; what mode n and all beyond it make together is no smaller than n times mode n."""
        n = np.arange(amplitude.size // 2)
        return np.append(amplitude[0], np.full(self.step_modes, float((n * amplitude[: n.size]).max())))

    @functools.cached_property
    def gauge_range(self) -> float:
        """S·(max - min) over x of the periodic part of the start's Φ = ∫ρ dx."""
        if self.scales.start.homogeneous or not self.scales.amplifies:
            return 0.0
        return self.scales.cross_section * float(np.ptp(self._potential))

    @functools.cached_property
    def local_gauge(self) -> bool:
        """True where the exactly linearised step will need its local gauge (operators/linearised/grid.py)."""
        if self.scales.scene.initial.step is not None and self.gauge_range > RANGE_OF_A_STEP:
            return True
        # Compared as logarithms: in a long pipe exp(S·range of Φ) is no double.
        return self.gauge_range > math.log(GAUGE_ROUND_OFF * self.scales.rtol / float(np.finfo(float).eps))

    @functools.cached_property
    def _potential(self) -> Array:
        scene, x = self.scales.scene, self.scales.x
        return self.scales.start.density_integral(x) - scene.initial.density * x

    def _spectrum(self, weight: Array) -> Array:
        """Relative amplitudes along x of weight(x)·f."""
        s = self.scales
        if s.of_one_shape:
            return relative_amplitudes(weight * s.density)  # f is ρ times what depends on v alone
        reach = s.tail * math.sqrt(float(s.temperature.max()))
        low, high = float(s.mean_velocity.min()) - reach, float(s.mean_velocity.max()) + reach
        count = min(MOST_VELOCITIES, max(VELOCITIES, math.ceil((high - low) / math.sqrt(s.narrowest))))
        v = np.linspace(low, high, count)
        return relative_amplitudes(weight[:, None] * s.start.outline(s.x, v))


def _together(amplitude: Array) -> Array:
    """Of each mode and all beyond it: what they make at most where they are in step."""
    return np.asarray(np.cumsum(amplitude[::-1])[::-1])


def _first_below(left_out: Array, allowed: float) -> int:
    """How many modes leave out no more than that; all of them where none do."""
    return min(int(np.searchsorted(-left_out, -allowed)) + 1, left_out.size)
