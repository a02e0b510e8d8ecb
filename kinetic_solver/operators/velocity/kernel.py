"""The exact Ornstein-Uhlenbeck transition between velocity points: exact in time, spectrally accurate in v."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.velocity.protocol import DriftDiffusion
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

RESOLVED = 1.4
"""The kernel's width s in units of dv from which the trapezoidal rule integrates it to round-off: 2 exp(-2π² 1.4²) = 3e-17."""


def resolution(rtol: float) -> float:
    """As RESOLVED, for a relative error of rtol/1000 in a step."""
    return float(np.sqrt(np.log(2e3 / rtol) / 2)) / np.pi


def resolved_spacing(model: Model, h: float, resolution: float = RESOLVED) -> float:
    """The largest dv at which the Gaussian kernel of a step h is integrated to the accuracy of `resolution` (0 without noise)."""
    return math.sqrt(-model.noise * math.expm1(-2 * model.friction * h)) / resolution  # as `transition` has it


def _erfc(x: Array) -> Array:
    """Of the standard library: SciPy's would be all that most runs load SciPy for, in a tenth of their start-up."""
    return np.array([math.erfc(value) for value in x.tolist()])


class OrnsteinUhlenbeckKernel:
    """K_ij = dv N(v_i; m + (v_j - m)e, s²), the transition density of (1) at the velocity points.

    Where dv resolves its width (`resolved_spacing`) the matrix is positive and accurate RELATIVE to f in the tails
    (docs/theory_details.md: the follow-the-leader operator needs that). What would leave the window stays in its cell, as in
    Metropolis's rule: every column sums to 1 and detailed balance with the Maxwellian of variance σ is exact, so mass is
    conserved and the equilibrium is stationary to round-off, the window's edges included.

    Where it does not (short steps, no noise), `unresolved` takes its place, by default the kernel's band-limited form: exact for
    every f that the grid resolves, mass conserved to round-off, but not positive and not accurate relative to f in the tails.
    Tests: tests/invariants/test_velocity.py, tests/convergence/test_velocity.py.
    """

    def __init__(
        self, grid: PhaseSpaceGrid, model: Model, unresolved: DriftDiffusion | None = None, resolution: float = RESOLVED
    ) -> None:
        self.grid = grid
        self.model = model
        self.unresolved = unresolved
        self.resolution = resolution

    def positive(self, h: float) -> bool:
        """True where the step h is long enough for the positive form."""
        return self.grid.dv <= resolved_spacing(self.model, h, self.resolution)

    def matrix(self, h: float) -> Array:
        if self.model.friction == 0 and self.model.gravity == 0:
            return np.eye(self.grid.nv)  # exactly: no rounding that operator (6) could amplify
        step = transition(self.model, h)
        arrival = step.velocity_shift + self.grid.v * step.decay
        if not self.positive(h):
            if self.unresolved is not None:
                return self.unresolved.matrix(h)
            return with_unit_columns(self._band_limited(arrival, step.velocity_variance))
        distance = self.grid.v[:, None] - arrival[None, :]
        kernel = np.exp(-(distance**2) / (2 * step.velocity_variance))
        kernel *= self.grid.dv / np.sqrt(2 * np.pi * step.velocity_variance)
        # What would leave the window stays where it is (a rejected move): local, positive, reversible.
        spread = np.sqrt(2 * step.velocity_variance)
        leaving = _erfc((arrival - self.grid.low) / spread) / 2 + _erfc((self.grid.high - arrival) / spread) / 2
        kernel[np.diag_indices_from(kernel)] += leaving
        return with_unit_columns(kernel)

    def _band_limited(self, arrival: Array, variance: float) -> Array:
        nv, period = self.grid.nv, self.grid.high - self.grid.low
        q = 2 * np.pi / period * np.arange(nv // 2 + 1)
        weight = np.exp(-(q**2) * variance / 2)
        weight[1 : (nv + 1) // 2] *= 2  # ±q; a Nyquist mode (even nv) counts once, as a cosine
        inward = np.exp(-1j * np.outer(q, arrival)) * (weight / nv)[:, None]
        return (np.exp(1j * np.outer(self.grid.v, q)) @ inward).real


def with_unit_columns(kernel: Array) -> Array:
    """Columns divided by their sums, and what rounding leaves of 1 given to a small entry, whose last bit weighs little: a state
    that no longer changes repeats the same rounding in every step, and 10⁴ of them add up. No entry changes by more than a few
    ε of itself: 1e-16 put where nothing arrives, as on the diagonal far out, would be amplified by operator (6) without bound.
    """
    kernel /= kernel.sum(axis=0)
    columns = np.arange(kernel.shape[0])
    size = np.abs(kernel)
    small = np.where(size > 1e-2, size, np.inf).argmin(axis=0)
    kernel[small, columns] += (1 - kernel.sum(axis=0, dtype=np.longdouble)).astype(float)
    return kernel
