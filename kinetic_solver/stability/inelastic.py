"""(2) with operator (12), linearised about its homogeneous state, which is not Gaussian: by a Fourier-Galerkin method in v
(galerkin.py).

Units γ = σ = 1, the frame of u_h, ρ = 1, so that S is R*. Tests: tests/linear_theory/test_inelastic.py.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.stability.closure import closure_temperature
from kinetic_solver.stability.galerkin import DIGITS, StationaryInWaves, tail_end
from kinetic_solver.stability.hermite import HermiteEquations, inelastic_equations, lyapunov_structure_factor, matrix_density_gain
from kinetic_solver.stability.units import Complex
from kinetic_solver.threads import one_blas_thread, with_one_blas_thread

POINTS = 4.5
"""Points per thermal velocity √θ_h. f_h alone, a Gaussian to within a few per cent, is resolved to round-off by 2.9."""
SHORTEST_WAVE = 12.0
"""The largest k*√(θ_h/σ) of which the spectrum is computed: free flight shears a wave as exp(-ikw), which takes ever more
points."""
ROUGH = (3.2, 20.0)
"""(points per √θ_h, digits) at which θ_h is good to 1e-7, in a quarter of the time: measured, ε from 0 to 0.95, R* from 0.5 to
100."""
WORST_UNCERTAINTY = 0.01
"""The largest uncertainty, relative to |s| or to γ where |s| is less, at which an eigenvalue is given. Beyond it what is found is
the spectrum of rounding errors, whose own size is then not known either."""
LONGEST_WAVE = 0.01
"""k* below which S(k) is extrapolated. The Lyapunov equation loses digits as 1/k*², and S(k) is even and smooth there."""


@functools.lru_cache(maxsize=64)
def inelastic_flow(restitution: float, collision_number: float) -> InelasticFlow:
    """The flow at ε and R*; the last 64 are kept."""
    return InelasticFlow(restitution, collision_number)


@functools.lru_cache(maxsize=64)
def rough_temperature(restitution: float, collision_number: float) -> float:
    """θ_h alone, to 1e-7."""
    with one_blas_thread(with_scipy=False):
        return _Discretisation(restitution, collision_number, *ROUGH).temperature


class InelasticFlow:
    """A `Flow` (flow.py) about the homogeneous state of (12)."""

    def __init__(self, restitution: float, collision_number: float) -> None:
        self.restitution = restitution
        self.collision_number = collision_number
        with one_blas_thread(with_scipy=False):
            self._base = _Discretisation(restitution, collision_number, POINTS, DIGITS)
        self.temperature = self._base.temperature

    @property
    def homogeneous(self) -> tuple[Array, Array, float]:
        """(w, f_h(w), dw) on the points of the base discretisation."""
        return self._base.w, self._base.f, self._base.dv

    @property
    def reach(self) -> float:
        """|w| beyond which f_h is below exp(-44) of its largest value."""
        return self._base.reach

    @property
    def mean_distance(self) -> float:
        """⟨|w - w'|⟩."""
        return self._base.mean_distance(self._base.f)

    def resolves(self, wavenumber: float) -> bool:
        """Whether the points in w are enough for waves so short. Those that are shorter have died out in a tenth of 1/γ."""
        return abs(wavenumber) * math.sqrt(self.temperature) <= SHORTEST_WAVE

    def _at(self, wavenumber: float) -> _Discretisation:
        """With points enough for exp(-ikw), into which free flight shears a wave."""
        more = abs(wavenumber) * math.sqrt(self.temperature) / math.pi
        if more < 0.3:
            return self._base
        return _discretisation(self.restitution, self.collision_number, POINTS + 1.5 * more, DIGITS)

    @with_one_blas_thread
    def rates(self, wavenumber: float, count: int) -> tuple[Complex, Array]:
        """Eigenvalues of the generator. Their uncertainty is the distance to those on a coarser grid in a narrower window, or
        what rounding does to them, whichever is more: the latter where short waves meet few collisions. NaN, uncertain by inf,
        for waves that are not resolved, and where the uncertainty is no longer a small change: above `WORST_UNCERTAINTY`."""
        from scipy.linalg import eig

        if not self.resolves(wavenumber):
            return np.full(count, np.nan, dtype=complex), np.full(count, np.inf)
        fine = self._at(wavenumber)
        coarse = _discretisation(self.restitution, self.collision_number, 0.85 * fine.points, DIGITS - 8)
        generator = fine.generator(wavenumber)
        values, left, right = eig(generator, left=True, right=True)
        order = _leading(values)[:count]
        s = values[order]
        other = np.linalg.eigvals(coarse.generator(wavenumber))
        condition = 1 / np.abs(np.sum(left[:, order].conj() * right[:, order], axis=0))
        rounding = np.finfo(float).eps * np.linalg.norm(generator, 2) * condition
        uncertainty = np.maximum(np.abs(s[:, None] - other[None, :]).min(axis=1), rounding)
        known = uncertainty <= WORST_UNCERTAINTY * np.maximum(np.abs(s), 1.0)
        return np.where(known, s, np.nan), np.where(known, uncertainty, np.inf)

    def distribution(self, w: Array) -> Array:
        return self._base.interpolate(self._base.f, w).real

    @with_one_blas_thread
    def eigenfunction(self, wavenumber: float, branch: int, w: Array) -> Complex:
        if not self.resolves(wavenumber):
            raise SceneError(f"k* = {wavenumber:.4g}: too short for the inelastic spectrum; allowed: a longer wave")
        fine = self._at(wavenumber)
        values, vectors = np.linalg.eig(fine.generator(wavenumber))
        mode = vectors[:, _leading(values)[branch]]
        return fine.interpolate(mode / (mode.sum() * fine.dv), w)

    @functools.cached_property
    def _hermite(self) -> HermiteEquations:
        base = self._base
        return inelastic_equations(self.restitution, self.collision_number, base.temperature, base.w, base.f * base.dv)

    def equations(self, wavenumber: float) -> HermiteEquations:
        return self._hermite

    @with_one_blas_thread
    def density_gain(self, wavenumber: float, times: Array) -> Array:
        """By matrix exponentials, in `FUNCTIONS` Hermite functions."""
        return matrix_density_gain(self._hermite, wavenumber, times)

    @with_one_blas_thread
    def structure_factor(self, wavenumber: float) -> float:
        """From the Lyapunov equation; S → σ/(d(ρθ)/dρ) for k → 0. Below `LONGEST_WAVE` by a parabola in k."""
        if wavenumber >= LONGEST_WAVE:
            return lyapunov_structure_factor(self._hermite, wavenumber)
        once, twice = (lyapunov_structure_factor(self._hermite, n * LONGEST_WAVE) for n in (1, 2))
        return once + (once - twice) / 3 * (1 - (wavenumber / LONGEST_WAVE) ** 2)


