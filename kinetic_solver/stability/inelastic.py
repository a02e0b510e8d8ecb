"""(2) with operator (12), linearised about its homogeneous state, which is not Gaussian: by a Fourier-Galerkin method in v.

Units γ = σ = 1, the frame of u_h, ρ = 1, so that S is R*. On a period 2T of w, f = Σ f_l exp(iξ_l w), ξ_l = πl/T; the weak form
of (12) (docs/theory.md) tested with exp(-iξ_n w) is a convolution with closed-form weights,

    C_n = Σ_{l+m=n} K(n, l) f_l f_m,
    K = (R/2) ∫_{-ϱ}^{ϱ} |r| [e^{i(ξ_l - αξ_n)r} + e^{i(ξ_l - (1-α)ξ_n)r} - e^{-iξ_m r} - e^{iξ_l r}] dr,

α = (1 - ε)/2 (L. Pareschi and B. Perthame 1996 introduced such methods). It shares nothing with the grid solver's pairs of
cells. All of it converges geometrically: in the number of points a width of f_h, and in the window, whose edge f_h reaches
at exp(-`DIGITS`).
Mass is conserved to round-off (K(0, l) = 0 in sum), momentum and energy's rate to what the window cuts off.
Tests: tests/linear_theory/test_inelastic.py.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.stability.closure import closure_temperature
from kinetic_solver.stability.hermite import HermiteEquations, inelastic_equations, lyapunov_structure_factor, matrix_density_gain
from kinetic_solver.stability.units import Complex
from kinetic_solver.threads import with_one_blas_thread

DIGITS = 44.0
"""ln of the largest f_h over f_h at the window's edge: exp(-44) = 8e-20 is below round-off."""
POINTS = 4.5
"""Points per thermal velocity √θ_h. f_h alone, a Gaussian to within a few per cent, is resolved to round-off by 2.9."""
SHORTEST_WAVE = 12.0
"""The largest k*√(θ_h/σ) of which the spectrum is computed: free flight shears a wave as exp(-ikw), which takes ever more
points."""
WORST_UNCERTAINTY = 0.01
"""The largest uncertainty, relative to |s| or to γ where |s| is less, at which an eigenvalue is given. Beyond it what is found is
the spectrum of rounding errors, whose own size is then not known either."""
LONGEST_WAVE = 0.01
"""k* below which S(k) is extrapolated. The Lyapunov equation loses digits as 1/k*², and S(k) is even and smooth there."""


@functools.lru_cache(maxsize=64)
def inelastic_flow(restitution: float, collision_number: float) -> InelasticFlow:
    """The flow at ε and R*; the last 64 are kept."""
    return InelasticFlow(restitution, collision_number)


class InelasticFlow:
    """A `Flow` (flow.py) about the homogeneous state of (12)."""

    @with_one_blas_thread
    def __init__(self, restitution: float, collision_number: float) -> None:
        self.restitution = restitution
        self.collision_number = collision_number
        self._base = _Discretisation(restitution, collision_number, POINTS, DIGITS)
        self.temperature = self._base.temperature

    @property
    def homogeneous(self) -> tuple[Array, Array, float]:
        """(w, f_h(w), dw) on the points of the base discretisation."""
        return self._base.w, self._base.f, self._base.dv

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
            raise SceneError(f"k* = {wavenumber:.4g}: too short a wave for the spectrum of operator (12); allowed: a longer one")
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


