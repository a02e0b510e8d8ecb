"""(2) with operator (6), linearised about its Gaussian homogeneous state: everything in closed form but one integral.

Units γ = σ = 1, the frame of u_h, waves exp(ikx + st), so that k is k*, Sρ is R, and f = ρM(w)[1 + h(w)exp(ikx)] obeys

    ∂h/∂t = -ikw h + h'' - (w + R)h' + R(⟨wh⟩ - w⟨h⟩),   M = exp(-w²/2)/√(2π),  ⟨·⟩ = ∫M · dw.

With κ = R + ik, q = 1 - exp(-t), the density after t is ⟨φ_t h(0)⟩,

    φ_t(w) = (R/κ) exp[ikκ(t - q)] {1 + (ik/R) exp(-κqw - (κq)²/2)},

by insertion into the adjoint equation (docs/stability_details.md, tests/linear_theory/test_follow_leader.py). All else follows
from it. R = 0 is the gas without collisions.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.stability.closure import closure_generator
from kinetic_solver.stability.hermite import HermiteEquations, follow_leader_equations
from kinetic_solver.stability.units import Complex
from kinetic_solver.threads import with_one_blas_thread

MOST_FUNCTIONS = 512
"""Hermite functions beyond which transient growth is not computed: matrix exponentials cost their cube."""
SHORTEST_WAVE = 36.0
"""The largest k* of an eigenfunction. At unit density it reaches exp(k*²/2), which overflows at k* = 37.7."""


@dataclass(frozen=True)
class FollowLeaderFlow:
    """A `Flow` (flow.py) about the Gaussian of (6), or of the gas without collisions, R* = 0."""

    collision_number: float
    """R*."""
    temperature: float = 1.0

    def rates(self, wavenumber: float, count: int) -> tuple[Complex, Array]:
        """s_n = -n - k² + ikR, exact; Re s < 0 for every k ≠ 0."""
        s = -np.arange(count) - wavenumber**2 + 1j * wavenumber * self.collision_number
        return s, np.zeros(count)

    def distribution(self, w: Array) -> Array:
        return np.exp(-(np.asarray(w, dtype=float) ** 2) / 2) / math.sqrt(2 * math.pi)

    def eigenfunction(self, wavenumber: float, branch: int, w: Array) -> Complex:
        """M h_n with h_n = (κ/ik) exp(-ikw + k²/2) He_n(w + R + 2ik)/κⁿ - R/ik, of unit density."""
        k, number = wavenumber, self.collision_number
        if k > SHORTEST_WAVE:
            raise SceneError(f"k* = {k:.4g}: a wave so short overflows at unit density; allowed: up to {SHORTEST_WAVE:g}")
        kappa = number + 1j * k
        z = (np.asarray(w, dtype=float) + number + 2j * k) / kappa
        # He_n(κz)/κⁿ by its recurrence, the powers of κ divided out
        before, polynomial = np.zeros_like(z), np.ones_like(z)
        for n in range(branch):
            before, polynomial = polynomial, z * polynomial - n / kappa**2 * before
        h = kappa / (1j * k) * np.exp(-1j * k * w + k * k / 2) * polynomial - number / (1j * k)
        return self.distribution(w) * h

    def equations(self, wavenumber: float) -> HermiteEquations:
        """As many functions as the norm of exp(Gt) needs to be right to 1e-6. Raises SceneError above `MOST_FUNCTIONS`."""
        return follow_leader_equations(self.collision_number, _enough_functions(wavenumber, self.collision_number))

    def density_gain(self, wavenumber: float, times: Array) -> Array:
        """⟨|φ_t|²⟩ = exp(-2k²(t - q)) [R² + k² exp((R² + k²)q²)]/(R² + k²)."""
        k2, r2 = wavenumber**2, self.collision_number**2
        t = np.asarray(times, dtype=float)
        q = -np.expm1(-t)
        with np.errstate(over="ignore"):
            slow = r2 * np.exp(-2 * k2 * (t - q))
            return (slow + k2 * np.exp((r2 + k2) * q**2 - 2 * k2 * (t - q))) / (r2 + k2)

    def structure_factor(self, wavenumber: float) -> float:
        """With y = k²(2t - 2q - q²) and Dawson's integral D,

            S(k) = ∫_0^∞ exp(-y) {exp(R²q²) + R[R exp(R²q²) erf(Rq) + (2k/√π) D(kq)]/[(R² + k²)q]} dy.

        For k → 0: exp(R²)(1 + erf R); for k → ∞: 1. It is the integral over time of what noise and collisions do to φ_t
        (docs/stability_details.md); the Lyapunov equation gives the same (tests/linear_theory/test_structure_factor.py). To
        1e-12; inf above 1e308.
        """
        from scipy.special import dawsn, erf

        k, number = wavenumber, self.collision_number
        # The trapezoidal rule in log t converges geometrically: the integrand falls as t³ below and as exp(-2k²t) above.
        log_t = np.linspace(math.log(1e-5 / max(1.0, k)), math.log(40.0 + 40.0 / k**2), 600)
        t = np.exp(log_t)
        q = -np.expm1(-t)
        y = k**2 * _excess(t, q)
        with np.errstate(over="ignore"):
            grown = np.exp((number * q) ** 2 - y)
            collided = number * grown * erf(number * q) + 2 * k / math.sqrt(math.pi) * dawsn(k * q) * np.exp(-y)
            integrand = 2 * k**2 * (q**2 * grown + number * q / (number**2 + k**2) * collided)
            return float(np.sum(integrand * t) * (log_t[1] - log_t[0]))


def _excess(t: Array, q: Array) -> Array:
    """2t - 2q - q², which is 2t³/3 - t⁴/2 + … at small t, without the cancellation there."""
    series = t**3 * (2 / 3 + t * (-1 / 2 + t * (7 / 30 - t / 12)))
    return np.where(t < 0.01, series, 2 * t - 2 * q - q**2)


@functools.lru_cache(maxsize=256)
@with_one_blas_thread
def _enough_functions(wavenumber: float, collision_number: float) -> int:
    """Hermite polynomials with which the norm of exp(Gt) is converged to 1e-6 at t = 1/2, 1 and 2."""
    from scipy.linalg import expm

    count = 16 * math.ceil(1 + collision_number**2 / 8)
    previous = None
    while count <= MOST_FUNCTIONS:
        half = expm(0.5 * closure_generator(wavenumber, collision_number, count))
        norms = np.array([np.linalg.norm(half, 2), np.linalg.norm(half @ half, 2), np.linalg.norm(half @ half @ half @ half, 2)])
        if previous is not None and (np.abs(norms - previous) < 1e-6 * np.maximum(norms, 1.0)).all():
            return count
        previous, count = norms, 2 * count
    raise SceneError(
        f"R* = {collision_number:.4g}, k* = {wavenumber:.4g}: {MOST_FUNCTIONS} moments do not resolve transient growth; "
        "allowed: a smaller initial.density or collisions.cross_section (density_gain has a closed form at any)"
    )
