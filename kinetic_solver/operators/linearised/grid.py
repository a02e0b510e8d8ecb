"""Equation (2) with operator (6) in one exact step of any length, from any f on velocity points.

With Φ_x = ρ, Φ_t = -ρu and f = F exp(-SΦ), F obeys (2) without collisions (docs/theory_details.md, "exactly linearisable"), so
every part of the exact linear step (operators/linear.py) is an exact part of the nonlinear one. What a part does to Φ follows
from E = exp(SΦ), E_x = S∫F dv. There is no splitting and no error in time; what is left is how well the grid resolves f.

exp(SΦ) spans many decades, and a Fourier transform in x is accurate relative to the largest value only. So there are two gauges:

- global: F's periodic part, W f with W = exp(S·periodic part of Φ), takes one linear step with the growth Sρ̄ (a Bloch factor).
  Round-off is ε·max W/min W.
- local: f itself is shifted, then multiplied by exp(S[Φ(x - d) - Φ(x)]), which is moderate. No transform ever sees W. To
  avoid diffusion in x, which would, the linear step is composed of three transports and two kernels (`transport_times`), each of
  which is a physical, nonlinear substep. Three to eight times dearer; round-off of a few ε times what (6) itself amplifies.

Tests: tests/exact/test_linearised_grid.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import RealTransform, derivative, integral_spectrum
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.linearised.moments import moments_after
from kinetic_solver.operators.linearised.ratio import GaugeRatio
from kinetic_solver.operators.tables import Tables
from kinetic_solver.operators.transport import resolved_waves, shift_phases
from kinetic_solver.operators.velocity import DriftDiffusion
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import half_transport_time, transition, transport_times

ROUND_OFF = float(np.finfo(float).eps)
"""Relative spacing of doubles, 2.2e-16."""
EMPTY = 1e-9
"""Of the largest ∫F dv: where there is less, it may be rounding, and what f misses of the density is added, not multiplied."""
TABLES = 8
"""Step lengths whose tables are kept. Frames at even times use one or two; at uneven times each brings its own."""
LARGEST_EXPONENT = 500.0
"""Of one piece of a tilt: the logarithm of the largest double is 709, and f itself needs some of that. Chosen."""
GROWTHS = 2
"""Mean densities whose linear steps are kept: that of a chain, and that of the chain's link before, apart by rounding."""

MOMENTS_ROUND_OFF = 20.0
"""Of `tolerance`, to moments in the global gauge of a state that is stepped in the local one: rtol, with the share that the plan
gives to round-off. Chosen: nothing is built upon them, and what they err by most is where f is least."""


@dataclass(frozen=True)
class Lifted:
    """f, or in the global gauge F's periodic part up to a constant factor; (nx, nv)."""

    values: Array
    mean_density: float | None
    """ρ̄, from which the global gauge takes its growth; None in the local gauge, which needs none."""
    jumps: bool = False
    """True of a start with jumps in x, which no grid resolves: what a step from it contradicts itself by is no error."""