class _Discretisation:
    """The window [-T, T), its points w, the weights K, and the homogeneous state f on them."""

    def __init__(self, restitution: float, collision_number: float, points: float, digits: float) -> None:
        self.points = points
        self.restitution, self.collision_number = restitution, collision_number
        guess = closure_temperature(1.0, 1.0, collision_number * (1 - restitution**2) / math.sqrt(math.pi))
        # The far tail falls as exp(-w²/2 - R|w|), slower than the core's Gaussian; the window takes in both.
        tail = math.sqrt(collision_number**2 + 2 * digits) - collision_number
        reach = max(math.sqrt(2 * digits * guess), tail)
        # Pairs up to ϱ = √2·reach apart hold all but exp(-digits) of the collisions; a period 2ϱ keeps the others' images out.
        self.range = self.half = math.sqrt(2) * reach
        self.count = 2 * math.ceil(self.half / math.sqrt(guess) * points) + 1
        self.dv = 2 * self.half / self.count
        self.index = np.arange(self.count) - self.count // 2
        self.w = self.dv * self.index
        self.xi = np.pi / self.half * self.index
        self.to_waves = np.exp(-1j * np.outer(self.xi, self.w)) / self.count
        self.to_points = np.exp(1j * np.outer(self.w, self.xi))
        derivative = (self.to_points * (1j * self.xi) @ self.to_waves).real
        self.drift_diffusion = derivative @ (np.diag(self.w) + derivative)
        self._weights()
        self.f = self._homogeneous(guess)
        self.temperature = float(self.w**2 @ self.f) * self.dv

    def _weights(self) -> None:
        n, low = np.meshgrid(self.index, self.index, indexing="ij")
        m = n - low
        kept = np.abs(m) <= self.count // 2
        alpha, unit = (1 - self.restitution) / 2, np.pi / self.half

        def half_of_k(low: NDArray[np.int_], m: NDArray[np.int_]) -> Array:
            places = (low - alpha * n, low - (1 - alpha) * n)
            gain = sum(_moment(unit * place, self.range) for place in places)
            return self.collision_number / 2 * (gain - _moment(unit * m, self.range) - _moment(unit * low, self.range))

        self._m = np.where(kept, m + self.count // 2, 0)
        self._quadratic = np.where(kept, half_of_k(low, m), 0.0)  # symmetric in l and m

    def _homogeneous(self, guess: float) -> Array:
        """0 = ∂(wf + ∂f) + C[f], ∫f = 1, by Newton's method from the closure's Maxwellian."""
        f = np.exp(-(self.w**2) / (2 * guess)) / math.sqrt(2 * math.pi * guess)
        for _ in range(40):
            waves = self.to_waves @ f
            residual = self.drift_diffusion @ f + (self.to_points @ ((self._quadratic * waves[self._m]) @ waves)).real
            jacobian = self.drift_diffusion + self.linear_collisions(f)
            # The equations sum to zero (mass); ∫f = 1 takes their place, added to each so that the matrix stays regular.
            step = np.linalg.solve(jacobian + self.dv, -residual + (1 - f.sum() * self.dv))
            f = f + step
            if np.abs(step).max() < 1e-12 * f.max():
                return f
        raise SceneError(
            f"collisions: the homogeneous state at restitution {self.restitution:g}, R* = {self.collision_number:.3g} "
            "is out of reach; allowed: a given initial.temperature, or a smaller R* (collisions.cross_section)"
        )

    def linear_collisions(self, f: Array) -> Array:
        """δf → C linearised about f, on points."""
        waves = self.to_waves @ f
        return (self.to_points @ (2 * self._quadratic * waves[self._m]) @ self.to_waves).real

    @functools.cached_property
    def _at_rest(self) -> Array:
        return self.drift_diffusion + self.linear_collisions(self.f)

    def generator(self, wavenumber: float) -> Complex:
        """G with ∂δf/∂t = G δf for a wave exp(ikx), on points."""
        return self._at_rest - 1j * wavenumber * np.diag(self.w)

    def interpolate(self, values: Complex | Array, w: Array) -> Complex:
        """The trigonometric interpolant, 0 outside the window."""
        w = np.asarray(w, dtype=float)
        inside = np.abs(w) < self.half
        result = np.zeros(w.shape, dtype=complex)
        result[inside] = np.exp(1j * np.multiply.outer(w[inside], self.xi)) @ (self.to_waves @ values)
        return result


def _moment(omega: Array, reach: float) -> Array:
    """∫_{-ϱ}^{ϱ} |r| exp(iωr) dr."""
    x = omega * reach / np.pi
    return reach**2 * (2 * np.sinc(x) - np.sinc(x / 2) ** 2)
