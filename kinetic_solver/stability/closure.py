"""Moment closures of (2), linearised about the homogeneous state: the paper's cubic, its critical density, and M moments.

A closure's critical density is a property of the closure. The kinetic equation that it closes is linearly stable at every
density (docs/stability_details.md; tests/linear_theory/).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.errors import SceneError
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.units import Complex, stationary, wavenumber
from kinetic_solver.threads import with_one_blas_thread

if TYPE_CHECKING:
    import xarray as xr

SHORTEST = 7 * math.sqrt(3) / 9
"""R*_c of three moments for k → ∞, the least of all modes: where the paper's ρ_c^min lies."""
WORST_CONDITION = 1e10
"""The largest condition number of the marginal eigenvalue at which R*_c is given. At 3e8 (M = 64, k* = 1) rounding moves R*_c by
up to 3e-7 of its value."""
PAPERS_DENSITY = 12_000.0
"""ρ_c^min as the paper prints it; its units are not given."""


def closure_rates(scene: Scene, mode: int = 1) -> Complex:
    """The three s of the closure (3)-(5) for waves exp(ikx + st) of mode n, the fastest growing first; the paper's α is -s.

    (6): roots of s'³ + 3γs'² + (2γ² + 3k²σ - 3ikσSρ)s' + 2γ(k²σ - ikσSρ) = 0, s' = s + iku_h.
    (12), with (14) for the collisions' energy loss (corrected by ρ², docs/theory_details.md) and θ the closure's own homogeneous
    temperature, γ(θ - σ) + Cρθ^{3/2} = 0, C = S(1 - ε²)/√π, a = 2γ + 3Cρ√θ, b = 2Cρθ^{3/2}: roots of
    s'³ + (γ + a)s'² + (aγ + 3k²θ)s' + k²(aθ - b) = 0, which by Routh and Hurwitz all decay, since γ > 0 and
    aθ > b, 3k²θ(γ + a) > k²(aθ - b). Test: tests/linear_theory/test_closure.py.
    Raises SceneError without friction and noise: there is no stationary state then.
    """
    stationary(scene)
    gamma, sigma = scene.model.friction, scene.model.noise
    k = wavenumber(scene, mode)
    rate = scene.cross_section * scene.initial.density
    law = scene.law
    if isinstance(law, Inelastic):
        c = rate * (1 - law.restitution**2) / math.sqrt(math.pi)
        theta = closure_temperature(gamma, sigma, c)
        a, b = 2 * gamma + 3 * c * math.sqrt(theta), 2 * c * theta**1.5
        cubic = [1, gamma + a, a * gamma + 3 * k * k * theta, k * k * (a * theta - b)]
        velocity = scene.model.gravity / gamma
    else:
        drag = rate if law is not None else 0.0
        wave, drive = k * k * sigma, 1j * k * sigma * drag
        cubic = [1, 3 * gamma, 2 * gamma**2 + 3 * (wave - drive), 2 * gamma * (wave - drive)]
        velocity = (scene.model.gravity - drag * sigma) / gamma
    s = np.roots(np.array(cubic, dtype=complex)) - 1j * k * velocity
    return s[np.argsort(-s.real)]


def closure_temperature(gamma: float, sigma: float, c: float) -> float:
    """θ with γ(θ - σ) + cθ^{3/2} = 0: the homogeneous temperature of (12) in the closure, the gas being taken for Maxwellian."""
    if c <= 0:
        return sigma
    # In √θ the left-hand side grows and is convex: Newton's method comes down to the root from where it is positive, as where one
    # term alone is γσ.
    root, before = min(math.sqrt(sigma), (gamma * sigma / c) ** (1 / 3)), math.inf
    while root < before:
        before, root = root, root - (gamma * (root**2 - sigma) + c * root**3) / (2 * gamma * root + 3 * c * root**2)
    return before**2


def critical_density(scene: Scene, mode: int = 1, moments: int = 3) -> float:
    """ρ_c at which mode n (k = 2πn/L) of the closure with `moments` Hermite moments turns unstable; inf where it never does.

    Three moments are the paper's (3)-(5): from the marginal case s' = iω of `closure_rates`,
    S ρ_c = ω(2γ² + 3k²σ - ω²)/(2γkσ), with ω² = [3k²σ + √(9k⁴σ² + (16/3)γ²k²σ)]/2, and R*_c → 7√3/9 for k → ∞.
    Other numbers: `critical_collision_number`. inf for operator (12), whose closure is stable, and without collisions, friction
    or noise. Raises SceneError for mode < 1, moments < 2, and for more moments than double precision resolves.
    Test: tests/linear_theory/test_closure.py.
    """
    if moments < 2:
        raise SceneError(f"moments = {moments}: must be 2 or more")
    k = wavenumber(scene, mode)
    gamma, sigma = scene.model.friction, scene.model.noise
    if scene.law is None or not scene.law.linearises or gamma * sigma == 0:
        return math.inf
    unit = gamma / (math.sqrt(sigma) * scene.cross_section)
    """The density at which R* = 1."""
    return unit * critical_collision_number(k * math.sqrt(sigma) / gamma, moments)


def marginal_wavenumber(collision_number: float) -> float:
    """k* above which waves of the paper's closure (M = 3) grow at an R*; inf at R* ≤ 7√3/9, where none do.

    `critical_collision_number` solved for k*. With R* = √u - 2/(3√u), u = ω²/k², and u(u - 3) = 4/(3k²).
    Test: tests/linear_theory/test_closure.py.
    """
    if not collision_number > SHORTEST:
        return math.inf
    u = ((collision_number + math.sqrt(collision_number**2 + 8 / 3)) / 2) ** 2
    return 2 / math.sqrt(3 * u * (u - 3))


