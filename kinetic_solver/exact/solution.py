"""The exact solution of the nonlinear equation (2) with operator (6), and without collisions.

It shares no numerics with the grid solver. With Φ_x = ρ, Φ_t = -ρu and f = F exp(-SΦ), F obeys the linear Kramers equation,
whose Green's function N2(x, v | y) for particles that start at y is a Gaussian in (x, v) (docs/theory_details.md). So for
every Maxwellian start, ρ0, u0 and θ0 depending on y as they may,

    f(x, v, t) = ∫ρ0(y) exp(SΦ0(y)) N2(x, v | y) dy / E(x),    E(x) = exp(SΦ(x, t)) = ∫exp(SΦ0(y)) φ(ξ) (-dξ/dy) dy,

ξ(y) = (x - y - m(y))/s(y) the starting point's displacement in standard deviations, φ the standard normal density; E follows from
E_x = S∫F dv by parts, and is 1 without collisions. F is linear in the start: of beams both integrals are sums over the beams,
each times its share. For uniform u0, θ0 all terms are positive. Sums are done in log space.
Error: below 1e-13 of max f (tests/exact/test_exact.py).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.scene import Modes, Scene
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MANY = 5000
"""Terms of a mixture from which only those near a velocity are summed."""
PULSE_POINTS = 4.0
"""Points over the pipe, times a pulse's width, at which sums over a period of it and of its products with modes are exact to
rounding."""
SIGMAS = 10.0
"""Starting points further than this many standard deviations from the weights' bulk are left out: exp(-50) = 2e-22."""


