"""What arrives at places: at each of them a mixture of Gaussians in v, one from every starting point."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array

MANY = 5000
"""Terms of a mixture from which only those near a velocity are summed."""
SIGMAS = 10.0
"""Starting points further than this many standard deviations from the weights' bulk are left out: exp(-50) = 2e-22."""


@dataclass(frozen=True)
class Mixture:
    """f(x, ·) = Σ weight N(v; base + mean, variance) at one place or at several that share the Gaussians."""

    weight: Array
    """Shape (places, terms)."""
    base: float
    """From which means are counted: a cold gas that moves fast keeps the digits of its temperature."""
    mean: Array
    variance: Array
    log_scale: Array
    """log E(x) - Sρ̄(x - m) - (Sρ̄)²X/2 of every place, m and X being mean and variance of the displacement, of the first beam
    without its modes."""

    def moments(self) -> tuple[Array, Array, Array, Array]:
        """Density, mean velocity, temperature and heat flux of every place; of nothing they are 0, NaN, NaN and 0."""
        rho = self.weight.sum(axis=1)
        with np.errstate(invalid="ignore"):
            u = self.weight @ self.mean / rho
        c = self.mean - np.where(rho > 0, u, 0.0)[:, None]
        with np.errstate(invalid="ignore"):
            theta = (self.weight * (c * c + self.variance)).sum(axis=1) / rho
        return rho, self.base + u, theta, (self.weight * (c**3 + 3 * c * self.variance)).sum(axis=1)

    def at(self, v: Array) -> Array:
        """f at every v, (places, len(v)); where that is many narrow terms, those within SIGMAS of v."""
        v = v - self.base
        height = self.weight / np.sqrt(2 * np.pi * self.variance)
        if self.mean.size < MANY:
            distance = v - self.mean[:, None]
            return np.asarray(height @ np.exp(-(distance**2) / (2 * self.variance[:, None])))
        order = np.argsort(self.mean, kind="stable")
        mean, variance, height = self.mean[order], self.variance[order], height[:, order]
        reach = SIGMAS * math.sqrt(float(variance.max()))
        f = np.empty((height.shape[0], v.size))
        near = zip(np.searchsorted(mean, v - reach).tolist(), np.searchsorted(mean, v + reach).tolist(), strict=True)
        for j, (a, b) in enumerate(near):
            f[:, j] = height[:, a:b] @ np.exp(-((v[j] - mean[a:b]) ** 2) / (2 * variance[a:b]))
        return f
