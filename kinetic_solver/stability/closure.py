"""Moment closures of (2) with operator (6), linearised about the homogeneous state.

Their critical densities are properties of the closures. The kinetic equation that they close is linearly stable at every
density (docs/theory.md, "Linear stability"; tests/exact/test_stability.py).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.scene import FOLLOW_LEADER, Scene


def critical_density(scene: Scene, mode: int = 1, moments: int = 3) -> float:
    """ρ_c at which mode n (k = 2πn/L) of the closure with `moments` Hermite moments turns unstable; inf where it never does.

    Three moments are the paper's (3)-(5): from the marginal case s' = iω of the cubic
    s'³ + 3γs'² + (2γ² + 3k²σ - 3ikσSρ)s' + 2γ(k²σ - ikσSρ) = 0 (docs/theory.md),
    S ρ_c = ω(2γ² + 3k²σ - ω²)/(2γkσ), with ω² = [3k²σ + √(9k⁴σ² + (16/3)γ²k²σ)]/2, and R*_c → 7√3/9 for k → ∞.
    Other numbers: the density at which an eigenvalue of `closure_generator` crosses the imaginary axis, to 1e-9.
    inf for operator (12), whose closure is stable, and without collisions, friction or noise.
    Raises ValueError for mode < 1 or moments < 2.
    """
    if mode < 1:
        raise ValueError(f"mode = {mode}: must be 1 or more")
    if moments < 2:
        raise ValueError(f"moments = {moments}: must be 2 or more")
    gamma, sigma = scene.model.friction, scene.model.noise
    if scene.operator != FOLLOW_LEADER or gamma * sigma == 0:
        return math.inf
    k = 2 * math.pi * mode / scene.pipe.length
    unit = gamma / (math.sqrt(sigma) * scene.cross_section)
    """The density at which R* = 1."""
    if moments != 3:
        return unit * _critical_collision_number(k * math.sqrt(sigma) / gamma, moments)
    a = k * k * sigma
    w = (3 * a + math.sqrt(9 * a * a + 16 / 3 * gamma**2 * a)) / 2
    # 2γ² + 3a - w without the cancellation of 3a against w at large k: w - 3a = (4/3)γ²a/w.
    slope = 2 * gamma**2 - (4 / 3) * gamma**2 * a / w
    return math.sqrt(w) * slope / (2 * gamma * k * sigma * scene.cross_section)


def closure_generator(wavenumber: float, collision_number: float, moments: int) -> NDArray[np.complex128]:
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


def _critical_collision_number(wavenumber: float, moments: int) -> float:
    from scipy.optimize import brentq

    def growth(number: float) -> float:
        return float(np.linalg.eigvals(closure_generator(wavenumber, number, moments)).real.max())

    # Stable at R* = 0. Upwards in small ratios, as far as R*_c was seen to lie: it grows with the moments, and as 1/k.
    numbers = np.geomspace(0.5, 4 * moments * (1 + 1 / wavenumber), 600)
    previous = 0.0
    for number in numbers:
        if growth(float(number)) > 0:
            return float(brentq(growth, previous, float(number), xtol=1e-10))
        previous = float(number)
    return math.inf
