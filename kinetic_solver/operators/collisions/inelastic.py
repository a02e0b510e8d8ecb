"""Operator (12), inelastic collisions, by quadrature of its weak form (docs/theory.md)."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array

POINTS = {"linear": 2, "cubic": 4, "quintic": 6}
"""Deposit → points of its Lagrange stencil, which is the order of its error in dv."""


class Inelastic:
    """C[f] on a uniform velocity grid: pairs at distance m·dv deposit their products at places that depend on m alone.

    `deposit` is the Lagrange stencil of the products: "linear" (2 points, positive, error O(dv²)), "cubic" (4, O(dv⁴)) or
    "quintic" (6, O(dv⁶), with the Euler-Maclaurin correction for the kink of |v - v'| at 0). All conserve mass and momentum
    to round-off; ε = 1 gives exactly zero. A pair so near the window's edge that its stencil would leave the window is
    deposited linearly, which conserves as well.
    Cost: O(nv²) per x. Tests: tests/invariants/test_collisions.py.
    """

    conserves = ("mass", "momentum")

    def __init__(self, velocity: Array, cross_section: float, restitution: float, deposit: str = "linear") -> None:
        self.velocity = velocity
        self.cross_section = cross_section
        self.restitution = restitution
        self.deposit = deposit
        self.dv = float(velocity[1] - velocity[0])
        self._linear_first, self._linear_weights = _stencils(velocity.size, restitution, 2)
        self._first, self._weights = _stencils(velocity.size, restitution, POINTS[deposit])
        self._mirrored = np.ascontiguousarray(self._weights[:, ::-1])
        # Near r = 0 the weak form's integrand is -α(1-α) r³ f² φ" + ..., whose sum over r = m dv misses the integral by dv⁴/720
        # times its third derivative (Euler-Maclaurin). Only the quintic deposit is accurate enough to notice.
        alpha = (1 - restitution) / 2
        self._kink = alpha * (1 - alpha) / 120 if deposit == "quintic" else 0.0

    def rate(self, f: Array) -> Array:
        if self.restitution == 1:
            return np.zeros_like(f)
        scale = self.cross_section * self.dv**2
        out = _rate(
            np.ascontiguousarray(f), scale, self._linear_first, self._linear_weights, self._first, self._weights, self._mirrored
        )
        if self._kink:
            square = (scale * self._kink) * f[:, 1:-1] ** 2
            out[:, :-2] += square
            out[:, 1:-1] -= 2 * square
            out[:, 2:] += square
        return out

    def on(self, nv: int) -> Inelastic:
        """The same operator on nv points in the same window."""
        low, width = self.velocity[0] - self.dv / 2, self.dv * self.velocity.size
        return Inelastic(low + width / nv * (np.arange(nv) + 0.5), self.cross_section, self.restitution, self.deposit)

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
        stages = max(2, 1 + math.ceil(1.01 * dt * self.collision_frequency_max(f)))
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


@numba.njit(parallel=True, cache=True)
def _rate(
    f: Array,
    scale: float,
    linear_first: NDArray[np.int64],
    linear_weights: Array,
    high_first: NDArray[np.int64],
    high_weights: Array,
    mirrored_weights: Array,
) -> Array:
    nx, nv = f.shape
    points = high_weights.shape[1]
    pad = points - 1
    out = np.empty_like(f)
    for i in numba.prange(nx):
        row = f[i]
        c = out[i]
        _loss(c, row, scale)
        padded = np.zeros(nv + 2 * pad)
        for m in range(1, nv):
            pairs = nv - m
            p = padded[pad : pad + pairs]
            _pair_rates(p, row[:pairs], row[m:], scale * m)
            padded[pad + pairs : pad + pairs + pad] = 0.0
            # [begin, end): pairs whose stencils, which may overhang the pair on either side, stay inside the window
            first = high_first[m]
            begin = min(max(0, -first, first + pad - m), pairs)
            end = max(begin, pairs - begin)
            if begin > 0:
                for q in range(2):
                    o = linear_first[m] + q
                    w = linear_weights[m, q]
                    if w != 0.0:
                        for j in range(begin):
                            c[o + j] += w * p[j]
                            c[m - o + j] += w * p[j]
                        for j in range(end, pairs):
                            c[o + j] += w * p[j]
                            c[m - o + j] += w * p[j]
                p[:begin] = 0.0
                p[end:] = 0.0
            if end > begin:
                reached = end - begin + pad
                source = padded[begin : begin + reached + pad]
                slow = first + begin
                fast = m - first - pad + begin
                _gain(c[slow : slow + reached], source, high_weights[m])
                _gain(c[fast : fast + reached], source, mirrored_weights[m])
    return out


# The three loops below take slices, not offsets: so the compiler knows that no index is negative, and vectorises them.


@numba.njit(cache=True)
def _loss(c: Array, f: Array, scale: float) -> None:
    """c = -scale f_k Σ_j f_j |k - j|, by running sums."""
    total = 0.0
    distance = 0.0
    for k in range(f.size):
        c[k] = distance
        total += f[k]
        distance += total
    total = 0.0
    distance = 0.0
    for k in range(f.size - 1, -1, -1):
        c[k] = -scale * f[k] * (c[k] + distance)
        total += f[k]
        distance += total


@numba.njit(cache=True)
def _pair_rates(p: Array, slower: Array, faster: Array, scale: float) -> None:
    for j in range(p.size):
        p[j] = scale * slower[j] * faster[j]


@numba.njit(cache=True)
def _gain(c: Array, p: Array, w: Array) -> None:
    """c_k += Σ_q w_q p_{k - q}, p padded with zeros."""
    if w.size == 2:
        w0, w1 = w[0], w[1]
        for k in range(c.size):
            c[k] += w0 * p[k + 1] + w1 * p[k]
    elif w.size == 4:
        w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
        for k in range(c.size):
            c[k] += (w0 * p[k + 3] + w1 * p[k + 2]) + (w2 * p[k + 1] + w3 * p[k])
    else:
        w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
        for k in range(c.size):
            c[k] += (w0 * p[k + 5] + w1 * p[k + 4]) + (w2 * p[k + 3] + w3 * p[k + 2]) + (w4 * p[k + 1] + w5 * p[k])
