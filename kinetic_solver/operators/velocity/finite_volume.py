"""Conservative finite volumes for drift and diffusion in v, exact in time: positive and second order in dv, or eighth order."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Model

if TYPE_CHECKING:
    # Loaded where it is used: runs that choose another matrix, most of them, start without it.
    from scipy import sparse

_STAGGERED = (
    (1.0,),
    (9 / 8, -1 / 24),
    (75 / 64, -25 / 384, 3 / 640),
    (1225 / 1024, -245 / 3072, 49 / 5120, -5 / 7168),
)
"""Σ_n c_n (h_{j+n} - h_{j+1-n})/dv = h'_{j+1/2} + O(dv^order), orders 2, 4, 6, 8."""
_REACH = 3.5
"""Distance from a face to the farthest cell centre of the widest difference, in dv."""
_STEEPEST = 9.0
"""The largest log(M_{j+1/2}/M_i) over that distance at which a face keeps the wide difference: its weight is then
exp(9) 5/7168 = 6. Measured: the most negative entries of K are -0.2 to -2 there, -5e1 at 11, -3e5 at 14, -1e9 at 18."""
_MARGIN = 1000
"""Cells outside the window from which Maxwellians are summed, at most. A noise of 1e12 θ would ask for 1e7 of them."""


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

    def __init__(self, grid: PhaseSpaceGrid, model: Model) -> None:
        if model.friction * model.noise == 0:
            # a programming error: the plan chooses no such case
            raise ValueError("finite volumes need friction > 0 and noise > 0; use the kernel")
        self.grid = grid
        self.model = model

    @functools.cached_property
    def _rates(self) -> tuple[Array, Array]:
        """Rates from cell j to j + 1 and to j - 1, σγ/dv² · Mf/M_j; zero through the window's edges."""
        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        m, dv, nv = g / gamma, self.grid.dv, self.grid.nv
        # The sum starts far outside the window, where its first term no longer matters; or, where that is many cells away, from
        # what all cells before the first add up to.
        margin = min(_MARGIN, int(np.ceil(10 * np.sqrt(sigma) / dv)) + 1)
        w = (self.grid.low - m) + dv * (np.arange(-margin, nv + margin) + 0.5)
        # An infinite ratio is one of the limits that the sums below take.
        with np.errstate(over="ignore"):
            step_up = np.exp(-(2 * w + dv) * dv / (2 * sigma))  # M_{j+1}/M_j
        right = np.zeros(w.size)  # Mf_{j+1/2}/M_j, summed from the left for faces below m
        left = np.zeros(w.size)  # Mf_{j-1/2}/M_j, summed from the right for faces above m
        # The sum over all cells before the first, over M_j: M_{j-1/2}/M_j times what _before says.
        value = np.exp((w[0] - dv / 4) * dv / (2 * sigma)) * _before(w[0] - dv / 2, dv, sigma, margin) if w[0] < 0 else 0.0
        for j in range(w.size):
            value = (value / step_up[j - 1] if j and step_up[j - 1] > 0 else value) - w[j] * dv / sigma
            right[j] = value
            if w[j] > 0:
                break
        value = np.exp(-(w[-1] + dv / 4) * dv / (2 * sigma)) * _before(w[-1] + dv / 2, dv, sigma, margin) if w[-1] > 0 else 0.0
        for j in range(w.size - 1, -1, -1):
            value = (value * step_up[j] if j < w.size - 1 else value) + w[j] * dv / sigma
            left[j] = value
            if w[j] < 0:
                break
        below = w + dv / 2 <= 0  # the face to the right of cell j lies below m
        with np.errstate(invalid="ignore"):  # where 0 times infinity is not the branch taken
            up = np.where(below, right, np.append(left[1:], 0.0) * step_up)
        with np.errstate(divide="ignore", invalid="ignore"):
            down = np.where(np.append(True, below[:-1]), np.append(0.0, right[:-1] / step_up[:-1]), left)
        inside = slice(margin, margin + nv)
        scale = sigma * gamma / dv**2
        up, down = scale * up[inside], scale * down[inside]
        up[-1] = down[0] = 0.0
        return up, down

    def generator(self) -> sparse.csr_array:
        """A, with df/dt = A f; its columns sum to 0."""
        from scipy import sparse

        up, down = self._rates
        return sparse.diags_array([up[:-1], -(up + down), down[1:]], offsets=[-1, 0, 1], format="csr")

    def matrix(self, h: float) -> Array:
        from scipy import sparse

        generator = self.generator()
        shift = float(-generator.diagonal().min())
        squarings = max(0, int(np.ceil(np.log2(max(shift * h, 1.0)))))
        tau = h / 2**squarings
        # exp(τA) = exp(-τ shift) exp(τ(A + shift)): where the rates are positive A + shift is too, and the series only adds.
        shifted = generator + shift * sparse.eye_array(self.grid.nv, format="csr")
        term = np.eye(self.grid.nv)
        kernel = term.copy()
        for n in range(1, 22):  # the remainder is below (τ shift)^22/22! <= 1e-21 (eighth order: measured, below round-off)
            term = (shifted @ term) * (tau / n)
            kernel += term
        kernel /= kernel.sum(axis=0)
        for _ in range(squarings):
            kernel = kernel @ kernel
            kernel /= kernel.sum(axis=0)
        return kernel


