"""What every sum of the closed form needs to know of the scene at one time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.scene import Modes, Scene
from kinetic_solver.theory.ornstein_uhlenbeck import Transition, transition

LOOK = 2048
"""Places at which the start is looked at for its extremes: two over a width of the narrowest pulse that a scene may have."""
SMALLEST = 1e-280
"""Variances below this would lose digits: numbers end at 1e-308. What moves less has not moved."""


@dataclass(frozen=True)
class Setting:
    """A scene at one time."""

    scene: Scene
    time: float

    @cached_property
    def spread(self) -> Transition:
        return transition(self.scene.model, self.time)

    @cached_property
    def beams(self) -> list[tuple[float, float, float]]:
        return initial.beams(self.scene)

    @property
    def length(self) -> float:
        return self.scene.pipe.length

    @property
    def s(self) -> float:
        return self.scene.cross_section

    @property
    def growth(self) -> float:
        """Sρ̄, at which exp(SΦ0) grows from period to period."""
        return self.s * self.scene.initial.density

    @cached_property
    def varied(self) -> bool:
        """True where mean velocity or temperature depend on x at time 0; then there is one beam."""
        return any(m.cos or m.sin for m in (*self.scene.initial.velocity_modes, *self.scene.initial.temperature_modes))

    @property
    def at_start(self) -> bool:
        """True where nothing has moved yet, or by less than numbers can tell."""
        return self.time == 0 or float(self.covariance(np.asarray(self.coldest))[0]) < SMALLEST

    @property
    def noiseless(self) -> bool:
        """True where a particle at (x, v) has one starting point."""
        return self.place_variance < SMALLEST

    @cached_property
    def coldest(self) -> float:
        """The least temperature of any beam at time 0."""
        return min(theta * self._warmth[0] for _, _, theta in self.beams)

    @cached_property
    def hottest(self) -> float:
        return max(theta * self._warmth[1] for _, _, theta in self.beams)

    @cached_property
    def _warmth(self) -> tuple[float, float]:
        """The least and the largest temperature over a beam's own."""
        over = initial.temperature(self.scene, self.length * np.arange(LOOK) / LOOK, 1.0)
        return float(over.min()), float(over.max())

    @cached_property
    def _densities(self) -> Array:
        return initial.density(self.scene, self.length * np.arange(LOOK) / LOOK)

    @cached_property
    def steepness(self) -> tuple[float, float]:
        """By how much exp(SΦ0) grows at most faster, and slower, than exp(Sρ̄y): S times the density's difference from ρ̄."""
        mean = self.scene.initial.density
        return self.s * max(0.0, float(self._densities.max()) - mean), self.s * max(0.0, mean - float(self._densities.min()))

    @property
    def steepest(self) -> float:
        """The largest slope of SΦ0."""
        return self.growth + self.steepness[0]

    @cached_property
    def swing(self) -> float:
        """The range of the periodic part of SΦ0, or a little more."""
        if self.s == 0:
            return 0.0
        phi = initial.density_excess(self.scene, self.length * np.arange(LOOK) / LOOK)
        return self.s * float(np.ptp(phi)) + sum(self.steepness) * self.length / LOOK

    @cached_property
    def k_max(self) -> float:
        """The shortest wave of the start."""
        start = self.scene.initial
        modes = (*start.modes, *start.velocity_modes, *start.temperature_modes)
        k = 2 * math.pi / self.length * max((m.mode for m in modes), default=0)
        if start.pulse is not None:
            k += 1.5 / (start.pulse.width * self.length)  # nine of a Gaussian's widths in k are six times this
        return k

    def fields(self, y: Array, u0: float, theta0: float) -> tuple[Array, Array]:
        """Mean velocity and temperature of one beam at time 0."""
        return initial.mean_velocity(self.scene, y, u0), initial.temperature(self.scene, y, theta0)

    def waves(self, y: Array) -> Array:
        """S(Φ0(y) - ρ̄y)."""
        return self.s * initial.density_excess(self.scene, y) if self.s else np.zeros_like(y)

    def tilt(self, u: Array | float, theta: Array | float) -> Array | float:
        """-Sρ̄m + (Sρ̄)²X/2 less its value for the first beam, m and X being mean and variance of the displacement: what weighting
        with exp(Sρ̄y) adds to the logarithm of a Gaussian in x - y, apart from moving its mean by -Sρ̄X."""
        (_, first_u, first_theta), steep = self.beams[0], self.growth * self.spread.drift_time
        return steep * (steep * (theta - first_theta) / 2 - (u - first_u))

    @cached_property
    def base(self) -> float:
        """The mean velocity of the first beam without modes where exp(Sρ̄y) moves it."""
        (_, u, theta), k = self.beams[0], self.spread
        return k.velocity_shift + u * k.decay - self.growth * float(self.covariance(np.asarray(theta))[1])

    def apart(self, u: Array | float, theta: Array | float) -> Array | float:
        """What others have over `base`."""
        (_, first_u, first_theta), k = self.beams[0], self.spread
        return k.decay * (u - first_u - self.growth * k.drift_time * (theta - first_theta))

    def logarithm(self, offset: Array, y: Array) -> Array:
        """SΦ0(y) less what `Mixture.log_scale` is without of log E; y = x - gravity's displacement - offset."""
        (_, u, theta), k = self.beams[0], self.spread
        xx = theta * k.drift_time**2 + k.displacement_variance
        return np.asarray(self.waves(y) - self.growth * (offset - u * k.drift_time + self.growth * xx / 2))

    def covariance(self, theta0: Array) -> tuple[Array, Array, Array]:
        """Of what starts with temperature θ0: variance of x, covariance, and variance of v given x."""
        k = self.spread
        e, b = k.decay, k.drift_time
        xx, xv = theta0 * b * b + k.displacement_variance, theta0 * b * e + k.covariance
        # The determinant, expanded so that nothing cancels when the noise is weak.
        determinant = theta0 * self._place_spread + self._noise_determinant
        return xx, xv, determinant / np.maximum(xx, 1e-300)

    @cached_property
    def _place_spread(self) -> float:
        """The noise's variance of eX - bV, X and V being displacement and velocity: which does not depend on the start."""
        k = self.spread
        e, b = k.decay, k.drift_time
        return max(0.0, b * b * k.velocity_variance + e * e * k.displacement_variance - 2 * b * e * k.covariance)

    @cached_property
    def _noise_determinant(self) -> float:
        k = self.spread
        return max(0.0, k.displacement_variance * k.velocity_variance - k.covariance**2)

    @property
    def place_variance(self) -> float:
        """Of the starting point of a particle whose velocity now is known, whatever it was: from the noise alone."""
        return self._place_spread / self.spread.decay**2 if self.spread.decay**2 > SMALLEST else math.inf

    @property
    def of_velocity(self) -> tuple[float, float]:
        """(κe, τ²): by how much the noise changes the velocity for each length by which it moves the starting point, and the
        variance of that change once the starting point is known."""
        k, spread = self.spread, self._place_spread
        e, b = k.decay, k.drift_time
        return e * (b * k.velocity_variance - e * k.covariance) / spread, e * e * self._noise_determinant / spread

    def spacing(self, theta: float, precise: bool) -> float:
        """Between nodes in y: π over the bandwidth of the narrowest Gaussian in y, of ρ0's waves and of exp(SΦ0).

        `precise`: for f at given v, which knows more of the starting point than the moments do.
        """
        xx, xv, vv = (float(value) for value in self.covariance(np.asarray(theta)))
        precision = 1 / xx
        if precise:
            precision += (xv / xx) ** 2 / vv if vv > SMALLEST else math.inf
        return math.pi / (9 * math.sqrt(precision) + 6 * self.k_max + 6 * max(self.steepness))


def slopes(modes: Modes, length: float, scale: float = 1.0) -> tuple[float, float]:
    """Bounds on the first and second derivative of the Fourier sum times `scale`."""
    waves = [(2 * math.pi * m.mode / length, scale * math.hypot(m.cos, m.sin)) for m in modes]
    return math.fsum(k * a for k, a in waves), math.fsum(k * k * a for k, a in waves)


def derivative(modes: Modes, y: Array, length: float) -> Array:
    """d/dy of the Fourier sum."""
    total = np.zeros_like(y)
    for m in modes:
        k = 2 * np.pi * m.mode / length
        total += k * (m.sin * np.cos(k * y) - m.cos * np.sin(k * y))
    return total


def jumps(scene: Scene, low: float, high: float) -> Array:
    """The places between `low` and `high` where the density jumps, periods counted from far away included."""
    step, length = scene.initial.step, scene.pipe.length
    if step is None:
        return np.empty(0)
    periods = np.arange(math.floor(low / length) - 1, math.ceil(high / length) + 1)
    return np.concatenate([length * (periods + step.start), length * (periods + step.end)])
