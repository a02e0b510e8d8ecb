"""The linearised equation and its fluctuations in Hermite functions: δf = Σ a_n φ_n(y) M, y = w/√b.

M is the Maxwellian of variance b, φ_n = He_n/√n!, γ = σ = 1. The test functions are polynomials, so that mass and momentum
are exact, and the sum of |a_n|² is ∫|δf|²/M dw. b is θ_h: for operator (6) M is the homogeneous state itself. Convergence in
the number of functions: tests/linear_theory/test_structure_factor.py.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.stability.closure import closure_generator
from kinetic_solver.stability.units import Complex
from kinetic_solver.theory.hermite import hermite_functions

FUNCTIONS = 48
"""Hermite functions for operator (12): S(k) to 5e-6 for R* ≤ 100, to 1e-4 for R* ≤ 300
(tests/linear_theory/test_structure_factor.py)."""


@dataclass(frozen=True)
class HermiteEquations:
    """da/dt = (at_rest - ik√b J) a, with (yφ)_n = Σ J_nm φ_m; and what collisions of N particles do to pairs."""

    at_rest: Array
    """Drift, diffusion and linearised collisions, (count, count)."""
    correlation: Callable[[], Array]
    """Makes Γ of `correlation_source`, which takes time and is not always asked for."""
    variance: float
    """b."""

    @functools.cached_property
    def correlation_source(self) -> Array:
        """Γ_nm = R ∫∫_{v > v'} f_h f_h' (v - v') [φ_n φ_m' + φ_n' φ_m after the collision - the same before it]."""
        return self.correlation()

    @property
    def count(self) -> int:
        """Of the functions."""
        return len(self.at_rest)

    def generator(self, wavenumber: float) -> Complex:
        """G with da/dt = G a for a wave exp(ikx), k = k*; (count, count)."""
        roots = np.sqrt(np.arange(1.0, self.count))
        shear = math.sqrt(self.variance) * (np.diag(roots, 1) + np.diag(roots, -1))
        return self.at_rest - 1j * wavenumber * shear

    def distribution(self, coefficients: Complex, w: Array) -> Complex:
        """δf(w)."""
        y = np.asarray(w, dtype=float) / math.sqrt(self.variance)
        share = np.exp(-(y**2) / 4)
        maxwellian_root = share / math.sqrt(2 * math.pi * self.variance)
        return np.tensordot(coefficients, hermite_functions(y, share, len(coefficients)), axes=1) * maxwellian_root


def lyapunov_structure_factor(equations: HermiteEquations, wavenumber: float) -> float:
    """S(k) = 1 + g_00, where G g + g G† = -Γ.

    In a stationary state the covariance of δf is f_h δ(v - v') + g(v, v'). The first part is the ideal gas; what Fokker-Planck
    terms, transport and the collisions of single particles make of it cancels, since f_h is stationary. Collisions correlate
    the two partners: that is Γ (docs/stability_details.md; M. H. Ernst and E. G. D. Cohen 1981). The covariance's own Lyapunov
    equation G C + C G† = -Q, Q what noise and collisions change, gives the same, where Q does not overflow in polynomials.
    """
    from scipy.linalg import solve_continuous_lyapunov

    source = -equations.correlation_source.astype(complex)
    return 1.0 + float(solve_continuous_lyapunov(equations.generator(wavenumber), source)[0, 0].real)


def matrix_density_gain(equations: HermiteEquations, wavenumber: float, times: Array) -> Array:
    """Σ_n |exp(Gt)_0n|²."""
    from scipy.linalg import expm

    generator = equations.generator(wavenumber)
    return np.array([float(np.sum(np.abs(expm(time * generator)[0]) ** 2)) for time in np.asarray(times, dtype=float)])


def follow_leader_equations(collision_number: float, count: int) -> HermiteEquations:
    """(6): exact but for the cut after `count` functions. The faster of two takes the velocity of the slower."""

    def correlation() -> Array:
        source = np.zeros((count, count))
        for fast, slow, weight in _pairs(count):
            at_fast, at_slow = (hermite_functions(w, np.exp(-(w**2) / 4), count) for w in (fast, slow))
            together = (at_slow * (weight * np.exp(-(fast**2) / 2))) @ at_slow.T
            before = (at_fast * (weight * np.exp(-(fast**2 + slow**2) / 4))) @ at_slow.T
            source += 2 * together - before - before.T
        return collision_number * source

    return HermiteEquations(closure_generator(0.0, collision_number, count).real, correlation, 1.0)


def inelastic_equations(
    restitution: float, collision_number: float, variance: float, w: Array, weights: Array, count: int = FUNCTIONS
) -> HermiteEquations:
    """(12) about f_h, given as quadrature weights: ∫f_h φ dw = Σ weights φ(w)."""
    # f_h in the basis. Beyond 8 thermal velocities its round-off would be multiplied by φ_n.
    y = w / math.sqrt(variance)
    inside = np.abs(y) < 8
    homogeneous = hermite_functions(y[inside], np.ones(int(inside.sum())), count) @ weights[inside]
    collisions, source = np.zeros((count, count)), np.zeros((count, count))
    for fast, slow, weight in _pairs(count):
        middle, half = (fast + slow) / 2, restitution * (fast - slow) / 2
        share = np.exp(-(fast**2 + slow**2) / 4)
        at_fast, at_slow, at_gain, at_lag = (
            hermite_functions(place, np.exp(-(place**2) / 4), count) for place in (fast, slow, middle + half, middle - half)
        )
        f_fast, f_slow = homogeneous @ at_fast, homogeneous @ at_slow
        change = sum(hermite_functions(place, share, count) for place in (middle + half, middle - half))
        change = change - hermite_functions(fast, share, count) - hermite_functions(slow, share, count)
        collisions += (change * weight) @ (f_fast * at_slow + f_slow * at_fast).T
        pairs = weight * f_fast * f_slow
        lost_energy = np.exp(-((fast - slow) ** 2 / 4 - half**2) / 2)
        after, before = (at_gain * (pairs * lost_energy)) @ at_lag.T, (at_fast * pairs) @ at_slow.T
        source += after + after.T - before - before.T
    n = np.arange(float(count))
    fokker_planck = np.diag(-n) + (1 / variance - 1) * np.diag(np.sqrt(n[2:] * (n[2:] - 1)), -2)
    rate = collision_number * math.sqrt(variance)
    return HermiteEquations(fokker_planck + rate * collisions, lambda: rate * source, variance)


def _pairs(count: int) -> Iterator[tuple[Array, Array, Array]]:
    """Velocities v > v' and weights for ∫∫_{v > v'} (v - v') · dv dv'/(2π), in slices of equal v - v'.

    c = (v + v')/√2 by the trapezoidal rule, y = (v - v')/√2 > 0 by Gauss and Legendre's: both converge geometrically for products
    of four Hermite functions. Functions carry shares of the Gaussians, so that no factor is large.
    """
    reach = math.sqrt(2) * (2 * math.sqrt(count) + 5)
    spacing = math.pi / (1.2 * (2 * math.sqrt(2 * count) + 6))
    points = math.ceil(reach / spacing)
    c = spacing * np.arange(-points, points + 1)
    nodes, weights = np.polynomial.legendre.leggauss(math.ceil(0.8 * points))
    for y, weight in zip(reach * (nodes + 1) / 2, reach / 2 * weights, strict=True):
        yield (c + y) / math.sqrt(2), (c - y) / math.sqrt(2), np.full(c.size, weight * spacing * math.sqrt(2) * y / (2 * math.pi))
