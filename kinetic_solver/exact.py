"""The exact solution of the nonlinear equation (2) with operator (6), and without collisions.

It shares no numerics with the grid solver. With Φ_x = ρ, Φ_t = -ρu and f = F exp(-SΦ), F obeys the linear Kramers equation,
whose Green's function N2(x, v | y) for particles that start at y is a Gaussian in (x, v) (docs/theory.md). So for
every Maxwellian start, ρ0, u0 and θ0 depending on y as they may,

    f(x, v, t) = ∫ρ0(y) exp(SΦ0(y)) N2(x, v | y) dy / E(x),    E(x) = exp(SΦ(x, t)) = ∫exp(SΦ0(y)) φ(ξ) (-dξ/dy) dy,

ξ(y) = (x - y - m(y))/s(y) the starting point's displacement in standard deviations, φ the standard normal density; E follows from
E_x = S∫F dv by parts, and is 1 without collisions. For uniform u0, θ0 all terms are positive. Sums are done in log space.
Error: below 1e-13 of max f (tests/exact/test_exact.py).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.homogeneous import start_state
from kinetic_solver.output import MemoryRecorder
from kinetic_solver.scene import INELASTIC, Model, Modes, Scene, SceneError

if TYPE_CHECKING:
    import xarray as xr

MANY = 5000
"""Terms of a mixture from which only those near a velocity are summed."""
SIGMAS = 10.0
"""Starting points further than this many standard deviations from the weights' bulk are left out: exp(-50) = 2e-22."""


def solve(scene: Scene, x: ArrayLike | None = None, v: ArrayLike | None = None) -> xr.Dataset:
    """The exact solution at the scene's frames as a Dataset (docs/output.md); moments from the closed form, not from sums over v.

    `x` (uniform over one period from 0) and `v` (uniform) give the points, as `run["x"]`, `run["v"]` of a grid run; by default
    grid.nx or 64, and grid.nv or 128 points in grid.velocity_window or one that holds the solution.
    Raises SceneError for operator (12) and for a start from a file or an eigenmode, which have no closed form here.
    """
    if scene.operator == INELASTIC:
        raise SceneError(
            "collisions.operator = 'inelastic': has no closed form; allowed for the exact method: 'follow-the-leader', none"
        )
    if scene.initial.file is not None:
        raise SceneError("initial.file: has no closed form; the exact method starts from a Maxwellian")
    if scene.initial.eigenmodes:
        raise SceneError("initial.eigenmodes: have no closed form here; the exact method starts from a Maxwellian")
    grid = _grid(scene, x, v)
    recorder = MemoryRecorder(grid, scene, method="exact")
    for time in scene.times():
        state = Solution(scene, float(time))
        moments = state.moments(grid.x)
        rho, u, theta, q = moments
        f = state.distribution(grid.x, grid.v)
        frame: dict[str, dict[str, Array | float]] = {}
        if scene.output.f is not False:
            frame["f"] = {"f": f}
        if scene.output.moments is not False:
            frame["moments"] = {
                "density": rho,
                "mean_velocity": u,
                "temperature": theta,
                "heat_flux": q,
                "velocity_distribution": f.sum(axis=0) * grid.dx,
            }
        if scene.output.scalars is not False:
            frame["scalars"] = {
                "mass": rho.sum() * grid.dx,
                "momentum": (rho * u).sum() * grid.dx,
                "energy": (rho * (u**2 + theta)).sum() * grid.dx / 2,
            }
        recorder.record(float(time), frame)
    recorder.close()
    dataset = recorder.dataset()
    for name, points in (("x", x), ("v", v)):
        if points is not None:  # bit for bit as given: xarray aligns equal coordinates only
            dataset = dataset.assign_coords({name: (name, np.asarray(points, dtype=float), dataset[name].attrs)})
    return dataset


@dataclass(frozen=True)
class _Spread:
    """Displacement and velocity of a particle that starts at velocity v0: means linear in v0, and the noise's covariance."""

    decay: float
    drift_time: float
    velocity_shift: float
    displacement_shift: float
    xx: float
    xv: float
    vv: float


def _spread(model: Model, t: float) -> _Spread:
    """By Gauss-Legendre quadrature of the Langevin equation's response where γt is small, in closed form elsewhere."""
    g, gamma, sigma = model.gravity, model.friction, model.noise
    if gamma * t > 1:
        e = math.exp(-gamma * t)
        b, m = (1 - e) / gamma, g / gamma
        xx = sigma / gamma**2 * (2 * gamma * t - 3 + 4 * e - e * e)
        return _Spread(e, b, m * (1 - e), m * (t - b), xx, sigma / gamma * (1 - e) ** 2, sigma * (1 - e * e))
    nodes, weights = np.polynomial.legendre.leggauss(24)
    s, w = t * (nodes + 1) / 2, t * weights / 2
    response = np.exp(-gamma * s)
    moved = -np.expm1(-gamma * s) / gamma if gamma > 0 else s
    strength = 2 * sigma * gamma
    return _Spread(
        decay=math.exp(-gamma * t),
        drift_time=float(w @ response),
        velocity_shift=g * float(w @ response),
        displacement_shift=g * float(w @ moved),
        xx=strength * float(w @ moved**2),
        xv=strength * float(w @ (moved * response)),
        vv=strength * float(w @ response**2),
    )


