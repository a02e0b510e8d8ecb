"""Conservative finite volumes for drift and diffusion in v: positive at any step, second order in dv, exact in time."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Model


class FiniteVolume:
    """df_j/dt = -(J_{j+1/2} - J_{j-1/2})/dv with J_{j+1/2} = -(σγ/dv) Mf_{j+1/2} (f_{j+1}/M_{j+1} - f_j/M_j).

    M is the Maxwellian of mean m = g/γ and variance σ at the cell centres, so it is stationary to round-off. Its face values
    are not interpolated but summed, Mf_{j+1/2} = Σ_{i ≤ j} (m - v_i) M_i dv/σ: then the flux's own moment gives
    dp/dt = gN - γp exactly, at any dv. Mf is positive, hence the rates between neighbours are too, and so is
    K(h) = exp(hA), which is built from positive terms alone (every entry is accurate relative to itself). Where
    |v - m| dv >> σ the scheme turns into first-order upwinding. No flux crosses the window's edges: mass is conserved.

    Needs γσ > 0. Error O(dv²), both sides measured in tests/convergence/test_velocity.py; invariants in
    tests/invariants/test_velocity.py.
    """

    name = "finite-volume"

    def __init__(self, grid: PhaseSpaceGrid, model: Model) -> None:
        if model.friction * model.noise == 0:
            raise ValueError("finite volumes need friction > 0 and noise > 0; use the kernel")
        self.grid = grid
        self.model = model
        self._up, self._down = self._rates()

    def _rates(self) -> tuple[Array, Array]:
        """Rates from cell j to j + 1 and to j - 1, σγ/dv² · Mf/M_j; zero through the window's edges."""
        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        m, dv, nv = g / gamma, self.grid.dv, self.grid.nv
        # The sum starts far outside the window, where its first term no longer matters.
        margin = int(np.ceil(10 * np.sqrt(sigma) / dv)) + 1
        w = (self.grid.low - m) + dv * (np.arange(-margin, nv + margin) + 0.5)
        step_up = np.exp(-(2 * w + dv) * dv / (2 * sigma))  # M_{j+1}/M_j
        right = np.empty(w.size)  # Mf_{j+1/2}/M_j, summed from the left for faces below m
        left = np.empty(w.size)  # Mf_{j-1/2}/M_j, summed from the right for faces above m
        value = np.exp(-w[0] * dv / (2 * sigma)) if w[0] < 0 else 0.0
        for j in range(w.size):
            value = (value / step_up[j - 1] if j and step_up[j - 1] > 0 else value) - w[j] * dv / sigma
            right[j] = value
            if w[j] > 0:
                break
        value = np.exp(w[-1] * dv / (2 * sigma)) if w[-1] > 0 else 0.0
        for j in range(w.size - 1, -1, -1):
            value = (value * step_up[j] if j < w.size - 1 else value) + w[j] * dv / sigma
            left[j] = value
            if w[j] < 0:
                break
        below = w + dv / 2 <= 0  # the face to the right of cell j lies below m
        up = np.where(below, right, np.append(left[1:], 0.0) * step_up)
        down = np.where(np.append(True, below[:-1]), np.append(0.0, right[:-1] / step_up[:-1]), left)
        inside = slice(margin, margin + nv)
        scale = sigma * gamma / dv**2
        up, down = scale * up[inside], scale * down[inside]
        up[-1] = down[0] = 0.0
        return up, down

    def generator(self) -> sparse.csr_array:
        """A, with df/dt = A f; its columns sum to 0."""
        return sparse.diags_array([self._up[:-1], -(self._up + self._down), self._down[1:]], offsets=[-1, 0, 1], format="csr")

    def matrix(self, h: float) -> Array:
        outflow = self._up + self._down
        shift = float(outflow.max())
        squarings = max(0, int(np.ceil(np.log2(max(shift * h, 1.0)))))
        tau = h / 2**squarings
        # exp(τA) = exp(-τ shift) exp(τ(A + shift)): A + shift has no negative entry, so the series only adds.
        positive = sparse.diags_array([self._up[:-1], shift - outflow, self._down[1:]], offsets=[-1, 0, 1], format="csr")
        term = np.eye(self.grid.nv)
        kernel = term.copy()
        for n in range(1, 22):  # the remainder is below (τ shift)^22/22! <= 1e-21
            term = (positive @ term) * (tau / n)
            kernel += term
        kernel /= kernel.sum(axis=0)
        for _ in range(squarings):
            kernel = kernel @ kernel
            kernel /= kernel.sum(axis=0)
        return kernel
