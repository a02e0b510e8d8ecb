"""(2) with (6), or without collisions, cut after M Hermite moments: nonlinear, spectral in x, its linear part exact in t.

f = Σ a_n(x, t) φ_n(w) exp(-w²/2)/√(2πσ), w = (v - u_h)/√σ, φ_n = He_n/√n!, n < M, and a_M = 0. About the homogeneous state, a =
(ρ̄, 0, …) + ã, what is left of (6) is quadratic:

    dã/dt = L ã + S√σ [ã_1 ã_n - ã_0 (wã)_n],   (wã)_n = √n ã_{n-1} + √(n+1) ã_{n+1},

with L for waves exp(ikx): -nγ - iku_h on the diagonal, -ik√(nσ) from n - 1 to n, -(ik + Sρ̄)√((n+1)σ) from n + 1 to n (from 1
to 0: -ik√σ), and -Sρ̄√σ besides from 0 to 1. With M = 3 this has the linearisation of the closure (3)-(5), but it is another
equation once waves are large: the third moment that it drops is about u_h and σ, not about the flow's own u and θ. Tests:
tests/hydrodynamics/test_hierarchy.py."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.scene import Scene
from kinetic_solver.stability.units import Complex


class Hierarchy:
    """M moments of a scene; states are Fourier coefficients of ã, shape (K + 1, M), of waves 0 … K on the period."""

    def __init__(self, scene: Scene, moments: int) -> None:
        self.scene, self.moments = scene, moments
        self.gamma, self.sigma = scene.model.friction, scene.model.noise
        self.collisions = scene.cross_section if scene.law is not None else 0.0
        self.drag = self.collisions * scene.initial.density
        self.mean_velocity = (scene.model.gravity - self.drag * self.sigma) / self.gamma
        self._root = np.sqrt(np.arange(1.0, moments))

    def generator(self, waves: int) -> Complex:
        """L of waves 0 … K, shape (K + 1, M, M)."""
        n, root = np.arange(self.moments), math.sqrt(self.sigma) * self._root
        ik = 2j * math.pi / self.scene.pipe.length * np.arange(waves + 1)[:, None]
        result = np.zeros((waves + 1, self.moments, self.moments), dtype=complex)
        result[:, n, n] = -n * self.gamma - ik * self.mean_velocity
        result[:, n[1:], n[:-1]] = -ik * root
        result[:, n[:-1], n[1:]] = -(ik + self.drag) * root
        result[:, 0, 1] += self.drag * root[0]
        result[:, 1, 0] -= self.drag * root[0]
        return result

    def quadratic(self, state: Complex) -> Complex:
        """S√σ [ã_1 ã_n - ã_0 (wã)_n], all its waves 0 … K exact: the products are formed on more than 3K points."""
        if self.collisions == 0:
            return np.zeros_like(state)
        waves = state.shape[0] - 1
        a = _on_points(state, _points(3 * waves + 1))
        moved = np.zeros_like(a)
        moved[:, 1:] = self._root * a[:, :-1]
        moved[:, :-1] += self._root * a[:, 1:]
        product = a[:, 1:2] * a - a[:, :1] * moved
        return self.collisions * math.sqrt(self.sigma) * np.fft.rfft(product, axis=0, norm="forward")[: waves + 1]

    def start(self, waves: int) -> Complex:
        """Of ρ N(v; u, θ): E[He_{n+1}] = y E[He_n] + n(θ/σ - 1) E[He_{n-1}], y = (u - u_h)/√σ."""
        x = self.scene.pipe.length * np.arange(n := _points(4 * waves + 1)) / n
        u0, theta0 = initial.start_state(self.scene)
        y = (initial.mean_velocity(self.scene, x, u0) - self.mean_velocity) / math.sqrt(self.sigma)
        wider = initial.temperature(self.scene, x, theta0) / self.sigma - 1
        orthonormal = np.ones((x.size, self.moments))
        orthonormal[:, 1] = y
        for n in range(1, self.moments - 1):
            before = n * wider * orthonormal[:, n - 1] / math.sqrt(n * (n + 1))
            orthonormal[:, n + 1] = y * orthonormal[:, n] / math.sqrt(n + 1) + before
        a = initial.density(self.scene, x)[:, None] * orthonormal
        a[:, 0] -= self.scene.initial.density
        return np.fft.rfft(a, axis=0, norm="forward")[: waves + 1]

    def fields(self, state: Complex, nx: int) -> Array:
        """ρ, u, θ and the heat flux at nx points of the period, shape (4, nx)."""
        finer = nx * math.ceil((2 * state.shape[0] - 1) / nx)
        a = _on_points(state[:, :4], finer)[:: finer // nx].T
        rho, root = self.scene.initial.density + a[0], math.sqrt(self.sigma)
        drift, square = a[1] / rho, 1 + math.sqrt(2) * a[2] / rho
        third = ((math.sqrt(6) * a[3] if self.moments > 3 else 0.0) + 3 * a[1]) / rho
        heat = rho * self.sigma**1.5 * (third - 3 * square * drift + 2 * drift**3)
        return np.stack([rho, self.mean_velocity + root * drift, self.sigma * (square - drift**2), heat])

    def totals(self, state: Complex) -> Array:
        """∫ρ, ∫ρu and ∫½ρ(u² + θ)."""
        u, root, length = self.mean_velocity, math.sqrt(self.sigma), self.scene.pipe.length
        rho, one, two = self.scene.initial.density + state[0, 0].real, root * state[0, 1].real, state[0, 2].real
        energy = 0.5 * (rho * (u * u + self.sigma) + 2 * u * one + math.sqrt(2) * self.sigma * two)
        return length * np.array([rho, u * rho + one, energy])


def _on_points(state: Complex, n: int) -> Array:
    return np.fft.irfft(state, n=n, axis=0, norm="forward")


def _points(least: int) -> int:
    """An odd number of points, so that there is no wave without a sine, fast to transform."""
    from scipy.fft import next_fast_len

    n = least | 1
    while next_fast_len(n, real=True) != n:
        n += 2
    return n
