"""Operator (12), inelastic collisions, by quadrature of its weak form (docs/theory.md)."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array

POINTS = {"linear": 2, "cubic": 4, "quintic": 6}


class Inelastic:
    """C[f] on a uniform velocity grid: pairs at distance m·dv deposit their products at places that depend on m alone.

    `deposit` is the Lagrange stencil of the products: "linear" (2 points, positive, error O(dv²)), "cubic" (4, O(dv⁴)) or
    "quintic" (6, O(dv⁶), with the Euler-Maclaurin correction for the kink of |v - v'| at 0). All conserve mass and momentum
    to round-off; ε = 1 gives exactly zero. A pair so near the window's edge that its stencil would leave the window is
    deposited linearly, which conserves as well.
    Cost: O(nv²) per x. Tests: tests/invariants/test_collisions.py.
    """

    name = "inelastic"
    conserves = ("mass", "momentum")

    def __init__(self, velocity: Array, cross_section: float, restitution: float, deposit: str = "linear") -> None:
        self.velocity = velocity
        self.cross_section = cross_section
        self.restitution = restitution
        self.dv = float(velocity[1] - velocity[0])
        self._linear = _stencils(velocity.size, restitution, 2)
        self._high = _stencils(velocity.size, restitution, POINTS[deposit])
        # Near r = 0 the weak form's integrand is -α(1-α) r³ f² φ" + ..., whose sum over r = m dv misses the integral by dv⁴/720
        # times its third derivative (Euler-Maclaurin). Only the quintic deposit is accurate enough to notice.
        alpha = (1 - restitution) / 2
        self._kink = alpha * (1 - alpha) / 120 if deposit == "quintic" else 0.0

    def rate(self, f: Array) -> Array:
        if self.restitution == 1:
            return np.zeros_like(f)
        scale = self.cross_section * self.dv**2
        out = _rate(np.ascontiguousarray(f), scale, *self._linear, *self._high)
        if self._kink:
            square = (scale * self._kink) * f[:, 1:-1] ** 2
            out[:, :-2] += square
            out[:, 1:-1] -= 2 * square
            out[:, 2:] += square
        return out

    def collision_frequency_max(self, f: Array) -> float:
        """The largest S∫f'|v - v'|dv' over x and v: it is convex in v, so it lies at an edge of the window."""
        v = self.velocity
        ends = np.stack([np.abs(v - v[0]), np.abs(v - v[-1])], axis=1)
        return float((np.abs(f) @ ends).max() * self.cross_section * self.dv)

    def __call__(self, f: Array, dt: float) -> Array:
        """SSPRK(s, 2) (Spiteri and Ruuth 2002): s - 1 Euler stages and a convex combination, second order.

        As many stages as make every Euler stage a positive step (with the linear deposit), whatever dt.
        """
        if self.restitution == 1:
            return f
        stages = max(2, 1 + math.ceil(dt * self.collision_frequency_max(f)))
        u = f
        for _ in range(stages - 1):
            u = u + dt / (stages - 1) * self.rate(u)
        last = u + dt / (stages - 1) * self.rate(u)
        return f / stages + (stages - 1) / stages * last


def _stencils(nv: int, restitution: float, points: int) -> tuple[NDArray[np.int64], Array]:
    """For each distance m: first index and Lagrange weights of the stencil around α m, counted from the slower particle."""
    place = (1 - restitution) / 2 * np.arange(nv)
    first = np.floor(place).astype(np.int64) - (points // 2 - 1)
    s = place - first
    nodes = np.arange(points)
    weights = np.ones((nv, points))
    for node in nodes:
        for other in nodes:
            if other != node:
                weights[:, node] *= (s - other) / (node - other)
    return first, weights


@numba.njit(cache=True)
def _axpy(out: Array, start: int, w: float, p: Array, first: int, last: int) -> None:
    for j in range(first, last):
        out[start + j] += w * p[j]


@numba.njit(parallel=True, cache=True)
def _rate(
    f: Array,
    scale: float,
    linear_first: NDArray[np.int64],
    linear_weights: Array,
    high_first: NDArray[np.int64],
    high_weights: Array,
) -> Array:
    nx, nv = f.shape
    points = high_weights.shape[1]
    out = np.zeros_like(f)
    for i in numba.prange(nx):
        row = f[i]
        c = out[i]
        p = np.empty(nv)
        for m in range(1, nv):
            pairs = nv - m
            for j in range(pairs):
                p[j] = (scale * m) * row[j] * row[j + m]
            # [begin, end): pairs whose stencils stay inside the window, on both sides
            begin = min(max(0, -high_first[m]), pairs)
            end = max(begin, pairs - begin)
            for q in range(points):
                o = high_first[m] + q
                _axpy(c, o, high_weights[m, q], p, begin, end)
                _axpy(c, m - o, high_weights[m, q], p, begin, end)
            if begin > 0:
                for q in range(2):
                    o = linear_first[m] + q
                    w = linear_weights[m, q]
                    if w != 0.0:
                        _axpy(c, o, w, p, 0, begin)
                        _axpy(c, m - o, w, p, 0, begin)
                        _axpy(c, o, w, p, end, pairs)
                        _axpy(c, m - o, w, p, end, pairs)
            _axpy(c, 0, -1.0, p, 0, pairs)
            _axpy(c, m, -1.0, p, 0, pairs)
    return out
