"""The closure (3)-(5) at one point: gravity, friction and noise in closed form, and what collisions do.

At fixed ρ gravity, friction and noise take u to the terminal velocity and θ to σ, linearly in U = (ρ, ρu, ½ρ(u² + θ)).
Collisions (6), by (8) and (9), exert the force -Sρθ per particle, which heats nobody: its work is the force times u. Collisions
(12), by (14) with its ρ² (docs/theory_details.md), exert none and cost the energy S(1 - ε²)/√π ρ²θ^{3/2} per length and time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.closure import closure_temperature


@dataclass(frozen=True)
class Gas:
    """Coefficients of a scene, so divided that in the homogeneous state the closed form and the rest vanish one by one.

    What collisions do in the homogeneous state is part of the closed form: there a step changes nothing but the last digit.
    """

    gravity: float
    """g, less what (6) does in the homogeneous state."""
    friction: float
    noise: float
    """σ, or, with (12), the temperature of the closure's homogeneous state."""
    drag: float
    """S of (6)."""
    usual_drag: float
    """Sρ̄σ."""
    cooling: float
    """C = S(1 - ε²)/√π of (12)."""
    usual_cooling: float
    """Cρ̄θ^{3/2} of the homogeneous state."""

    @classmethod
    def of(cls, scene: Scene) -> Gas:
        g, gamma, sigma = scene.model.gravity, scene.model.friction, scene.model.noise
        s, steady = scene.cross_section, scene.model.friction * scene.model.noise > 0
        law = scene.law
        if isinstance(law, Inelastic):
            c = s * (1 - scene.restitution**2) / math.sqrt(math.pi)
            theta = closure_temperature(gamma, sigma, c * scene.initial.density) if steady else sigma
            usual = gamma * (sigma - theta) if steady else 0.0
            return cls(g, gamma, theta, 0.0, 0.0, c, usual)
        s = s if law is not None else 0.0
        usual = s * scene.initial.density * sigma if steady else 0.0
        return cls(g - usual, gamma, sigma, s, usual, 0.0, 0.0)

    def relax(self, state: Array, time: float, frame: float) -> Array:
        """Gravity, friction and noise over a time, in a frame of velocity `frame`; exact, keeps ρ, and θ positive."""
        gamma, force = self.friction, self.gravity - self.friction * frame
        decay = math.exp(-gamma * time)
        gain = force * (-math.expm1(-gamma * time) / gamma if gamma > 0 else time)
        heat = -self.noise * math.expm1(-2 * gamma * time)
        rho, m, e = state
        return np.stack([rho, decay * m + gain * rho, decay * (decay * e + gain * m) + 0.5 * (gain * gain + heat) * rho])

    def drift(self, velocity: float, time: float) -> float:
        """How far gas of this mean velocity moves under gravity and friction."""
        if self.friction == 0:
            return velocity * time + 0.5 * self.gravity * time**2
        while_slowing = -math.expm1(-self.friction * time) / self.friction
        return velocity * while_slowing + self.gravity / self.friction * (time - while_slowing)


@numba.njit(cache=True)
def collide(state: Array, drag: float, usual_drag: float, cooling: float, usual_cooling: float, out: Array) -> None:
    """Add to out (3, n) what collisions do to `state` beyond what they do in the homogeneous state."""
    for i in range(state.shape[1]):
        rho, m = state[0, i], state[1, i]
        theta = (2 * state[2, i] - m * m / rho) / rho
        force = usual_drag - drag * rho * theta
        out[1, i] += rho * force
        out[2, i] += m * force - rho * (cooling * rho * theta**1.5 - usual_cooling)


@numba.njit(cache=True)
def fastest(state: Array, drag: float, usual_drag: float, cooling: float, usual_cooling: float) -> tuple[float, float]:
    """(largest |u| + c, largest rate at which collisions could use up the temperature); NaN where the state is unphysical.

    An Euler step of length h keeps θ positive while h times the rate is below 1: it changes θ by -h²b², b the force, and by
    -2h(Cρθ^{3/2} - …).
    """
    speed, rate = 0.0, 0.0
    for i in range(state.shape[1]):
        rho, m = state[0, i], state[1, i]
        p = 2 * state[2, i] - m * m / rho
        if not (rho > 0 and p > 0 and p < np.inf):
            return np.nan, np.nan
        theta = p / rho
        speed = max(speed, abs(m / rho) + math.sqrt(3 * theta))
        force = abs(usual_drag - drag * rho * theta)
        cooled = max(0.0, 2 * (cooling * rho * theta**1.5 - usual_cooling))
        rate = max(rate, force / math.sqrt(theta) + cooled / theta)
    return speed, rate
