"""(2) with operator (6), stepped exactly over any time from any state: linear after a Cole-Hopf transformation
(docs/theory_details.md).

With Φ_x = ρ, Φ_t = -j the function F = f exp(SΦ) obeys (2) without collisions, and E = exp(SΦ) obeys E_x = S∫F dv. On the
period L, E = exp(Rx) W with R = Sρ̄ and W periodic. So F = f W (its periodic part, from here on) evolves independently in each
Fourier mode, by a matrix known in closed form (operators/velocity/hermite.py), and it holds W, whose modes are
S n_k/(R + ik), n = ∫F dv. f = F/W.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.grid import wavenumbers
from kinetic_solver.operators.fourier import RealTransform
from kinetic_solver.operators.linearised.grid import ROUND_OFF, TABLES
from kinetic_solver.operators.linearised.moments import MOMENTS
from kinetic_solver.operators.tables import Tables
from kinetic_solver.operators.velocity.hermite import HermiteBasis, propagators
from kinetic_solver.scene import Model


class HermiteLinearisedStep:
    """Step a → a(t + h), Hermite coefficients of shape (nx, count): no splitting, no time-step error, any cross-section S ≥ 0.

    Equal to `lower(propagate(lift(a), h))`; for many times one `lift` is enough. Spectrally accurate in x and v, and in x it is F
    and W that the points must resolve, not f: these are entire functions of x where f has poles. The state's mean density must be
    `mean_density`; the result's is, to round-off: that of n/W misses it by aliasing, and f is scaled by what is missing.

    A Fourier transform's error is relative to the largest W on the pipe, so f has a relative error of order `round_off`,
    2.2e-16 exp(`gauge_range`), where W is smallest: 3e-7 at a range of 21. Near 36 nothing is left and W comes out negative:
    raises LostAccuracy, as it does where `round_off` exceeds `tolerance`. Choose nx odd. An even one works where its Nyquist
    cosine is negligible: that has no derivative on the grid, so W's equation takes the real k for ik there, and its propagator is
    the real part.
    Tables are kept for the last few values of h. Tests: tests/exact/test_linearised_hermite.py.
    """

    density_defect: float
    """The largest so far, at `lift` and `lower`, of n's last two Fourier modes over ρ̄ min W: the error of the resolution in x,
    relative to ρ, is of that order after short steps and much smaller after one long step, which damps what was not resolved."""
    gauge_range: float
    """The largest range over x of ln W so far; it is S times the range of Φ's periodic part."""

    def __init__(
        self,
        grid_length: float,
        nx: int,
        basis: HermiteBasis,
        model: Model,
        cross_section: float,
        mean_density: float,
        tolerance: float = math.inf,
    ) -> None:
        self.basis = basis
        self.model = model
        self.cross_section = cross_section
        self.mean_density = mean_density
        self.tolerance = tolerance
        self.density_defect = 0.0
        self.gauge_range = 0.0
        self._nx = nx
        self._wavenumbers = wavenumbers(nx, grid_length)
        self._bloch = cross_section * mean_density
        derivative = 1j * self._wavenumbers
        if nx % 2 == 0:
            derivative[-1] = self._wavenumbers[-1]  # not 0: W would be free to hold any amount of that mode
        self._gauge_modes = np.zeros(derivative.size, dtype=np.complex128)  # of W - 1 from those of n; W has mean 1
        if cross_section > 0:
            self._gauge_modes[1:] = cross_section / (self._bloch + derivative[1:])
        # (∂_x + R) W + μ = SρW, mean of W = 1, but for the diagonal's Sρ; μ = 0 up to aliasing
        self._gauge_equation = np.ones((nx + 1, nx + 1))
        self._gauge_equation[:nx, :nx] = np.fft.irfft(derivative[:, None] * np.fft.rfft(np.eye(nx), axis=0), n=nx, axis=0)
        self._gauge_equation[nx, :nx] = 1 / nx
        self._gauge_equation[nx, nx] = 0.0
        self._transform = RealTransform(nx, basis.count)
        self._tables = Tables[NDArray[np.complex128]](TABLES)

    @property
    def round_off(self) -> float:
        """The relative round-off of f to expect where W is smallest."""
        return ROUND_OFF * math.exp(self.gauge_range)

    def __call__(self, a: Array, h: float) -> Array:
        return self.lower(self.propagate(self.lift(a), h))

    def lift(self, a: Array) -> NDArray[np.complex128]:
        """The Fourier modes along x of F, shape (nx//2 + 1, count).

        W solves its equation on the grid, a linear system of size nx. It is not taken as exp(S∫ρ dx), which differs by aliasing:
        this way `lift` undoes `lower` to round-off even where the points do not resolve ρ. With the exponential that difference
        grew by a factor of 5 to 30 at every call.
        """
        equation = self._gauge_equation.copy()
        diagonal = np.arange(self._nx)
        equation[diagonal, diagonal] += self._bloch - self.cross_section * a[:, 0]
        unit = np.zeros(self._nx + 1)
        unit[-1] = 1.0
        gauge = np.linalg.solve(equation, unit)[:-1]
        spectrum = self._transform.forward(a * gauge[:, None]).copy()
        self._note(spectrum, gauge)
        return spectrum

    def propagate(self, spectrum: NDArray[np.complex128], h: float) -> NDArray[np.complex128]:
        """F after h, scaled so that W keeps mean 1."""
        matrices = self._tables.get(h, self._table)
        kept = matrices.shape[0]
        later = np.zeros_like(spectrum)
        later[:kept] = np.matmul(matrices, spectrum[:kept, :, None])[:, :, 0]
        later *= self._nx * self.mean_density / later[0, 0].real
        return later

    def lower(self, spectrum: NDArray[np.complex128], blur: float = 0.0) -> Array:
        """The coefficients of f."""
        gauge = 1 + np.fft.irfft(spectrum[:, 0] * self._gauge_modes, n=self._nx)
        self._note(spectrum, gauge)
        self._transform.spectrum[:] = spectrum
        a = self._transform.inverse() / gauge[:, None]
        a *= self.mean_density / a[:, 0].mean()
        return a

    def moments(self, spectrum: NDArray[np.complex128], times: Sequence[float], blurs: Sequence[float]) -> Array | None:
        """∫v^n f dv, n = 0 … 3, after each time, shape (times, 4, nx): of the propagators four rows are enough.

        Not blurred, as by `lower`. None where W comes out negative.
        """
        found = [self._moments_after(spectrum, h) for h in times]
        there = [moments for moments in found if moments is not None]
        return np.stack(there) if len(there) == len(found) else None

    def _moments_after(self, spectrum: NDArray[np.complex128], h: float) -> Array | None:
        rows = propagators(self.basis, self._wavenumbers, self._bloch, self.model, h, MOMENTS)
        if self._nx % 2 == 0:
            rows[-1] = rows[-1].real
        later = np.matmul(rows, spectrum[:, :, None])[:, :, 0]
        later *= self._nx * self.mean_density / later[0, 0].real
        gauge = 1 + np.fft.irfft(later[:, 0] * self._gauge_modes, n=self._nx)
        if not gauge.min() > 0:
            return None
        a = np.fft.irfft(later, n=self._nx, axis=0) / gauge[:, None]
        a *= self.mean_density / a[:, 0].mean()
        return self.basis.velocity_moments(a)

    def _note(self, spectrum: NDArray[np.complex128], gauge: Array) -> None:
        smallest, largest = float(gauge.min()), float(gauge.max())
        if not smallest > 0:
            raise LostAccuracy("exp(SΦ) spans more decades over the pipe than there are digits")
        self.gauge_range = max(self.gauge_range, math.log(largest / smallest))
        if self.round_off > self.tolerance:
            raise LostAccuracy(f"exp(SΦ) spans {self.gauge_range / math.log(10):.0f} decades: round-off is {self.round_off:.1g}")
        if self._nx > 1:
            last = 2 / self._nx * float(np.abs(spectrum[-2:, 0]).max())
            self.density_defect = max(self.density_defect, last / (self.mean_density * smallest))

    def _table(self, h: float) -> NDArray[np.complex128]:
        """The propagators of the first wavenumbers; those left out are zero to twice the digits there are."""
        matrices = propagators(self.basis, self._wavenumbers, self._bloch, self.model, h)
        if self._nx % 2 == 0:
            matrices[-1] = matrices[-1].real
        largest = np.abs(matrices).max(axis=(1, 2))
        kept = 1 + int(np.flatnonzero(largest > ROUND_OFF**2 * largest[0])[-1])
        return matrices[:kept].copy()
