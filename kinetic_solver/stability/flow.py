"""The homogeneous flow of a scene, about which everything here is linear: its groups, and which theory describes it."""

from __future__ import annotations

import math
from typing import Protocol

from kinetic_solver.arrays import Array
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.follow_leader import FollowLeaderFlow
from kinetic_solver.stability.hermite import HermiteEquations
from kinetic_solver.stability.inelastic import inelastic_flow
from kinetic_solver.stability.units import Complex, Units, stationary


class Flow(Protocol):
    """Linear theory about a homogeneous state at rest: γ = σ = 1, waves exp(ikx + st), k = k*, velocities w = (v - u_h)/√σ."""

    @property
    def temperature(self) -> float:
        """θ_h/σ."""

    def rates(self, wavenumber: float, count: int) -> tuple[Complex, Array]:
        """The `count` leading s, by falling growth rate, and how far each is uncertain."""

    def distribution(self, w: Array) -> Array:
        """f_h(w), ∫f_h dw = 1."""

    def eigenfunction(self, wavenumber: float, branch: int, w: Array) -> Complex:
        """δf(w) of a branch, ∫δf dw = 1: of unit relative density."""

    def equations(self, wavenumber: float) -> HermiteEquations:
        """In Hermite functions, enough of them for waves of this length."""

    def density_gain(self, wavenumber: float, times: Array) -> Array:
        """max |∫δf(t) dw|² over all δf(0) with ∫|δf(0)|²/M dw = 1, M the Maxwellian of temperature θ_h."""

    def structure_factor(self, wavenumber: float) -> float:
        """S(k)."""


def flow_of(scene: Scene) -> tuple[Flow, Units]:
    """The theory for a scene's operator at its mean density. Raises SceneError where there is no stationary state."""
    stationary(scene)
    g, gamma, sigma = scene.model.gravity, scene.model.friction, scene.model.noise
    number = scene.groups.collision_number
    law = scene.law
    if isinstance(law, Inelastic):
        return inelastic_flow(law.restitution, number), Units(gamma, sigma, g / gamma)
    number = number if law is not None else 0.0
    return FollowLeaderFlow(number), Units(gamma, sigma, g / gamma - number * math.sqrt(sigma))
