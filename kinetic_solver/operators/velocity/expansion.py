"""The negative friction of a frame that follows a cooling gas (plan/moving_frame.py), between velocity points."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.velocity.kernel import with_unit_columns


class Expansion:
    """Solves ∂f/∂t + κ ∂(vf)/∂v = 0: f(v) → f(v e^(-κh)) e^(-κh), exact for what the points resolve.

    Mass is conserved to round-off. So is momentum where f depends on x: it grows as the velocities do. Where it does not, the
    mean velocity in this frame is 0, and is kept there: that of rounding errors would grow without bound. What leaves the window
    comes back at the other edge. Tests: tests/invariants/test_velocity.py, tests/exact/test_cooling.py.
    """

    def __init__(self, grid: PhaseSpaceGrid, rate: float, variance: float) -> None:
        """`rate` is κ; a Gaussian of the `variance` is what a mean of rounding errors is taken out by."""
        self.grid, self.rate = grid, rate
        weight = np.exp(-(grid.v**2) / (2 * variance))
        odd = weight * (grid.v - (weight @ grid.v) / weight.sum())
        self._tilt = odd / (grid.v @ odd)
        self._q = 2 * np.pi / (grid.high - grid.low) * np.arange(grid.nv // 2 + 1)
        self._to_points = np.exp(1j * np.outer(grid.v, self._q))

    def matrix(self, h: float) -> Array:
        grid, factor = self.grid, math.exp(self.rate * h)
        nv, q = grid.nv, self._q
        weight = np.full(q.size, 2.0 / nv)
        weight[0] = 1 / nv
        if nv % 2 == 0:
            weight[-1] = 1 / nv
        # Waves come from shorter ones, and the shortest from beyond the spectrum's end, where there are none.
        weight[q * factor > q[-1]] = 0.0
        kernel = (self._to_points * weight @ np.exp(-1j * factor * np.outer(q, grid.v))).real
        kernel = with_unit_columns(kernel)
        wanted = factor * grid.v if grid.nx > 1 else 0.0
        return np.asarray(kernel - np.outer(self._tilt, grid.v @ kernel - wanted))