class GridLinearisedStep:
    """f of shape (nx, nv) → f(t + h), for operator (6) and any h: `lower(propagate(lift(f), h))`.

    In the global gauge `propagate` is linear, and many are as good as one. Mass is conserved to round-off by construction: f
    takes its density in flux form, ρ' = ρ + ∂_x(log η)/S with η = E'/E. `density_defect` is the largest difference so far, over
    max ρ, between it and the sum over f that it replaces: it vanishes where x is resolved, and measures the error elsewhere.
    `tolerance` decides between the gauges: the global one is used where its round-off stays below.
    Raises LostAccuracy where E is not positive, or not a number.
    """

    def __init__(
        self, grid: PhaseSpaceGrid, model: Model, cross_section: float, drift_diffusion: DriftDiffusion, tolerance: float
    ) -> None:
        self.grid = grid
        self.model = model
        self.cross_section = cross_section
        self.drift_diffusion = drift_diffusion
        self.tolerance = tolerance
        self.density_defect = 0.0
        self.forget()
        self._transform = RealTransform(grid.nx, grid.nv)
        self._keep = resolved_waves(grid)
        self._ratio = GaugeRatio(grid, cross_section)
        self._modes_of: tuple[Lifted, NDArray[np.complex128] | None, float] | None = None
        self._waves_of: tuple[Lifted, NDArray[np.complex128]] | None = None

    def __call__(self, f: Array, h: float) -> Array:
        return self.lower(self.propagate(self.lift(f), h))

    def forget(self) -> None:
        """Drops all tables: of steps whose lengths do not come again."""
        self._growing = Tables[LinearStep](GROWTHS)
        self._tables = Tables[_LocalTable](TABLES)
        self._kernels = Tables[Array](TABLES)

    def gauge_range(self, f: Array) -> float:
        """S·(max - min) of the periodic part of Φ: the logarithm of max W/min W."""
        return float(np.ptp(self._potential(f.sum(axis=1) * self.grid.dv))) * self.cross_section

    def lift(self, f: Array) -> Lifted:
        """f in the gauge that `tolerance` allows. Raises LostAccuracy where f is not finite or has no mass."""
        density = f.sum(axis=1) * self.grid.dv
        mean = float(density.mean())
        if not (np.isfinite(f).all() and mean > 0):
            raise LostAccuracy("f is not a distribution any more")
        if self.grid.nx == 1:
            return Lifted(f, None)
        phi = self.cross_section * self._potential(density)
        if ROUND_OFF * math.exp(min(float(np.ptp(phi)), 700.0)) > self.tolerance:
            return Lifted(f, None)
        return self.lifted(f * np.exp(phi - phi.max())[:, None], mean)

    def lifted(self, values: Array, mean_density: float) -> Lifted:
        """The periodic part of F in the global gauge, known by itself."""
        spectrum = self._transform.forward(values)
        spectrum *= self._keep[:, None]
        return Lifted(self._transform.inverse(), mean_density)

    def propagate(self, lifted: Lifted, h: float) -> Lifted:
        """After h; in the local gauge it may come back in the global one."""
        # Whatever goes wrong inside shows as a density that is not a positive number, which is looked for.
        with np.errstate(all="ignore"):
            if self.grid.nx == 1:
                return Lifted(self._in_one_place(lifted.values, h), None)
            if lifted.mean_density is not None:
                values = self._growing.get(lifted.mean_density, self._growing_at).of_waves(self._waves(lifted), h)
                return Lifted(values / values.max(), lifted.mean_density)
            table, before = self._tables.get(h, self._table), self.density_defect
            f = self._transported(lifted.values, table.outer) @ table.kernel_t
            f = self._transported(f, table.inner) @ table.kernel_t
            last = self._transported(f, table.outer)
            if lifted.jumps:
                self.density_defect = before
            # The range of Φ only shrinks: once it allows the global gauge, that takes over.
            return self.lift(last)

    def lower(self, lifted: Lifted, blur: float = 0.0) -> Array:
        """f itself; in the global gauge that of F blurred in x by a Gaussian of this variance, which keeps it positive where the
        points do not resolve it."""
        if lifted.mean_density is None:
            return lifted.values
        s, mean, k = self.cross_section, lifted.mean_density, self.grid.wavenumbers
        values = lifted.values
        if blur > 0:
            spectrum = self._transform.forward(values)
            spectrum *= np.exp(-(k**2) * blur / 2)[:, None]
            values = self._transform.inverse()
        with np.errstate(all="ignore"):
            n = values.sum(axis=1) * self.grid.dv
            # E = W exp(Sρ̄x) times a constant, and E_x = S n exp(Sρ̄x). W is its mean times 1 + δ: where S is small so is δ, but
            # not ∂_x(log W)/S.
            spectrum = s * np.fft.rfft(n) / (s * mean + 1j * k)
            level, spectrum[0] = float(spectrum[0].real) / self.grid.nx, 0.0
            delta = np.fft.irfft(spectrum, n=self.grid.nx) / level
            log = np.where(np.abs(delta) < 0.5, np.log1p(delta), np.log(1 + delta))
            return self._with_density(values, n, level * (1 + delta), mean + derivative(log, k) / s, rounded=True)

    def moments(self, lifted: Lifted, times: Sequence[float], blurs: Sequence[float]) -> Array | None:
        """∫v^n f dv, n = 0 … 3, after each time, shape (times, 4, nx), at a fraction of what f costs (linearised/moments.py).

        None where the global gauge has too much round-off for them, and where the start has jumps that it would not resolve.
        """
        if self._modes_of is None or self._modes_of[0] is not lifted:
            self._modes_of = (lifted, *self._modes(lifted))
        _, modes, mean = self._modes_of
        if modes is None:
            return None
        return moments_after(self.grid, self.model, self.cross_section, modes, mean, times, blurs)

    def _waves(self, lifted: Lifted) -> NDArray[np.complex128]:
        """The Fourier modes of its values, (nx//2 + 1, nv). Kept, for one state is propagated to many times."""
        if self._waves_of is None or self._waves_of[0] is not lifted:
            self._waves_of = lifted, self._transform.forward(lifted.values).copy()
        return self._waves_of[1]

    def _modes(self, lifted: Lifted) -> tuple[NDArray[np.complex128] | None, float]:
        """The Fourier modes of F's periodic part, and the mean density."""
        if lifted.mean_density is not None:
            return self._waves(lifted), lifted.mean_density
        density = lifted.values.sum(axis=1) * self.grid.dv
        phi = self.cross_section * self._potential(density)
        mean = float(density.mean())
        if lifted.jumps or ROUND_OFF * math.exp(min(float(np.ptp(phi)), 700.0)) > MOMENTS_ROUND_OFF * self.tolerance:
            return None, mean
        return self._transform.forward(lifted.values * np.exp(phi - phi.max())[:, None]).copy(), mean

    def _in_one_place(self, f: Array, h: float) -> Array:
        """Where nothing depends on x: exp(-Sρτv), the kernel over h, and exp(-Sρτv) again, each brought back to the same ρ, with
        τ = tanh(γh/2)/γ as in operators/linear.py."""
        tau = half_transport_time(self.model.friction, h)
        kernel_t = self._kernels.get(h, lambda h: np.ascontiguousarray(self.drift_diffusion.matrix(h).T))
        tilt = self.cross_section * float(f.sum()) * self.grid.dv * tau
        return self._tilted(self._tilted(f, tilt) @ kernel_t, tilt)

    def _tilted(self, f: Array, tilt: float) -> Array:
        """f exp(-tilt·v), brought back to the same ρ: about the mean velocity, and in pieces, none of which is too large."""
        v, total = self.grid.v, float(f.sum())
        pieces = 1 + int(abs(tilt) * (self.grid.high - self.grid.low) / LARGEST_EXPONENT)
        for _ in range(pieces):
            f = f * np.exp(-tilt / pieces * (v - float(f[0] @ v) / total))
            if not (np.isfinite(n := float(f.sum())) and n > 0):
                raise LostAccuracy("f is not a distribution any more")
            f = f * (total / n)
        return f

    def _growing_at(self, mean_density: float) -> LinearStep:
        growth = self.cross_section * mean_density
        return LinearStep(self.grid, self.model, self.drift_diffusion, growth, self._transform)

    def _potential(self, density: Array) -> Array:
        return np.fft.irfft(integral_spectrum(density, self.grid.wavenumbers), n=self.grid.nx)

    def _transported(self, f: Array, shift: _Shift) -> Array:
        """Transport by the displacements d(v), with collisions."""
        grid, s = self.grid, self.cross_section
        density = f.sum(axis=1) * grid.dv
        spectrum = self._transform.forward(f)
        spectrum *= shift.phases
        moved = self._transform.inverse()
        np.multiply(np.fft.rfft(density)[:, None], shift.differences, out=self._transform.spectrum)
        exponent = self._transform.inverse()
        exponent -= density.mean() * shift.displacement
        exponent *= s
        moved *= np.exp(exponent, out=exponent)
        n = moved.sum(axis=1) * grid.dv
        eta = self._ratio(density, n)
        new = density + derivative(np.log(eta), grid.wavenumbers) / s
        return self._with_density(moved, n, eta, np.fft.irfft(np.fft.rfft(new) * self._keep, n=grid.nx))

    def _with_density(self, f: Array, n: Array, e: Array, density: Array, rounded: bool = False) -> Array:
        """f/e, brought from its own density n/e to the one in flux form; `rounded`: small n may be rounding."""
        top = float(density.max())
        missed = density - n / e
        defect = float(np.abs(missed).max()) / top
        empty = n < (EMPTY * n.max() if rounded else 0.0)
        if not (np.isfinite(defect) and e.min() > 0 and n.min() > -EMPTY * n.max() and (rounded or n.min() > 0)):
            raise LostAccuracy("the exactly linearised step of follow-the-leader collisions lost its accuracy")
        self.density_defect = max(self.density_defect, defect)
        if not empty.any():
            return f * (density / n)[:, None]
        new = f * (density / np.where(empty, 1.0, n))[:, None]
        over_x = f.sum(axis=0)
        new[empty] = f[empty] / e[empty, None] + np.outer(missed[empty], over_x / (over_x.sum() * self.grid.dv))
        return np.asarray(new)

    def _table(self, h: float) -> _LocalTable:
        whole, half = transition(self.model, h), transition(self.model, h / 2)
        a, b = transport_times(self.model.friction, h)
        # Gravity acts within the kernels; the displacement that these transports miss is the same for all velocities.
        rest = whole.displacement_shift - b * half.velocity_shift - a * whole.velocity_shift
        kernel_t = np.ascontiguousarray(self.drift_diffusion.matrix(h / 2).T)
        outer = _shift(self.grid, a * self.grid.v)
        inner = _shift(self.grid, b * self.grid.v + rest)
        return _LocalTable(outer, inner, kernel_t)


@dataclass(frozen=True)
class _Shift:
    displacement: Array
    """d(v), (nv,)."""
    phases: NDArray[np.complex128]
    """exp(-ikd), filtered, (nx//2 + 1, nv)."""
    differences: NDArray[np.complex128]
    """[exp(-ikd) - 1]/ik, filtered: from ρ's spectrum to that of the periodic part of Φ(x - d) - Φ(x)."""


@dataclass(frozen=True)
class _LocalTable:
    outer: _Shift
    """Of the first and the last of the three transports."""
    inner: _Shift
    """Of the second."""
    kernel_t: Array
    """K(h/2) transposed, (nv, nv)."""


def _shift(grid: PhaseSpaceGrid, displacement: Array) -> _Shift:
    k = grid.wavenumbers
    keep = resolved_waves(grid)
    phases = shift_phases(grid, displacement)
    differences = np.zeros_like(phases)
    differences[1:] = (phases[1:] - 1) / (1j * k[1:, None])
    return _Shift(displacement, phases * keep[:, None], differences * keep[:, None])
