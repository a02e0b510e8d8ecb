"""Collision laws of pairs on velocity points, by quadrature of their weak form (docs/theory.md).

∫φ C = S ∫∫_{v > v'} f f' r [φ(v' + a(r)) + φ(v' + b(r)) - φ(v) - φ(v')], r = v - v', where a and b say where a pair goes. On a
uniform grid r = m dv, so that the places depend on m alone: a sum over m of contiguous vector operations.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.laws import PairLaw
from kinetic_solver.laws.law import outcomes
from kinetic_solver.threads import numba_threads

POINTS = {"linear": 2, "cubic": 4, "quintic": 6}
"""Of each deposit's stencil: the order of its error in dv."""

MOST_TABLES = 16
"""That are kept, of nv rows each: a run looks at a handful of grids again and again (4, asked for 556 times, in
scenes/relaxation.toml)."""

WORK_OF_A_THREAD = 1_000_000
"""nx·nv² of a rate for which a thread is worth waiting for, about 1 ms (1 to 2 ns each, quintic). Two threads took 8 to 20 ms for
rates of 0.1 to 0.9 ms where others used both cores as well."""

UNCHANGED = 1e-15
"""Of r: a pair that moves by less stays as it is."""


class PairCollisions:
    """C[f] of a pair law on uniform velocity points: pairs m·dv apart deposit their products at places that depend on m alone.

    `deposit` is the Lagrange stencil of the products: "linear" (2 points, positive, error O(dv²)), "cubic" (4, O(dv⁴)) or
    "quintic" (6, O(dv⁶), with the Euler-Maclaurin correction for the kink of |v - v'| at 0). All conserve mass, and momentum and
    energy as the law does (energy with four points or more), to round-off. A pair so near the window's edge that its stencil
    would leave the window is deposited linearly, which conserves mass and momentum as well.
    Cost: O(nv²) per x. Tests: tests/invariants/test_collisions.py.
    """

    def __init__(self, velocity: Array, law: PairLaw, deposit: str = "linear") -> None:
        self.velocity, self.law, self.deposit = velocity, law, deposit
        self.conserves = law.conserves
        self.dv = float(velocity[1] - velocity[0])
        kind, numbers = type(law).after, law.numbers
        self._linear, self._high, self.idle = _tables(kind, numbers, velocity.size, self.dv, POINTS[deposit])
        """`idle`: True where no pair changes anything."""
        # Near r = 0 the integrand of a law that keeps momentum is r [a² + b² - r²]/2 f² φ'' + ..., whose sum over r = m dv misses
        # its integral by dv⁴/720 times the third derivative (Euler-Maclaurin): only the quintic deposit is that accurate.
        near = 1e-6 * self.dv
        a, b = (float(place[0]) / near for place in outcomes(kind, numbers, np.array([near])))
        self._kink = (1 - a * a - b * b) / 240 if deposit == "quintic" and "momentum" in law.conserves else 0.0

    def rate(self, f: Array) -> Array:
        if self.idle:
            return np.zeros_like(f)
        scale = self.law.cross_section * self.dv**2
        with numba_threads(f.size * self.velocity.size // WORK_OF_A_THREAD):
            out = _rate(np.ascontiguousarray(f), scale, *self._linear, *self._high)
        if self._kink:
            square = (scale * self._kink) * f[:, 1:-1] ** 2
            out[:, :-2] += square
            out[:, 1:-1] -= 2 * square
            out[:, 2:] += square
        return out

    def on(self, nv: int) -> PairCollisions:
        """The same operator on nv points in the same window."""
        low, width = self.velocity[0] - self.dv / 2, self.dv * self.velocity.size
        return PairCollisions(low + width / nv * (np.arange(nv) + 0.5), self.law, self.deposit)

    def collision_frequency_max(self, f: Array) -> float:
        """The largest S∫f'|v - v'|dv over x and v: it is convex in v, so it lies at an edge of the window."""
        v = self.velocity
        ends = np.stack([np.abs(v - v[0]), np.abs(v - v[-1])], axis=1)
        return float((np.abs(f) @ ends).max() * self.law.cross_section * self.dv)

    def __call__(self, f: Array, dt: float) -> Array:
        """SSPRK(s, 2) (Spiteri and Ruuth 2002): s - 1 Euler stages and a convex combination, second order.

        As many stages as make every Euler stage a positive step (with the linear deposit), whatever dt.
        """
        if self.idle:
            return f
        stages = max(2, 1 + math.ceil(1.01 * dt * self.collision_frequency_max(f)))
        u = f
        for _ in range(stages - 1):
            u = u + dt / (stages - 1) * self.rate(u)
        last = u + dt / (stages - 1) * self.rate(u)
        return f / stages + (stages - 1) / stages * last


Stencils = tuple[NDArray[np.int64], Array, NDArray[np.int64], Array]
"""First indices (nv,), counted from the slower particle, and weights (nv, points), of the one and of the other place."""


@functools.lru_cache(maxsize=MOST_TABLES)
def _tables(
    after: Callable[..., tuple[float, float]], numbers: tuple[float, ...], nv: int, dv: float, points: int
) -> tuple[Stencils, Stencils, bool]:
    """(linear stencils, those of so many points, whether no pair changes anything). They are read only: runs share them."""
    apart = np.arange(nv, dtype=np.int64)
    r = dv * apart[1:].astype(float)
    parts = [place / r for place in outcomes(after, numbers, r)]
    slower, faster = (np.append(0.0, part) * apart.astype(float) for part in parts)
    idle = bool(np.all(parts[0] < UNCHANGED) and np.all(parts[1] > 1 - UNCHANGED))
    return _stencils(slower, faster, apart, 2), _stencils(slower, faster, apart, points), idle


def _stencils(slower: Array, faster: Array, apart: NDArray[np.int64], points: int) -> Stencils:
    """Lagrange stencils around both places for each distance m; the faster one's mirrored, as seen from the faster particle."""
    first, weights = _lagrange(slower, points)
    mirrored_first, mirrored = _lagrange(apart - faster, points)
    return first, weights, apart - mirrored_first - (points - 1), np.ascontiguousarray(mirrored[:, ::-1])


def _lagrange(place: Array, points: int) -> tuple[NDArray[np.int64], Array]:
    first = np.floor(place).astype(np.int64) - (points // 2 - 1)
    s = place - first
    nodes = np.arange(points)
    weights = np.ones((place.size, points))
    for node in nodes:
        for other in nodes:
            if other != node:
                weights[:, node] *= (s - other) / (node - other)
    return first, weights


@numba.njit(parallel=True, cache=True)
def _rate(
    f: Array,
    scale: float,
    linear_slow: NDArray[np.int64],
    linear_slow_weights: Array,
    linear_fast: NDArray[np.int64],
    linear_fast_weights: Array,
    high_slow: NDArray[np.int64],
    high_slow_weights: Array,
    high_fast: NDArray[np.int64],
    high_fast_weights: Array,
) -> Array:
    nx, nv = f.shape
    points = high_slow_weights.shape[1]
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
            slow, fast = high_slow[m], high_fast[m]
            begin = min(max(0, -slow, -fast), pairs)
            end = max(begin, pairs - max(0, slow + pad - m, fast + pad - m))
            if begin > 0 or end < pairs:
                for q in range(2):
                    near, far = linear_slow[m] + q, linear_fast[m] + q
                    w, u = linear_slow_weights[m, q], linear_fast_weights[m, q]
                    if w != 0.0:
                        for j in range(begin):
                            c[near + j] += w * p[j]
                        for j in range(end, pairs):
                            c[near + j] += w * p[j]
                    if u != 0.0:
                        for j in range(begin):
                            c[far + j] += u * p[j]
                        for j in range(end, pairs):
                            c[far + j] += u * p[j]
                p[:begin] = 0.0
                p[end:] = 0.0
            if end > begin:
                reached = end - begin + pad
                source = padded[begin : begin + reached + pad]
                slow += begin
                fast += begin
                _gain(c[slow : slow + reached], source, high_slow_weights[m])
                _gain(c[fast : fast + reached], source, high_fast_weights[m])
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
