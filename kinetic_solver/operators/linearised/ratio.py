"""η = E'/E of a transport in the local gauge: the periodic solution of η_x + Sρη = Sn, in O(nx log nx) time and O(nx) memory.

For the periodic functions that the points stand for the solution is an integral along x,

    η(x) = S∫_{-∞}^x n(y) exp(-S[Φ(x) - Φ(y)]) dy,    Φ_x = ρ,

which is done cell by cell: Gauss-Legendre nodes within a cell, on which Fourier series give n and the differences of Φ, and
η_i = q_i η_{i-1} + g_i from cell to cell, q_i = exp(-S·difference of Φ). Nothing cancels: η is accurate where it is small.

The nx × nx system with the matrix of the spectral derivative is another discretisation, which agrees where x is resolved. It
costs nx³, and its round-off is relative to the largest η.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import derivative
from kinetic_solver.operators.tables import Tables

TABLES = 4
"""Numbers of nodes whose tables are kept; densities that follow one another need the same number, or nearly."""
THICKEST_CELL = 1e4
"""The largest Sρ dx, the number of mean free paths in a cell, that is stepped; it takes 312 nodes a cell."""


def node_count(thickness: float) -> int:
    """Nodes a cell for a round-off error in exp(-thickness·y/dx) times any wave on the grid; thickness = Sρ dx."""
    return 12 + math.ceil(3 * math.sqrt(max(thickness, 0.0)))


class GaugeRatio:
    """(ρ, n) → η, shapes (nx,), where x is resolved with an error of a few (1 + S·range of Φ)·1e-16 of η(x) itself, at each x.

    So however small η is in places, and also where ρ nearly vanishes. Test: tests/exact/test_gauge_ratio.py.
    Raises LostAccuracy where n or η is not positive, or not a number. Takes up to seven numbers per point and node.
    """

    def __init__(self, grid: PhaseSpaceGrid, cross_section: float) -> None:
        self.grid = grid
        self.cross_section = cross_section
        self._tables = Tables[_Nodes](TABLES)

    def __call__(self, density: Array, n: Array) -> Array:
        thickness = self.cross_section * float(density.max()) * self.grid.dx
        _check(n.min() > 0 and bool(np.isfinite(n).all()) and thickness < THICKEST_CELL)
        # As many as this density needs, whatever came before: a run that was resumed has the bits of one that went through.
        nodes = self._tables.get(node_count(thickness), lambda count: _nodes(self.grid, int(count)))
        # From below, so that nothing cancels: where η is least, it is n/ρ.
        eta = np.full_like(n, np.divide(n, density, where=density > 0, out=np.full_like(n, np.inf)).min())
        # With η = e(1 + δ), δ_x + Sρ'δ = S(n/e - ρ'), ρ' = ρ + (log e)_x/S, for any smooth e. A Fourier series of n has a
        # round-off relative to the largest n. That of the first pass, where e is constant, is what the second removes: n/e is
        # then nearly the new density, better resolved than n, and δ is small.
        for _ in range(2):
            e, moved = self._smooth(eta, density)
            eta = e * (1 + self._decaying(moved, n / e - moved, nodes))
            _check(eta.min() > 0)
        return eta

    def _smooth(self, eta: Array, density: Array) -> tuple[Array, Array]:
        """(e, ρ'), where e is η without the upper half of log η's waves: so the points resolve products with it."""
        spectrum = np.fft.rfft(np.log(eta))
        spectrum[(spectrum.size + 1) // 2 :] = 0.0
        log_e = np.fft.irfft(spectrum, n=self.grid.nx)
        return np.exp(log_e), density + derivative(log_e, self.grid.wavenumbers) / self.cross_section

    def _decaying(self, density: Array, source: Array, nodes: _Nodes) -> Array:
        """The periodic solution y of y_x + Sρy = S·source."""
        s, nx = self.cross_section, self.grid.nx
        rho = np.fft.rfft(density)
        weight = np.exp(-s * np.fft.irfft(rho * nodes.ahead, n=nx))
        gain = (s * nodes.weights @ (weight * np.fft.irfft(np.fft.rfft(source) * nodes.back, n=nx))).tolist()
        factor = np.exp(-s * np.fft.irfft(rho * nodes.cell, n=nx)).tolist()
        y = 0.0
        for q, g in zip(factor, gain, strict=True):
            y = q * y + g
        # Once around from 0 gave y; periodic is what comes back as itself.
        y /= -math.expm1(-s * float(density.mean()) * self.grid.length)
        result = []
        for q, g in zip(factor, gain, strict=True):
            y = q * y + g
            result.append(y)
        return np.array(result)


def _check(condition: bool) -> None:
    if not condition:
        raise LostAccuracy("the exactly linearised step of follow-the-leader collisions lost its accuracy")


@dataclass(frozen=True)
class _Nodes:
    """Of the cell that ends at x_i, for all i alike. Factors multiply a real spectrum over x; (count, nx//2 + 1)."""

    weights: Array
    """(count,)."""
    back: NDArray[np.complex128]
    """To values at the nodes x_i - r."""
    ahead: NDArray[np.complex128]
    """From ρ to Φ(x_i) - Φ(x_i - r): no difference of large numbers."""
    cell: NDArray[np.complex128]
    """From ρ to Φ(x_i) - Φ(x_i - dx); (nx//2 + 1,)."""


@functools.lru_cache(maxsize=64)
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights on [-1, 1]: the eigenvalues of a matrix, and the same in every run. They are read only."""
    return np.polynomial.legendre.leggauss(count)


def _nodes(grid: PhaseSpaceGrid, count: int) -> _Nodes:
    points, weights = _gauss_legendre(count)
    distance = np.append(grid.dx * (1 - points) / 2, grid.dx)
    phase = np.outer(distance, grid.wavenumbers)
    # [1 - exp(-ikr)]/ik, without the difference
    ahead = np.exp(-0.5j * phase) * np.sinc(phase / (2 * np.pi)) * distance[:, None]
    return _Nodes(grid.dx / 2 * weights, np.exp(-1j * phase[:-1]), ahead[:-1], ahead[-1])