class Solution:
    """The exact solution at one time."""

    def __init__(self, scene: Scene, time: float) -> None:
        self.scene, self.time = scene, time
        self.u0, self.theta0 = start_state(scene)
        self.spread = _spread(scene.model, time)
        self._rho_max = float(initial.density(scene, scene.pipe.length * np.arange(2048) / 2048).max())

    def distribution(self, x: ArrayLike, v: ArrayLike) -> Array:
        """f at the points, shape (len(x), len(v))."""
        x, v = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(v, float))
        if self.time == 0:
            rho, u, theta = self._start(x)
            return initial.maxwellian(rho, u, theta, v)
        noiseless = self.spread.vv == 0
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
            rho, u, theta = self._start(x)
            return rho, u, theta, np.zeros_like(rho)
        rho, u, theta, q = np.empty((4, x.size))
        for i, w in enumerate(self._weights(x)):
            rho[i] = w.weight.sum()
            u[i] = w.weight @ w.mean / rho[i]
            c = w.mean - u[i]
            theta[i] = w.weight @ (c * c + w.variance) / rho[i]
            q[i] = w.weight @ (c**3 + 3 * c * w.variance)
        return rho, u, theta, q

    def _start(self, y: Array) -> tuple[Array, Array, Array]:
        s = self.scene
        return initial.density(s, y), initial.mean_velocity(s, y, self.u0), initial.temperature(s, y, self.theta0)

    def _weights(self, x: Array) -> Iterator[_Weights]:
        """For each x: what arrives there, as a mixture of Gaussians in v, one from each node y."""
        scene, k = self.scene, self.spread
        e, b, length = k.decay, k.drift_time, scene.pipe.length
        _, u, theta = self._start(length * np.arange(2048) / 2048)
        drift = b * np.array([u.min(), u.max()]) + k.displacement_shift
        wide = math.sqrt(float(theta.max()) * b * b + k.xx)
        # Starting points lie a displacement behind; exp(SΦ0) favours dense places ahead, by at most S ρ_max variance.
        ahead = scene.cross_section * self._rho_max * wide**2
        spacing = self._spacing(float(theta.min()))
        for point in x:
            y, quadrature = self._nodes(point - drift[1] - SIGMAS * wide, point - drift[0] + SIGMAS * wide + ahead, spacing)
            rho0, u0, theta0 = self._start(y)
            xx, xv, vv = self._covariance(theta0)
            displaced = point - y - u0 * b - k.displacement_shift
            log_weight = scene.cross_section * initial.density_integral(scene, y) - displaced**2 / (2 * xx)
            top = float(log_weight.max())
            kernel = np.exp(log_weight - top) * quadrature / np.sqrt(2 * np.pi * xx)
            # -s dξ/dy, 1 for uniform u0 and θ0
            du = _derivative(scene.initial.velocity_modes, y, length)
            dtheta = self.theta0 * _derivative(scene.initial.temperature_modes, y, length)
            scale = float(kernel @ (1 + b * du + displaced * b * b * dtheta / (2 * xx)))
            yield _Weights(
                weight=kernel * rho0 / scale,
                mean=k.velocity_shift + u0 * e + xv / xx * displaced,
                variance=vv,
                log_scale=top + math.log(scale),
            )

    def _covariance(self, theta0: Array) -> tuple[Array, Array, Array]:
        """Of what starts with temperature θ0: variance of x, covariance, and variance of v given x."""
        k = self.spread
        e, b = k.decay, k.drift_time
        xx, xv = theta0 * b * b + k.xx, theta0 * b * e + k.xv
        # The determinant, expanded so that nothing cancels when the noise is weak.
        determinant = theta0 * (b * b * k.vv + e * e * k.xx - 2 * b * e * k.xv) + (k.xx * k.vv - k.xv**2)
        return xx, xv, np.maximum(determinant, 0.0) / xx

    def _spacing(self, theta: float) -> float:
        """Between nodes: π over the integrand's bandwidth, that of its narrowest Gaussian, of ρ0's waves and of exp(SΦ0)."""
        start = self.scene.initial
        xx, xv, vv = (float(value) for value in self._covariance(np.asarray(theta)))
        precision = 1 / xx + ((xv / xx) ** 2 / vv if vv > 0 else 0.0)
        modes = (*start.modes, *start.velocity_modes, *start.temperature_modes)
        k_max = 2 * math.pi / self.scene.pipe.length * max((m.mode for m in modes), default=0)
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
        rho, u, theta = self._start(y)
        exponent = self.scene.cross_section * initial.density_integral(self.scene, y) - log_scale
        f0 = rho / np.sqrt(2 * np.pi * theta)
        return f0 * np.exp(exponent - (v0 - u) ** 2 / (2 * theta)) / k.decay


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


def _grid(scene: Scene, x: ArrayLike | None, v: ArrayLike | None) -> PhaseSpaceGrid:
    nx = np.size(x) if x is not None else scene.grid.nx or (1 if scene.homogeneous else 64)
    nv = np.size(v) if v is not None else scene.grid.nv or 128
    if v is not None:
        points = np.asarray(v, float)
        half = (points[-1] - points[0]) / (nv - 1) / 2
        low, high = float(points[0] - half), float(points[-1] + half)
    else:
        low, high = scene.grid.velocity_window or _window(scene)
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, low, high)
    for name, given, points in (("x", x, grid.x), ("v", v, grid.v)):
        if given is not None and not np.allclose(given, points, rtol=1e-9, atol=1e-9 * (points[-1] - points[0])):
            raise ValueError(f"{name} must be uniform" + (" over one period, from 0" if name == "x" else ""))
    return grid


def _window(scene: Scene) -> tuple[float, float]:
    """Six standard deviations about every mean velocity at the start and at the end."""
    points = scene.pipe.length * np.arange(64) / 64
    means, spreads = [], []
    for time in (0.0, scene.run.end_time):
        _, u, theta, _ = Solution(scene, time).moments(points)
        means += [u.min(), u.max()]
        spreads.append(theta.max())
    reach = 6 * math.sqrt(max(spreads))
    return float(min(means)) - reach, float(max(means)) + reach