def _before(face: float, dv: float, sigma: float, margin: int) -> float:
    """Σ_i |v_i - m| M_i dv/σ over all cells beyond a face, over M there: by Euler and Maclaurin's formula, in powers of dv/√σ.

    1, to which the sum's first term does not matter, unless it begins nearer than that. What the formula leaves out is
    (dv y/√σ)^6/31000 for a face y√σ from the mean: where dv y/√σ is not small, the cells of the margin outweigh it.
    """
    a, y = dv / np.sqrt(sigma), face / np.sqrt(sigma)
    if margin < _MARGIN or abs(a * y) > 0.1:
        return 1.0
    return float(1 - a**2 / 24 * (y**2 - 1) + 7 / 5760 * a**4 * (y**4 - 6 * y**2 + 3))


class HighOrderFiniteVolume(FiniteVolume):
    """Eighth order in dv: A = -Dᵀ (σγ M_{j+1/2}) D (1/M), D the staggered difference of order 8 from centres to faces.

    Every row of D annihilates constants, hence every column of A sums to 0 (mass) and A M = 0 (equilibrium), both to
    round-off, whatever the rows are. A is self-adjoint and negative semi-definite in Σ f g/M: exp(hA) is stable at any h. Next to
    the window's edges D uses the points there are, down to order 2 at the last face; no flux crosses the edges.
    Differences are taken of f/M, so the error is relative to f far into its tails.

    NOT positive: K has entries down to -0.2 (-2 where M is steep), what dv resolves hardly undershoots (a Gaussian of standard
    deviation 2.6 dv by 1e-13 of its maximum, of 4.5 dv by 3e-33). M_{j+1/2} is the Maxwellian itself, so dp/dt = gN - γp
    holds up to the scheme's error, not to round-off: face values that make it exact (FiniteVolume's sums, D inverted) were
    measured to double the error and to cost one to two digits in the tails. Faces where M is too steep for a wide
    difference, (|v - m| + 1.75 dv) dv > 2.6 σ, take FiniteVolume's positive flux: nothing is accurate there either way, but
    K's entries stay moderate, even where M underflows.

    Max error/max f of a Gaussian 2√σ off the mean, of variance 1.5 σ, after γh = 0.35, against orders 2, 4 and 6 built alike:

        dv/√σ   0.344    0.229    0.172    0.115    0.086
        2       6.3e-3   2.8e-3   1.6e-3   7.2e-4   4.1e-4   (FiniteVolume)
        4       4.7e-4   9.2e-5   2.9e-5   5.7e-6   1.8e-6
        6       5.5e-5   4.6e-6   8.0e-7   6.9e-8   1.2e-8
        8       1.0e-5   3.5e-7   3.4e-8   1.3e-9   1.3e-10

    Needs γσ > 0. Order, exact solutions, relative accuracy in the tail: tests/convergence/test_velocity.py; invariants,
    stability, signs: tests/invariants/test_velocity.py.
    """

    def generator(self) -> sparse.csr_array:
        """A, with df/dt = A f; its columns sum to 0."""
        from scipy import sparse

        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        dv, nv = self.grid.dv, self.grid.nv
        centre, face = self.grid.v - g / gamma, self.grid.faces[1:-1] - g / gamma
        faces = np.arange(nv - 1)
        # Pairs of centres that a face's difference uses: half its order.
        pairs = np.minimum(len(_STAGGERED), np.minimum(faces + 1, nv - 1 - faces))
        pairs[_REACH * dv * (2 * np.abs(face) + _REACH * dv) > 2 * sigma * _STEEPEST] = 1
        up, down = self._rates
        difference = np.zeros((nv - 1, nv))
        for n, coefficients in enumerate(_STAGGERED, start=1):
            rows = faces[pairs == n]
            for i, c in enumerate(coefficients):
                difference[rows, rows + 1 + i] = c
                difference[rows, rows - i] = -c
        row, column = np.nonzero(difference)
        values = difference[row, column]
        # Only ratios M_{j+1/2}/M_i enter, formed in the exponent: M itself may underflow in the window.
        second_order = pairs[row] == 1
        exponent = (centre[column] - face[row]) * (centre[column] + face[row]) / (2 * sigma)
        ratio = np.exp(np.where(second_order, 0.0, exponent))
        inward = np.where(
            second_order,
            np.where(column > row, down[column], -up[column]),
            sigma * gamma / dv**2 * values * ratio,
        )
        shape = difference.shape
        return sparse.csr_array(-(sparse.csr_array(difference).T @ sparse.csr_array((inward, (row, column)), shape=shape)))
