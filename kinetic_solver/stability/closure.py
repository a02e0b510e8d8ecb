"""The paper's three-moment closure (3)-(5), linearised about the homogeneous state.

Its critical density is a property of the closure. The kinetic equation (2) with operator (6) that it closes is
linearly stable at every density (docs/theory.md, "Linear stability"; tests/exact/test_stability.py).
"""

from __future__ import annotations

import math

from kinetic_solver.scene import FOLLOW_LEADER, Scene


def critical_density(scene: Scene, mode: int = 1) -> float:
    """ρ_c at which mode n (k = 2πn/L) of the closure (3)-(5) with operator (6) turns unstable; inf where it never does.

    From the marginal case s' = iω of the cubic
    s'³ + 3γs'² + (2γ² + 3k²σ - 3ikσSρ)s' + 2γ(k²σ - ikσSρ) = 0 (docs/theory.md):
    S ρ_c = ω(2γ² + 3k²σ - ω²)/(2γkσ), with ω² = [3k²σ + √(9k⁴σ² + (16/3)γ²k²σ)]/2.
    For k → ∞, R*_c = 7√3/9. inf for operator (12), whose closure is stable, and without collisions, friction or noise.
    Raises ValueError for mode < 1.
    """
    if mode < 1:
        raise ValueError(f"mode = {mode}: must be 1 or more")
    gamma, sigma = scene.model.friction, scene.model.noise
    if scene.operator != FOLLOW_LEADER or gamma * sigma == 0:
        return math.inf
    k = 2 * math.pi * mode / scene.pipe.length
    a = k * k * sigma
    w = (3 * a + math.sqrt(9 * a * a + 16 / 3 * gamma**2 * a)) / 2
    # 2γ² + 3a - w without the cancellation of 3a against w at large k: w - 3a = (4/3)γ²a/w.
    slope = 2 * gamma**2 - (4 / 3) * gamma**2 * a / w
    return math.sqrt(w) * slope / (2 * gamma * k * sigma * scene.cross_section)