def critical_collision_number(wavenumber: float, moments: int = 3) -> float:
    """R*_c of the closure of (2) with (6) that keeps M = `moments` Hermite moments, at k* = `wavenumber` (may be inf).

    M = 3 is closed form for any k* (`critical_density`). k* = inf is closed form for any M: with x the positive zeros of He_M,

        R*_c = min [x² + 2(M - 1)]/(3x),     at least and, for large M, (2/3)√(2(M - 1))     (docs/stability_details.md has the
        proof).

    Otherwise the density at which an eigenvalue of `closure_generator` crosses the imaginary axis: at k* = 1 to 1e-11 for M = 32
    and 3e-7 for M = 64. Many moments and long waves make it too ill-conditioned for double precision: SceneError then.
    Test: tests/linear_theory/test_closure.py, against 120 digits.
    """
    if moments < 2:
        raise SceneError(f"moments = {moments}: must be 2 or more")
    if not wavenumber > 0:
        raise SceneError(f"wavenumber = {wavenumber}: must be above 0; inf is allowed")
    if moments == 3:
        # ω²/k², in which nothing overflows or cancels
        u = (3 + math.hypot(3, 4 / math.sqrt(3) / wavenumber)) / 2
        return math.sqrt(u) * (1 - 2 / (3 * u))
    if wavenumber > 1e7:  # double precision sees no more than the limit, which is reached as 1/k*²
        from scipy.linalg import eigh_tridiagonal

        x = eigh_tridiagonal(np.zeros(moments), np.sqrt(np.arange(1.0, moments)), eigvals_only=True)
        x = x[x > 1e-8]
        return float(((x * x + 2 * (moments - 1)) / (3 * x)).min())
    return _marginal(wavenumber, moments)


def closure_generator(wavenumber: float, collision_number: float, moments: int) -> Complex:
    """G with da/dt = G a for the Hermite moments a_0 … of a wave exp(ikx) in the frame of u_h, shape (moments, moments).

    γ = σ = 1, so k is k* and Sρ is R*. All but the highest moment obey the kinetic equation's own linearisation.
    """
    n = np.arange(moments)
    ik = 1j * wavenumber
    generator = np.diag(-n.astype(complex))
    generator += np.diag(-ik * np.sqrt(n[1:]), -1) + np.diag(-(ik + collision_number) * np.sqrt(n[1:]), 1)
    generator[0, 1] = -ik
    generator[1, 0] -= collision_number
    return generator


@with_one_blas_thread
def _marginal(wavenumber: float, moments: int) -> float:
    from scipy.linalg import eig
    from scipy.optimize import brentq

    def balanced(number: float) -> Complex:
        """The tridiagonal generator scaled to two off-diagonals of equal size: the same eigenvalues, better conditioned."""
        generator = closure_generator(wavenumber, number, moments)
        ratio = np.sqrt(np.abs(np.diag(generator, -1)) / np.abs(np.diag(generator, 1)))
        below, above = np.diag(generator, -1) / ratio, np.diag(generator, 1) * ratio
        return np.diag(np.diag(generator)) + np.diag(below, -1) + np.diag(above, 1)

    def growth(number: float) -> float:
        return float(np.linalg.eigvals(balanced(number)).real.max())

    # Stable at R* = 0. Upwards in ratios of 1.03 from below the least R*_c of all wavenumbers, as far as R*_c was seen to lie.
    lowest = 0.5 * critical_collision_number(math.inf, moments)
    highest = 4 * moments * (1 + 1 / wavenumber)
    previous = 0.0
    for number in np.geomspace(lowest, highest, math.ceil(math.log(highest / lowest) / math.log(1.03))):
        if growth(float(number)) > 0:
            critical = float(brentq(growth, previous, float(number), xtol=1e-10))
            s, left, right = eig(balanced(critical), left=True, right=True)
            n = int(s.real.argmax())
            if abs(np.vdot(left[:, n], right[:, n])) < 1 / WORST_CONDITION:
                raise SceneError(
                    f"moments = {moments}: at k* = {wavenumber:.4g} double precision does not resolve the closure's "
                    "eigenvalues; allowed: fewer moments, or shorter waves"
                )
            return critical
        previous = float(number)
    return math.inf


def figure_1(length: float = 8 * math.pi, modes: Sequence[int] = range(1, 41)) -> xr.Dataset:
    """The paper's Fig. 1: ρ_c over the mode number n, dims (mode,).

    The paper gives no parameters. Its ρ_c^min ≈ 12000 fixes S = (7√3/9) γ/(12000 √σ), and with it the scale of ρ_c;
    `length` is L* = Lγ/√σ, which fixes the scale of n.
    """
    import xarray as xr

    n = np.asarray(modes)
    k = 2 * math.pi * n / length
    number = np.array([critical_collision_number(float(value)) for value in k])
    return xr.Dataset(
        {
            "critical_density": (
                "mode",
                number * PAPERS_DENSITY / SHORTEST,
                {"long_name": "critical density ρ_c of the three-moment closure", "units": "particles length-1"},
            ),
            "critical_collision_number": ("mode", number, {"long_name": "R*_c = S ρ_c √σ/γ", "units": "1"}),
            "wavenumber": ("mode", k, {"long_name": "k* = k √σ/γ", "units": "1"}),
        },
        {"mode": ("mode", n, {"long_name": "mode number n, k = 2πn/L", "units": "1"})},
        {
            "title": "Critical density of the three-moment closure, follow-the-leader collisions",
            "least_critical_density": PAPERS_DENSITY,
            "cross_section": f"S = {SHORTEST:.6g} γ/({PAPERS_DENSITY:g} √σ), from the paper's ρ_c^min",
            "length": f"L* = {length:.6g}",
        },
    )