def _leading(s: Complex) -> NDArray[np.intp]:
    """The order by falling real part; of a conjugate pair the one with Im s > 0 first."""
    scale = np.abs(s).max()
    return np.lexsort((-s.imag, -np.round(s.real / scale, 11)))


@functools.lru_cache(maxsize=16)
def _discretisation(restitution: float, collision_number: float, points: float, digits: float) -> _Discretisation:
    return _Discretisation(restitution, collision_number, points, digits)


class _Discretisation(StationaryInWaves):
    """The window, its points w, and the homogeneous state f on them."""

    def __init__(self, restitution: float, collision_number: float, points: float, digits: float) -> None:
        self.points, self.collision_number = points, collision_number
        guess = closure_temperature(1.0, 1.0, collision_number * (1 - restitution**2) / math.sqrt(math.pi))
        width = math.sqrt(guess)
        # The core is nearly Gaussian; far out f falls more slowly. The window takes in both.
        reach = max(math.sqrt(2 * digits) * width, tail_end(restitution, 1.0, 1.0, collision_number, width, digits))
        # Pairs up to √2·reach apart hold all but exp(-digits) of the collisions; that half period keeps the others' images out.
        self.reach = reach
        half = math.sqrt(2) * reach
        super().__init__(restitution, half, 2 * math.ceil(half / width * points) + 1)
        self._driven = self.drift + self.diffusion
        maxwellian = np.exp(-(self.w**2) / (2 * guess)) / math.sqrt(2 * math.pi * guess)
        self.f = self.stationary(maxwellian, self._driven, collision_number)
        self.temperature = float(self.w**2 @ self.f) * self.dv

    def linear_collisions(self, f: Array) -> Array:
        """δf → C linearised about f, on points."""
        return self.collision_number * self.linear(f)

    @functools.cached_property
    def _at_rest(self) -> Array:
        return self._driven + self.linear_collisions(self.f)

    def generator(self, wavenumber: float) -> Complex:
        """G with ∂δf/∂t = G δf for a wave exp(ikx), on points."""
        return np.asarray(self._at_rest - 1j * wavenumber * np.diag(self.w))
