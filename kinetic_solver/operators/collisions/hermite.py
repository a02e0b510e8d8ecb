"""The two collision operators on Hermite coefficients: C[f] of a finite expansion, exact and then cut off.

The basis is that of operators/velocity/hermite.py; states and rates have shape (nx, count).
Tests: tests/invariants/test_hermite.py.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.operators.velocity.hermite import HermiteBasis
from kinetic_solver.theory.hermite import hermite_functions


class FollowLeaderHermite:
    """(6), C = S f (j - ρv). Tridiagonal; conserves mass exactly. The exactly linearised step
    (operators/linearised/hermite.py) does without it."""

    conserves = ("mass",)

    def __init__(self, basis: HermiteBasis, cross_section: float) -> None:
        self.basis = basis
        self.cross_section = cross_section
        self._roots = np.sqrt(np.arange(1.0, basis.count))

    def rate(self, a: Array) -> Array:
        # j - ρv = √variance (a_1 - a_0 w), and w φ_n = √(n + 1) φ_{n+1} + √n φ_{n-1}
        moved = np.zeros_like(a)
        moved[:, 1:] += self._roots * a[:, :-1]
        moved[:, :-1] += self._roots * a[:, 1:]
        return self.cross_section * math.sqrt(self.basis.variance) * (a[:, 1:2] * a - a[:, :1] * moved)


class InelasticHermite:
    """(12), C_n = S √variance Σ T_njk a_j a_k, with the tensor T of the weak form exact to round-off (`_tensor`).

    Conserves mass and momentum exactly, C_0 and C_1 being zeros, not sums; ε = 1 gives exactly zero. What `count` functions miss
    falls geometrically: θ of the homogeneous state (ε = 0.5, R* = 1) to 3e-5, 7e-9, 1e-10 with 8, 16, 24.
    Cost: count³/4 multiplications per x, as matrix products.
    """

    conserves = ("mass", "momentum")

    def __init__(self, basis: HermiteBasis, cross_section: float, restitution: float) -> None:
        self.basis = basis
        self.cross_section = cross_section
        self.restitution = restitution

    def rate(self, a: Array) -> Array:
        c = np.zeros_like(a)
        if self.restitution == 1:
            return c
        by_mode = np.ascontiguousarray(a.T)
        scale = self.cross_section * math.sqrt(self.basis.variance)
        for parity in (0, 1):
            j, k = _pairs(self.basis.count, parity)
            products = by_mode[j]
            products *= by_mode[k]
            c[:, 2 + parity :: 2] = scale * (_tensor(self.basis.count, self.restitution, parity) @ products).T
        return c


@functools.lru_cache(maxsize=16)
def _pairs(count: int, parity: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All (j, k), j ≤ k < count, with j + k of this parity."""
    j, k = np.triu_indices(count)
    chosen = (j + k) % 2 == parity
    return j[chosen], k[chosen]


@functools.lru_cache(maxsize=16)
def _tensor(count: int, restitution: float, parity: int) -> Array:
    """T for unit variance: rows n = 2 + parity, 4 + parity, …, columns `_pairs`, T_njk + T_nkj for j < k, T_njj for j = k, where

        T_njk = ∫∫_{a>b} N(a)N(b) r h_j(a) h_k(b) [h_n(b + αr) + h_n(a - αr) - h_n(a) - h_n(b)] da db,  r = a - b, h_n = He_n/√n!.

    It vanishes where n + j + k is odd, and for n < 2. With c = (a + b)/√2 and y = r/√2 the products are at (c ± εy)/√2, and the
    integrand, symmetrised in j and k, is y N(c)N(y) times a polynomial in c and y²: Gauss-Hermite quadrature in c and
    Gauss-Laguerre quadrature in y²/2 are exact. Every function carries its share exp(-w²/4) of the Gaussians: none is large.
    """
    nodes, _ = np.polynomial.hermite_e.hermegauss(3 * count // 2 + 1)
    t, _ = np.polynomial.laguerre.laggauss(3 * count // 4 + 1)
    # Weights over the weight function are 1/Σ of the squared orthonormal functions: a few digits better than numpy's weights.
    # c < 0 mirrors c > 0.
    weights = 1 / np.sum(hermite_functions(nodes, np.exp(-(nodes**2) / 4), nodes.size) ** 2, axis=0)
    c, weights = nodes[nodes >= 0], np.where(nodes > 0, 2 * weights, weights)[nodes >= 0]
    outer = 1 / np.sum(_laguerre_functions(t) ** 2, axis=0)
    j, k = _pairs(count, parity)
    both = np.where(j == k, 0.5, 1.0)[:, None]
    tensor = np.zeros((len(range(2 + parity, count, 2)), j.size))
    # r N(y) dy = √2 y exp(-y²/2) dy/√(2π) = exp(-t) dt/√π
    for y, weight in zip(np.sqrt(2 * t), outer / math.sqrt(math.pi), strict=True):
        a, b = (c + y) / math.sqrt(2), (c - y) / math.sqrt(2)
        at_a, at_b = hermite_functions(a, np.exp(-(a**2) / 4), count), hermite_functions(b, np.exp(-(b**2) / 4), count)
        fast, slow = (c + restitution * y) / math.sqrt(2), (c - restitution * y) / math.sqrt(2)
        share = np.exp(-(c**2 + y**2) / 4)
        gain = hermite_functions(fast, share, count) + hermite_functions(slow, share, count)
        change = gain - hermite_functions(a, share, count) - hermite_functions(b, share, count)
        pairs = both * (at_a[j] * at_b[k] + at_a[k] * at_b[j])
        tensor += (weight * weights * change[2 + parity :: 2]) @ pairs.T
    return tensor


def _laguerre_functions(t: Array) -> Array:
    """L_n(t) exp(-t/2), n < len(t), shape (len(t), len(t))."""
    out = np.empty((t.size, t.size))
    out[0] = np.exp(-t / 2)
    out[1] = (1 - t) * out[0]
    for n in range(1, t.size - 1):
        out[n + 1] = ((2 * n + 1 - t) * out[n] - n * out[n - 1]) / (n + 1)
    return out