class Solution:
    """The exact solution at one time."""

    def __init__(self, scene: Scene, time: float) -> None:
        self.scene, self.time = scene, time
        self.beams = initial.beams(scene)
        self.spread = transition(scene.model, time)
        self._rho_max = float(initial.density(scene, scene.pipe.length * np.arange(2048) / 2048).max())

    def distribution(self, x: ArrayLike, v: ArrayLike) -> Array:
        """f at the points, shape (len(x), len(v))."""
        x, v = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(v, float))
        if self.time == 0:
            return initial.distribution(self.scene, x, v)
        noiseless = self.spread.velocity_variance == 0
        f = np.empty((x.size, v.size))
        for i, w in enumerate(self._weights(x)):
            if noiseless:
                f[i] = self._along_characteristics(x[i], v, w.log_scale)
            else:
                f[i] = w.mixture(v)
        return f

    def moments(self, x: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Density, mean velocity, temperature and heat flux ∫(v - u)³ f dv at x: moments of the mixture of Gaussians."""
        x = np.atleast_1d(np.asarray(x, float))
        if self.time == 0:
            return self._moments_of_the_start(x)
        rho, u, theta, q = np.empty((4, x.size))
        for i, w in enumerate(self._weights(x)):
            rho[i] = w.weight.sum()
            u[i] = w.weight @ w.mean / rho[i]
            c = w.mean - u[i]
            theta[i] = w.weight @ (c * c + w.variance) / rho[i]
            q[i] = w.weight @ (c**3 + 3 * c * w.variance)
        return rho, u, theta, q

    def _fields(self, y: Array, u0: float, theta0: float) -> tuple[Array, Array]:
        """Mean velocity and temperature of one beam."""
        return initial.mean_velocity(self.scene, y, u0), initial.temperature(self.scene, y, theta0)

    def _moments_of_the_start(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """A sum of Maxwellians has a heat flux, where one has none."""
        rho, parts = initial.density(self.scene, x), [(share, *self._fields(x, u, theta)) for share, u, theta in self.beams]
        mean = np.asarray(sum(share * u for share, u, _ in parts))
        variance = np.asarray(sum(share * (theta + (u - mean) ** 2) for share, u, theta in parts))
        third = np.asarray(sum(share * (u - mean) * ((u - mean) ** 2 + 3 * theta) for share, u, theta in parts))
        return rho, mean, variance, rho * third

    def start_totals(self) -> tuple[float, float]:
        """(momentum, energy) at time 0, by Gauss-Legendre panels between the jumps, or the trapezoidal rule over a period."""
        start, length = self.scene.initial, self.scene.pipe.length
        modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
        count = 64 + 8 * max((m.mode for m in modes), default=0)
        if start.pulse is not None:
            count = max(count, math.ceil(PULSE_POINTS / start.pulse.width))
        if start.step is None:
            y: Array = length * np.arange(count) / count
            weights = np.full(count, length / count)
        else:
            y, weights = self._nodes(0.0, length, length / count)
        rho, u, theta, _ = self._moments_of_the_start(y)
        return float(weights @ (rho * u)), float(weights @ (rho * (u**2 + theta))) / 2

    def _weights(self, x: Array) -> Iterator[_Weights]:
        """For each x: what arrives there, as a mixture of Gaussians in v, one from each node y."""
        scene, k = self.scene, self.spread
        e, b, length = k.decay, k.drift_time, scene.pipe.length
        reaches = [self._reach(u, theta) for _, u, theta in self.beams]
        for point in x:
            found = [self._nodes(point + behind, point + ahead, spacing) for behind, ahead, spacing in reaches]
            y = np.concatenate([nodes for nodes, _ in found])
            quadrature = np.concatenate([share * w for (share, _, _), (_, w) in zip(self.beams, found, strict=True)])
            of_beams = [self._fields(nodes, u, theta) for (_, u, theta), (nodes, _) in zip(self.beams, found, strict=True)]
            u0, theta0 = (np.concatenate(part) for part in zip(*of_beams, strict=True))
            base = np.repeat([theta for _, _, theta in self.beams], [nodes.size for nodes, _ in found])
            rho0 = initial.density(scene, y)
            xx, xv, vv = self._covariance(theta0)
            displaced = point - y - u0 * b - k.displacement_shift
            log_weight = scene.cross_section * initial.density_integral(scene, y) - displaced**2 / (2 * xx)
            top = float(log_weight.max())
            kernel = np.exp(log_weight - top) * quadrature / np.sqrt(2 * np.pi * xx)
            # -s dξ/dy, 1 for uniform u0 and θ0
            du = _derivative(scene.initial.velocity_modes, y, length)
            dtheta = base * _derivative(scene.initial.temperature_modes, y, length)
            scale = float(kernel @ (1 + b * du + displaced * b * b * dtheta / (2 * xx)))
            yield _Weights(
                weight=kernel * rho0 / scale,
                mean=k.velocity_shift + u0 * e + xv / xx * displaced,
                variance=vv,
                log_scale=top + math.log(scale),
            )

    def _reach(self, u0: float, theta0: float) -> tuple[float, float, float]:
        """Of one beam: from how far behind and ahead particles may have come, and the nodes' spacing."""
        k, b, length = self.spread, self.spread.drift_time, self.scene.pipe.length
        u, theta = self._fields(length * np.arange(2048) / 2048, u0, theta0)
        drift = b * np.array([u.min(), u.max()]) + k.displacement_shift
        wide = math.sqrt(float(theta.max()) * b * b + k.displacement_variance)
        # Starting points lie a displacement behind; exp(SΦ0) favours dense places ahead, by at most S ρ_max variance.
        ahead = self.scene.cross_section * self._rho_max * wide**2
        return -drift[1] - SIGMAS * wide, -drift[0] + SIGMAS * wide + ahead, self._spacing(float(theta.min()))

    def _covariance(self, theta0: Array) -> tuple[Array, Array, Array]:
        """Of what starts with temperature θ0: variance of x, covariance, and variance of v given x."""
        k = self.spread
        e, b = k.decay, k.drift_time
        xx, xv = theta0 * b * b + k.displacement_variance, theta0 * b * e + k.covariance
        # The determinant, expanded so that nothing cancels when the noise is weak.
        determinant = theta0 * (b * b * k.velocity_variance + e * e * k.displacement_variance - 2 * b * e * k.covariance) + (
            k.displacement_variance * k.velocity_variance - k.covariance**2
        )
        return xx, xv, np.maximum(determinant, 0.0) / xx

    def _spacing(self, theta: float) -> float:
        """Between nodes: π over the integrand's bandwidth, that of its narrowest Gaussian, of ρ0's waves and of exp(SΦ0)."""
        start = self.scene.initial
        xx, xv, vv = (float(value) for value in self._covariance(np.asarray(theta)))
        precision = 1 / xx + ((xv / xx) ** 2 / vv if vv > 0 else 0.0)
        modes = (*start.modes, *start.velocity_modes, *start.temperature_modes)
        k_max = 2 * math.pi / self.scene.pipe.length * max((m.mode for m in modes), default=0)
        if start.pulse is not None:
            k_max += 1.5 / (start.pulse.width * self.scene.pipe.length)  # nine of a Gaussian's widths in k, as of the others
        return math.pi / (9 * math.sqrt(precision) + 6 * k_max + 6 * self.scene.cross_section * self._rho_max)

    def _nodes(self, low: float, high: float, spacing: float) -> tuple[Array, Array]:
        """Nodes and weights in y: the trapezoidal rule (spectrally accurate: the integrand is smooth and vanishes at both
        ends), or, with a density step, Gauss-Legendre panels between the jumps."""
        step, length = self.scene.initial.step, self.scene.pipe.length
        if step is None:
            count = math.ceil((high - low) / spacing)
            return low + spacing * np.arange(count + 1), np.full(count + 1, spacing)
        periods = np.arange(math.floor(low / length), math.ceil(high / length) + 1)
        jumps = np.concatenate([length * (periods + step.start), length * (periods + step.end)])
        edges = np.unique(np.concatenate([[low, high], jumps[(jumps > low) & (jumps < high)]]))
        abscissae, gauss = np.polynomial.legendre.leggauss(20)
        nodes, weights = [], []
        for a, z in itertools.pairwise(edges):
            panels = max(1, math.ceil((z - a) / (10 * spacing)))
            half = (z - a) / panels / 2
            centres = a + half * (2 * np.arange(panels) + 1)
            nodes.append((centres[:, None] + half * abscissae).ravel())
            weights.append(np.tile(half * gauss, panels))
        return np.concatenate(nodes), np.concatenate(weights)

    def _along_characteristics(self, x: float, v: Array, log_scale: float) -> Array:
        """Without noise a particle at (x, v) has one starting point; f there, times exp(S(Φ0 - Φ))/e."""
        k = self.spread
        v0 = (v - k.velocity_shift) / k.decay
        y = x - k.drift_time * v0 - k.displacement_shift
        exponent = self.scene.cross_section * initial.density_integral(self.scene, y) - log_scale
        height, f = initial.density(self.scene, y) / k.decay, np.zeros_like(v)
        for share, u0, theta0 in self.beams:
            u, theta = self._fields(y, u0, theta0)
            # One exponential: the slow are many times what a double holds, of next to nothing.
            f += share * height * np.exp(exponent - (v0 - u) ** 2 / (2 * theta)) / np.sqrt(2 * np.pi * theta)
        return f


@dataclass(frozen=True)
class _Weights:
    """f(x, ·) as Σ weight N(v; mean, variance), and log E(x)."""

    weight: Array
    mean: Array
    variance: Array
    log_scale: float

    def mixture(self, v: Array) -> Array:
        """Σ weight N(v; mean, variance) at every v; where that is many narrow terms, those within SIGMAS of v."""
        height = self.weight / np.sqrt(2 * np.pi * self.variance)
        if self.mean.size < MANY:
            distance = v[:, None] - self.mean[None, :]
            return np.asarray(np.exp(-(distance**2) / (2 * self.variance)) @ height)
        order = np.argsort(self.mean, kind="stable")
        mean, variance, height = self.mean[order], self.variance[order], height[order]
        reach = SIGMAS * math.sqrt(float(variance.max()))
        near = zip(np.searchsorted(mean, v - reach).tolist(), np.searchsorted(mean, v + reach).tolist(), v.tolist(), strict=True)
        return np.array([np.exp(-((u - mean[a:b]) ** 2) / (2 * variance[a:b])) @ height[a:b] for a, b, u in near])


def _derivative(modes: Modes, y: Array, length: float) -> Array:
    """d/dy of the Fourier sum."""
    total = np.zeros_like(y)
    for m in modes:
        k = 2 * np.pi * m.mode / length
        total += k * (m.sin * np.cos(k * y) - m.cos * np.sin(k * y))
    return total
