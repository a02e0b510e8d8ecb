"""Operator (12) in waves in v: a Fourier-Galerkin method (L. Pareschi and B. Perthame 1996).

On a period 2T of w, f = Σ f_l exp(iξ_l w), ξ_l = πl/T; the weak form of (12) (docs/theory_details.md) tested with exp(-iξ_n w) is
a convolution,

    C_n = Σ_{l+m=n} K(n, l) f_l f_m,    K = [D(n, l) + D(n, m)]/2,
    D(n, l) = 2 ∫_0^T r [cos((ξ_l - αξ_n) r) - cos(ξ_l r)] dr,    α = (1 - ε)/2.

The difference of cosines is taken as a product of sines and integrated by Gauss and Legendre's rule, to round-off and relative
to α: nearly elastic collisions, which do next to nothing, lose no digits. All of it converges geometrically: in the points a
width of f, and in the window. Pairs up to T apart collide: where f has ended at T/√2, all that matter. Mass is conserved to
round-off, momentum and energy's rate to what the window cuts off.

Stationary states (stability/galerkin.py) and homogeneous flows (operators/homogeneous.py) are made with it; the pairs of cells of
operators/collisions share nothing with it. Tests: tests/linear_theory/test_inelastic.py, tests/exact/test_homogeneous.py.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array

Complex = NDArray[np.complex128]
RULE = 32
"""Nodes of a rule of Gauss and Legendre are a multiple of so many: finding them costs as much as all else of a state, and states
of other temperatures, or another scene's, then find them done. Chosen."""


class CollisionsInWaves:
    """C at unit cross-section for f on `count` (odd) points of the window [-half, half)."""

    def __init__(self, restitution: float, half: float, count: int) -> None:
        self.restitution, self.half, self.count = restitution, half, count
        self.dv = 2 * half / count
        self.index = np.arange(count) - count // 2
        self.w = self.dv * self.index
        self.xi = np.pi / half * self.index
        turns = np.exp(2j * np.pi / count * np.arange(count))
        self.to_points = turns[np.outer(self.index, self.index) % count]
        self.to_waves = self.to_points.conj() / count
        n, low = np.meshgrid(self.index, self.index, indexing="ij")
        self.kept: NDArray[np.bool_] = np.abs(n - low) <= count // 2
        """Which pairs of waves (n, l) have a wave n - l: at the place `pairs` says."""
        self.pairs = np.where(self.kept, n - low + count // 2, 0)
        change = self._change((1 - restitution) / 2)
        self.quadratic = np.where(self.kept, (change + np.take_along_axis(change, self.pairs, axis=1)) / 2, 0.0)

    def _change(self, alpha: float) -> Array:
        """D(n, l), (count, count)."""
        # The integrand has no wave shorter than those of l and of n/2 together; a rule of n points is exact to degree 2n - 1.
        nodes, weights = _gauss_legendre(RULE * math.ceil((1.3 * self.count + 30) / RULE))
        r, weights = self.half * (nodes + 1) / 2, self.half / 2 * weights
        waves = self.xi[self.count // 2 :]
        half_turn = alpha / 2 * np.outer(waves, r)
        turned = 4 * weights * r * np.sin(half_turn)
        phase = np.outer(r, waves)
        odd, even = (turned * np.cos(half_turn)) @ np.sin(phase), (turned * np.sin(half_turn)) @ np.cos(phase)
        # Of n, l ≥ 0 so far; the first is odd in either, the second even in both.
        same, other = odd - even, -odd - even
        return np.block([[same[:0:-1, :0:-1], other[:0:-1]], [other[:, :0:-1], same]])

    def rate(self, f: Array) -> Array:
        """C[f], on points."""
        waves = self.to_waves @ f
        return np.asarray((self.to_points @ ((self.quadratic * waves[self.pairs]) @ waves)).real)

    def linear(self, f: Array) -> Array:
        """δf → C linearised about f, on points; (count, count)."""
        waves = self.to_waves @ f
        return np.asarray((self.to_points @ (2 * self.quadratic * waves[self.pairs]) @ self.to_waves).real)

    def mean_distance(self, f: Array) -> float:
        """∬f f'|w - w'| dw dw'."""
        x = self.index.astype(float)
        moments = self.half**2 * (2 * np.sinc(x) - np.sinc(x / 2) ** 2)  # ∫|r| exp(iξr) dr over the window
        return float(2 * self.half * moments @ np.abs(self.to_waves @ f) ** 2)

    def interpolate(self, values: Complex | Array, w: Array) -> Complex:
        """The trigonometric interpolant, complex, 0 outside the window."""
        w = np.asarray(w, dtype=float)
        inside = np.abs(w) < self.half
        result = np.zeros(w.shape, dtype=complex)
        result[inside] = np.exp(1j * np.multiply.outer(w[inside], self.xi)) @ (self.to_waves @ values)
        return result


@functools.lru_cache(maxsize=32)
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(count)
