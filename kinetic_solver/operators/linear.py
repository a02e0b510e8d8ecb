"""The linear part of (2), transport and drift-diffusion together, in one step of any length.

Because both are Gaussian, the exact propagator over h splits WITHOUT a splitting error (Bernier, Crouseilles and Li 2021 call
such splittings exact): in Fourier space along x, with τ = tanh(γh/2)/γ,

    transport by τ · Ornstein-Uhlenbeck kernel over h · transport by τ · shift by (g/γ)(h - 2τ) · exp(-k²(σ/γ)(h - 2τ)).

For γ → 0 this is the usual half transport, acceleration, half transport. A function that grows along the pipe as exp(Rx) times
a periodic one, as the linearised equation of operator (6) needs (operators/linearised/), takes the same step with k - iR for k.
With the exact kernel the step is exact in time and spectrally accurate in x and v whatever its length; with the finite volumes
it is as accurate as they are.
Test: tests/convergence/test_linear.py.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import RealTransform
from kinetic_solver.operators.tables import Tables
from kinetic_solver.operators.transport import shift_phases
from kinetic_solver.operators.velocity import DriftDiffusion, HermiteBasis
from kinetic_solver.operators.velocity.hermite import propagators
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import bridge_variance, excess_displacement, half_transport_time

FADED = 40.0
"""e^-40 is 4e-18 of a wave: below rounding."""
TABLES = 12
"""Step lengths whose tables are kept. An extrapolated step uses four, those of 1, 2, 3 and 4 substeps: room for three steps."""


@dataclass(frozen=True)
class _LinearTable:
    kernel_t: Array
    """K transposed, (nv, nv)."""
    before: NDArray[np.complex128]
    """Phases of the transport before the kernel, (nx//2 + 1, nv)."""
    after: NDArray[np.complex128]
    """Those after it, with the uniform shift and the factor exp(-k²(σ/γ)(h - 2τ))."""


class LinearStep:
    """Substep f → f(t + h), shapes (nx, nv). Conserves mass to round-off. Tables are kept for the last few values of h.

    With `growth` R [1/length] the function stepped is f exp(Rx), and what is returned its periodic part up to one constant
    factor: that step conserves nothing.

    Waves in x that noise damps below e^-FADED, whatever they look like in v, are left out: before the kernel acts they may be
    turned into waves in v that no dv holds.
    """

    def __init__(
        self,
        grid: PhaseSpaceGrid,
        model: Model,
        drift_diffusion: DriftDiffusion,
        growth: float = 0.0,
        transform: RealTransform | None = None,
    ) -> None:
        """`transform`: that of somebody else, who leaves nothing in its buffers meanwhile; by default one of its own."""
        self.grid = grid
        self.model = model
        self.drift_diffusion = drift_diffusion
        self.growth = growth
        self._given = transform
        self._tables = Tables[_LinearTable](TABLES)

    @functools.cached_property
    def _transform(self) -> RealTransform | None:
        """Made when it is needed: exact steps of (6) have this step only to fall back on."""
        if self.grid.nx == 1 and not self.growth:
            return None
        return self._given or RealTransform(self.grid.nx, self.grid.nv)

    def _table(self, h: float) -> _LinearTable:
        g, gamma, sigma = self.model.gravity, self.model.friction, self.model.noise
        tau = half_transport_time(gamma, h)
        excess = excess_displacement(gamma, h)  # h - 2τ, which is O(γ²h³): the limits below exist at γ = 0
        kernel_t = np.ascontiguousarray(self.drift_diffusion.matrix(h).T)
        before = shift_phases(self.grid, tau * self.grid.v)
        if self.growth:
            # exp(R(x - τv)), about the middle of the window: the constant does not matter
            before *= np.exp(-self.growth * tau * (self.grid.v - (self.grid.low + self.grid.high) / 2))
        before[faded(self.grid, self.model, h)] = 0.0
        after = before
        if gamma > 0:
            # -(k - iR)² = -k² + 2ikR + a constant: growth moves the diffusing waves
            moved = (g - 2 * self.growth * sigma) / gamma * excess
            uniform = shift_phases(self.grid, np.array([moved]))
            diffusion = np.exp(-(self.grid.wavenumbers**2) * sigma / gamma * excess)
            after = before * uniform * diffusion[:, None]
        return _LinearTable(kernel_t, before, after)

    def __call__(self, f: Array, h: float) -> Array:
        if self._transform is None:
            return f @ self._tables.get(h, self._table).kernel_t
        return self.of_waves(self._transform.forward(f), h)

    def of_waves(self, waves: NDArray[np.complex128], h: float) -> Array:
        """The same of an f whose Fourier modes along x are known, (nx//2 + 1, nv)."""
        assert self._transform is not None
        table = self._tables.get(h, self._table)
        spectrum = np.multiply(waves, table.before, out=self._transform.spectrum)
        # K is real, and the same at every x: it acts on the real and imaginary parts of the waves, rows of one real matrix. That
        # costs what it does in x-space, and no transform there and back.
        moved = np.concatenate([spectrum.real, spectrum.imag]) @ table.kernel_t
        spectrum.real, spectrum.imag = moved[: len(spectrum)], moved[len(spectrum) :]
        spectrum *= table.after
        return self._transform.inverse()


def faded(grid: PhaseSpaceGrid, model: Model, h: float) -> NDArray[np.bool_]:
    """Which waves noise has made smaller than rounding after h; (nx//2 + 1,)."""
    return np.asarray(grid.wavenumbers**2 * bridge_variance(model, h) / 2 > FADED)


class HermiteLinearStep:
    """The same substep on Hermite coefficients (nx, count), in closed form (`propagators`), linear in the state."""

    def __init__(self, grid: PhaseSpaceGrid, basis: HermiteBasis, model: Model) -> None:
        self.grid = grid
        self.basis = basis
        self.model = model
        self._transform = RealTransform(grid.nx, basis.count)
        self._tables = Tables[NDArray[np.complex128]](TABLES)

    def _table(self, h: float) -> NDArray[np.complex128]:
        """The propagator of each wave, (nx//2 + 1, count, count)."""
        matrices = propagators(self.basis, self.grid.wavenumbers, 0.0, self.model, h)
        if self.grid.nx % 2 == 0:
            matrices[-1] = matrices[-1].real  # the Nyquist mode, as in operators/transport.py
        return matrices

    def __call__(self, a: Array, h: float) -> Array:
        matrices = self._tables.get(h, self._table)
        spectrum = self._transform.forward(a)
        spectrum[:] = np.matmul(matrices, spectrum[:, :, None])[:, :, 0]
        return self._transform.inverse()
