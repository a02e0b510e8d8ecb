"""Operator (6), follow the leader: C[f] = S f ρ (u - v) (Prigogine and Herman 1971)."""

from __future__ import annotations

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.threads import numba_threads

LARGEST_EXPONENT = 500.0
"""Largest exponent of one piece of a substep. The logarithm of the largest double is 709; f itself needs some of that."""

POINTS_OF_A_THREAD = 200_000
"""For which a thread is worth waiting for, about 1 ms (4 ns each)."""


class FollowLeader:
    """Conserves mass at every x; takes momentum at the rate S ρ²θ (8). The substep is exact in time and positive.

    `velocity`: uniform points (nv,); `cross_section`: S, dimensionless. Tests: tests/invariants/test_collisions.py.
    """

    conserves = ("mass",)

    def __init__(self, velocity: Array, cross_section: float) -> None:
        self.velocity = velocity
        self.cross_section = cross_section
        self.dv = float(velocity[1] - velocity[0])

    def rate(self, f: Array) -> Array:
        density = f.sum(axis=1, keepdims=True) * self.dv
        flux = (f @ self.velocity * self.dv)[:, None]
        return self.cross_section * f * (flux - density * self.velocity)

    def __call__(self, f: Array, dt: float) -> Array:
        """f exp(-Sρ v dt), brought back to the same ρ: the exact solution, since ρ stays as it is."""
        with numba_threads(f.size // POINTS_OF_A_THREAD):
            return _substep(np.ascontiguousarray(f), self.velocity, self.cross_section * dt * self.dv)


@numba.njit(parallel=True, cache=True)
def _substep(f: Array, v: Array, s: float) -> Array:
    nx, nv = f.shape
    out = f.copy()
    for i in numba.prange(nx):
        row = out[i]
        total = 0.0
        for j in range(nv):
            total += row[j]
        # One piece, unless exp would overflow; pieces compose exactly.
        pieces = 1 + int(abs(s * total) * (v[-1] - v[0]) / LARGEST_EXPONENT)
        for _ in range(pieces):
            _tilt(row, v, s * total / pieces, total)
    return out


@numba.njit(cache=True)
def _tilt(row: Array, v: Array, a: float, total: float) -> None:
    """row ∝ row exp(-a v), with the same sum."""
    if total == 0.0:
        return
    flux = 0.0
    for j in range(v.size):
        flux += row[j] * v[j]
    mean = flux / total  # about the mean velocity the exponent is small where f is large
    new = 0.0
    for j in range(v.size):
        row[j] *= np.exp(-a * (v[j] - mean))
        new += row[j]
    scale = total / new
    for j in range(v.size):
        row[j] *= scale
