"""Collision laws of pairs on velocity points, by quadrature of their weak form (docs/theory_details.md).

∫φ C = S ∫∫_{v > v'} f f' r [φ(v' + a(r)) + φ(v' + b(r)) - φ(v) - φ(v')], r = v - v', where a and b say where a pair goes. On a
uniform grid r = m dv, so that the places depend on m alone: a sum over m of contiguous vector operations.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.laws import PairLaw
from kinetic_solver.laws.law import outcomes

POINTS = {"linear": 2, "cubic": 4, "quintic": 6}
"""Of each deposit's stencil: the order of its error in dv."""

MOST_TABLES = 16
"""That are kept, of nv rows each: a run looks at a handful of grids again and again (4, asked for 556 times, in
scenes/relaxation.toml)."""

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
        # Here, because it loads numba, and looks at its cache: plans of other laws import this module.
        from kinetic_solver.operators.collisions.pair_sums import pair_rates

        out = pair_rates(f, scale, *self._linear, *self._high)
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


Stencils = tuple[NDArray[np.int64], Array]
"""First indices (2, nv), counted from the slower particle, and weights (2, nv, points), of the one and of the other place."""


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
    return np.stack([first, apart - mirrored_first - (points - 1)]), np.stack([weights, mirrored[:, ::-1]])


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
