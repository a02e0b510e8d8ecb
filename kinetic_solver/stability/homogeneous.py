"""Homogeneous stationary states.

For (6) and without collisions the state is a Gaussian in closed form. For (12) it is not Gaussian and is solved for
(stability/inelastic.py): up to the velocity scale √σ it depends on ε and the collision number R* alone.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.inelastic import inelastic_flow, rough_temperature


@dataclass(frozen=True)
class HomogeneousState:
    """Of a scene at its mean density, in the scene's units."""

    mean_velocity: float
    """u_h."""
    temperature: float
    """θ_h, the velocity variance."""
    kurtosis_excess: float
    """a2 = ⟨w⁴⟩/(3θ²) - 1, w = v - u_h; 0 for a Gaussian."""
    collision_rate: float
    """S ρ⟨|v - v'|⟩ per particle."""


def homogeneous_state(scene: Scene) -> HomogeneousState | None:
    """The stationary state at the scene's mean density; None without both friction and noise: then there is none.

    (6): exactly Gaussian, θ_h = σ, u_h = (g - Sρσ)/γ. (12): solved by Newton's method, at any ε and R*, θ_h to 1e-9
    (tests/exact/test_homogeneous.py).
    """
    g, gamma, sigma = scene.model.gravity, scene.model.friction, scene.model.noise
    if gamma * sigma == 0:
        return None
    rate = scene.cross_section * scene.initial.density
    law = scene.law
    if isinstance(law, Inelastic):
        theta, a2, distance = _inelastic(law.restitution, rate * math.sqrt(sigma) / gamma)
        return HomogeneousState(g / gamma, theta * sigma, a2, rate * distance * math.sqrt(sigma))
    drag = rate * sigma if law is not None else 0.0
    return HomogeneousState((g - drag) / gamma, sigma, 0.0, rate * 2 * math.sqrt(sigma / math.pi))


def rough_temperature_at(scene: Scene, density: float) -> float | None:
    """θ_h at another mean density, to 1e-7 of it; None as above."""
    gamma, sigma, law = scene.model.friction, scene.model.noise, scene.law
    if gamma * sigma == 0 or not isinstance(law, Inelastic) or density == scene.initial.density:
        state = homogeneous_state(scene)
        return None if state is None else state.temperature
    return sigma * rough_temperature(law.restitution, scene.cross_section * density * math.sqrt(sigma) / gamma)


@functools.lru_cache(maxsize=256)
def _inelastic(restitution: float, collision_number: float) -> tuple[float, float, float]:
    """(θ, a2, ⟨|v - v'|⟩) of 0 = ∂(wf + ∂f) + R* C[f], γ = σ = S = ρ = 1, from its values on points."""
    flow = inelastic_flow(restitution, collision_number)
    w, f, dw = flow.homogeneous
    theta = float(w**2 @ f) * dw
    kurtosis = float(w**4 @ f) * dw / (3 * theta**2) - 1
    return theta, kurtosis, flow.mean_distance


def pressure_slope(restitution: float, collision_number: float) -> float:
    """d(ρθ_h)/dρ of (12) over σ, to 1e-6: differences of order 4 in ln ρ, on which θ_h depends through R* alone."""

    def pressure(change: float) -> float:
        return (1 + change) * inelastic_flow(restitution, collision_number * (1 + change)).temperature

    h = 0.01
    return (8 * (pressure(h) - pressure(-h)) - (pressure(2 * h) - pressure(-2 * h))) / (12 * h)
