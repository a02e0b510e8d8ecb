"""Hermite functions in v: the basis in which the linear part of (2), transport included, has its propagator in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.operators.moments import Moments
from kinetic_solver.scene import Model
from kinetic_solver.theory.hermite import hermite_functions
from kinetic_solver.theory.ornstein_uhlenbeck import phi1, phi2


@dataclass(frozen=True)
class HermiteBasis:
    """f(v) = Σ a_n φ_n(v), n < count, with φ_n = He_n(w)/√n! · N(v; centre, variance), w = (v - centre)/√variance.

    He_n(w)/√n! are dual to them: a_n = ∫f He_n(w)/√n! dv, so a_0 … a_3 are the moments. A state is a real array (nx, count).
    A Maxwellian's coefficients fall like |1 - θ/variance|^(n/2): there is no expansion at θ ≥ 2·variance, and a slow one for
    cold states. Tests: tests/invariants/test_hermite.py.
    """

    centre: float
    variance: float
    count: int

    def values(self, v: Array) -> Array:
        """φ_n(v), shape (count, len(v))."""
        w = (v - self.centre) / math.sqrt(self.variance)
        weight = np.exp(-(w**2) / 2) / math.sqrt(2 * math.pi * self.variance)
        return hermite_functions(w, weight, self.count)

    def coefficients(self, f: Array, v: Array) -> Array:
        """(nx, count) from point values f (nx, len(v)) on uniform v, by the trapezoidal rule: spectrally accurate in dv.

        He_n/√n! grows like exp(w²/4): an error of f in its tail is multiplied by that. Where f is a Maxwellian, use `maxwellian`.
        """
        w = (v - self.centre) / math.sqrt(self.variance)
        dv = float(v[1] - v[0])
        return f @ hermite_functions(w, np.full(v.shape, dv), self.count).T

    def maxwellian(self, density: Array, mean_velocity: Array, temperature: Array) -> Array:
        """ρ N(v; u, θ) in closed form; density, mean velocity and temperature of shape (nx,)."""
        shift = (mean_velocity - self.centre) / math.sqrt(self.variance)
        excess = temperature / self.variance - 1
        a = np.empty((self.count, *np.shape(density)))
        a[0] = density
        if self.count > 1:
            a[1] = shift * a[0]
        for n in range(1, self.count - 1):
            a[n + 1] = (shift * a[n] + excess * math.sqrt(n) * a[n - 1]) / math.sqrt(n + 1)
        return np.ascontiguousarray(a.T)

    def moments(self, a: Array) -> Moments:
        """Exact moments of the expansion, shape (nx,) each; count ≥ 4. NaN velocity and temperature where there is no density."""
        density = a[:, 0].copy()
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = a[:, 1] / density
            temperature = self.variance * (1 + math.sqrt(2) * a[:, 2] / density - shift**2)
        third = math.sqrt(6) * a[:, 3] - 3 * math.sqrt(2) * shift * a[:, 2] + 2 * shift**2 * a[:, 1]
        return Moments(density, self.centre + math.sqrt(self.variance) * shift, temperature, self.variance**1.5 * third)

    def velocity_moments(self, a: Array) -> Array:
        """∫v^n f dv, n = 0 … 3, shape (4, nx), of the first four coefficients (nx, 4): exact."""
        c, s = self.centre, math.sqrt(self.variance)
        first, second, third = (
            s * a[:, 1],
            s**2 * (math.sqrt(2) * a[:, 2] + a[:, 0]),
            s**3 * (math.sqrt(6) * a[:, 3] + 3 * a[:, 1]),
        )
        n = a[:, 0]
        return np.stack(
            [n, first + c * n, second + 2 * c * first + c**2 * n, third + 3 * c * second + 3 * c**2 * first + c**3 * n]
        )

    def totals(self, a: Array, dx: float) -> tuple[float, float, float]:
        """(mass, momentum, energy): ∫∫f, ∫∫v f, ½∫∫v² f dv dx."""
        n0, n1, n2 = (float(value) * dx for value in a[:, :3].sum(axis=0))
        u, width = self.centre, math.sqrt(self.variance)
        energy = (u**2 + self.variance) * n0 + 2 * u * width * n1 + self.variance * math.sqrt(2) * n2
        return n0, u * n0 + width * n1, energy / 2


def propagators(
    basis: HermiteBasis, wavenumbers: Array, rate: float, model: Model, h: float, rows: int | None = None
) -> NDArray[np.complex128]:
    """exp(hG) for each wavenumber k, shape (len(wavenumbers), count, count), or its first `rows` rows only, for F_t = GF with

        GF = -ik v F - rate (v - centre) F - ∂/∂v[(g - γv) F] + σγ ∂²F/∂v².

    It is exact under truncation: the block n < count of the infinite matrix. `rate` is the growth along x of F's Bloch factor
    exp(rate (x - centre t)) (operators/linearised/hermite.py), 0 in a plain linear step. The basis must have the noise's
    variance.

    With a φ_n = √n φ_{n-1}, √variance = s, q = (1 - e)/γ, e = exp(-γh),

        exp(hG) = exp[-ik centre h + αβ(γh - 1 + e)/γ²] exp(αq a†) exp(-γh a†a) exp(βq a),
        β = -(ik + rate) s,   α = β + (g - γ centre)/s.

    That product of triangular matrices must not be formed: at k s/γ = 15 and γh = 0.7 its terms cancel to the last digit, at
    k s/γ = 30 and 128 functions they are 1e33 times the result. Its entries are P_{n+d, n} = (αq)^d Q_n, P_{n, n+d} = (βq)^d Q_n,
    Q_n a scaled generalised Laguerre polynomial L_n^(d)(-αβq²/e). The recurrence of these in n is stable, and written for
    differences it keeps all digits as h → 0. Error below 1e-13 of the largest entry: measured in 120-digit arithmetic for
    k s/γ ≤ 30, rate s/γ ≤ 5, γh from 1e-3 to 5, up to 256 functions; 2e-15 where that entry is of order one.
    """
    gamma, width = model.friction, math.sqrt(basis.variance)
    if gamma > 0 and not math.isclose(basis.variance, model.noise, rel_tol=1e-12):
        # a programming error: the plan chooses no such case
        raise ValueError(f"the basis has variance {basis.variance:g}, the noise {model.noise:g}: they must agree")
    count, k = basis.count, np.asarray(wavenumbers, dtype=float)
    e, q = math.exp(-gamma * h), h * phi1(gamma * h)
    beta = -(1j * k + rate) * width
    alpha = beta + (model.gravity - gamma * basis.centre) / width
    log_scale = -1j * k * (basis.centre * h) + alpha * beta * (h * h * phi2(gamma * h))
    lower, upper = alpha * q, beta * q

    d = np.arange(count)
    # (αq)^d alone may overflow where the entry does not: the recurrence runs on m^d Q, m the larger of |αq|, |βq|.
    larger = np.maximum(np.abs(lower), np.abs(upper))
    larger[larger == 0] = 1.0
    lower_powers = (lower / larger)[:, None] ** d
    upper_powers = (upper / larger)[:, None] ** d
    log_factorial = np.cumsum(np.log(np.maximum(d, 1)))
    value = np.exp(log_scale[:, None] + np.log(larger)[:, None] * d - log_factorial / 2)
    difference = value
    product = (lower * upper)[:, None]
    rows = count if rows is None else rows
    result = np.empty((k.size, rows, count), dtype=np.complex128)
    for n in range(rows):
        result[:, n:, n] = (value * lower_powers[:, : count - n])[:, : rows - n]
        result[:, n, n:] = value * upper_powers[:, : count - n]
        # (n + 1)(L_{n+1} - L_n) = (n + d)(L_n - L_{n-1}) - x L_n, times m^d e^n √(n!/(n + d)!)
        d = d[:-1]
        ratio = e * np.sqrt((n + 1) / (n + 1 + d))
        value = value[:, :-1]
        difference = (ratio * (n + d) / (n + 1)) * difference[:, :-1] + product * (1 / np.sqrt((n + 1.0) * (n + 1 + d))) * value
        value = ratio * value + difference
    return result
