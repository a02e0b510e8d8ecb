"""The exact solution of the nonlinear equation (2) with operator (6), and without collisions.

It shares no numerics with the grid solver. With Φ_x = ρ, Φ_t = -ρu and f = F exp(-SΦ), F obeys the linear Kramers equation,
whose Green's function N2(x, v | y) for particles that start at y is a Gaussian in (x, v) (docs/theory_details.md). So for
every Maxwellian start, ρ0, u0 and θ0 depending on y as they may,

    f(x, v, t) = ∫ρ0(y) exp(SΦ0(y)) N2(x, v | y) dy / E(x),    E(x) = exp(SΦ(x, t)),

and E follows from E_x = S∫F dv; it is 1 without collisions. F is linear in the start: of beams both are sums over the beams, each
times its share. All terms are positive. Sums are done in log space.

Error of f and of the moments: below 1e-13 of their largest values, at any time, with any noise or none, in steep starts and after
streams have met (tests/exact/test_closed_form_by_sums.py, tests/exact/test_free_flight.py), as far as doubles hold the answer.
They do not
beyond 2e-16 times the displacement over f's shortest length in x, |v| over its shortest width in v, or S times the number of
particles in the pipe. Where too much has met, or friction without noise leaves no width in v, it is refused (SceneError).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.exact import nearby, uniform
from kinetic_solver.exact.mixture import MANY, Mixture
from kinetic_solver.exact.panels import Panels
from kinetic_solver.exact.setting import SMALLEST, Setting, jumps
from kinetic_solver.exact.varied import Varied
from kinetic_solver.scene import Scene

PULSE_POINTS = 4.0
"""Points over the pipe, times a pulse's width, at which sums over a period of it and of its products with modes are exact to
rounding."""


class Solution:
    """The exact solution at one time."""

    def __init__(self, scene: Scene, time: float) -> None:
        self.scene, self.time = scene, time
        self.setting = Setting(scene, time)
        self.beams, self.spread = self.setting.beams, self.setting.spread
        if scene.model.noise == 0 and self.setting.coldest * self.spread.decay**2 < SMALLEST and not self.setting.at_start:
            raise SceneError(
                f"run.end_time: at t = {time:g} friction without noise has cooled the gas below what numbers can tell; "
                "allowed: an earlier time, or model.noise above 0"
            )
        self._varied = Varied(self.setting) if self.setting.varied and not self.setting.at_start else None

    def distribution(self, x: ArrayLike, v: ArrayLike) -> Array:
        """f at the points, shape (len(x), len(v))."""
        x, v = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(v, float))
        if self.setting.at_start:
            return initial.distribution(self.scene, x, v)
        if self.setting.noiseless:
            return nearby.along_paths(self.setting, x, v, self._log_scale(x))
        shared = uniform.count(self.setting, precise=True) if self._varied is None else self._varied.count()
        if shared > max(MANY, nearby.count(self.setting) * v.size):
            return nearby.distribution(self.setting, x, v, self._log_scale(x))
        return np.concatenate([mixture.at(v) for mixture in self._mixtures(x, precise=True)])

    def moments(self, x: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Density, mean velocity, temperature and heat flux ∫(v - u)³ f dv at x: moments of the mixture of Gaussians.

        Where there are no particles mean velocity and temperature are NaN: they do not exist.
        """
        x = np.atleast_1d(np.asarray(x, float))
        if self.setting.at_start:
            rho, u, theta, q = self._moments_of_the_start(x)
            return rho, np.where(rho > 0, u, np.nan), np.where(rho > 0, theta, np.nan), q
        rho, u, theta, q = (np.concatenate(part) for part in zip(*(m.moments() for m in self._mixtures(x)), strict=True))
        return rho, u, theta, q

    def _mixtures(self, x: Array, precise: bool = False) -> Iterator[Mixture]:
        if self._varied is None:
            return uniform.mixtures(self.setting, x, precise)
        return self._varied.mixtures(x, precise)

    def _log_scale(self, x: Array) -> Array:
        """That of `Mixture`."""
        if self.setting.s == 0:
            return np.zeros_like(x)
        return np.concatenate([mixture.log_scale for mixture in self._mixtures(x)])

    def _moments_of_the_start(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """A sum of Maxwellians has a heat flux, where one has none."""
        rho = initial.density(self.scene, x)
        parts = [(share, *self.setting.fields(x, u, theta)) for share, u, theta in self.beams]
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
            edges = np.concatenate(
                [np.linspace(0.0, length, count // 10 + 1), np.clip(jumps(self.scene, 0.0, length), 0, length)]
            )
            panels = Panels.between(edges[None, :])
            y, weights = panels.nodes.ravel(), panels.weights.ravel()
        rho, u, theta, _ = self._moments_of_the_start(y)
        return float(weights @ (rho * u)), float(weights @ (rho * (u**2 + theta))) / 2
