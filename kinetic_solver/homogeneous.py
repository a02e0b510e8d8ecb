"""Homogeneous stationary states, and the state that a scene starts from.

For (6) and without collisions the state is a Gaussian in closed form. For (12) it is not Gaussian and is solved for: up to
the velocity scale √σ it depends on ε and the collision number R* alone.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene import INELASTIC, Scene, SceneError
from kinetic_solver.threads import one_blas_thread


@dataclass(frozen=True)
class HomogeneousState:
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

    (6): exactly Gaussian, θ_h = σ, u_h = (g - Sρσ)/γ. (12): solved by Newton's method, θ_h to 1e-9
    (tests/exact/test_homogeneous.py); raises SceneError should that not converge, as at R* = 1e7.
    """
    g, gamma, sigma = scene.model.gravity, scene.model.friction, scene.model.noise
    if gamma * sigma == 0:
        return None
    rate = scene.cross_section * scene.initial.density
    if scene.operator == INELASTIC:
        with one_blas_thread():
            theta, a2, distance = _inelastic(scene.restitution, rate * math.sqrt(sigma) / gamma)
        return HomogeneousState(g / gamma, theta * sigma, a2, rate * distance * math.sqrt(sigma))
    drag = rate * sigma if scene.operator else 0.0
    return HomogeneousState((g - drag) / gamma, sigma, 0.0, rate * 2 * math.sqrt(sigma / math.pi))


def start_state(scene: Scene) -> tuple[float, float]:
    """(u0, θ0): the scene's own where given, else the homogeneous state's.

    Where that does not exist, the mean velocity is g/γ (0 for γ = 0), and the temperature σ (1 for σ = 0).
    """
    start, model = scene.initial, scene.model
    u0, theta0 = start.mean_velocity, start.temperature
    if u0 is None and theta0 is not None and scene.operator == INELASTIC and model.friction * model.noise > 0:
        u0 = model.gravity / model.friction  # known without solving for the temperature
    if u0 is None or theta0 is None:
        state = homogeneous_state(scene)
        if state is None:
            terminal = model.gravity / model.friction if model.friction > 0 else 0.0
            state = HomogeneousState(terminal, model.noise if model.noise > 0 else 1.0, 0.0, 0.0)
        u0 = state.mean_velocity if u0 is None else u0
        theta0 = state.temperature if theta0 is None else theta0
    return u0, theta0


@functools.lru_cache(maxsize=256)
def _inelastic(restitution: float, collision_number: float) -> tuple[float, float, float]:
    """(θ, a2, ⟨|v - v'|⟩) of 0 = ∂(vf + ∂f) + R* C[f], γ = σ = S = ρ = 1.

    Velocity points in a periodic window, derivatives by the discrete Fourier transform, C with the quintic deposit.
    """
    from kinetic_solver.collisions import Inelastic

    guess = _closure_temperature(restitution, collision_number)
    # The far tail falls as exp(-v²/2 - R*|v|), slower than the core's Gaussian; the window takes in both.
    digits = 36.0
    tail = math.sqrt(collision_number**2 + 2 * digits) - collision_number
    reach = max(math.sqrt(2 * digits * guess), tail)
    nv = 2 * math.ceil(reach / math.sqrt(guess) * 14)
    dv = 2 * reach / nv
    v = dv * (np.arange(nv) + 0.5) - reach
    operator = Inelastic(v, collision_number, restitution, "quintic")
    derivative = _derivative(nv, dv)
    linear = derivative @ (np.diag(v) + derivative)
    f = np.exp(-(v**2) / (2 * guess)) / math.sqrt(2 * math.pi * guess)
    unit = np.eye(nv)
    for _ in range(60):
        residual = linear @ f + operator.rate(f[None])[0]
        # C is quadratic: [C(f + e) - C(f - e)]/2 is its exact derivative along e.
        jacobian = linear + (operator.rate(f + unit) - operator.rate(f - unit)).T / 2
        # The equations sum to zero (mass); ∫f = 1 takes their place, added to each so that the matrix stays regular.
        step = np.linalg.solve(jacobian + dv, -residual + (1 - f.sum() * dv))
        f = f + step
        if np.abs(step).max() < 1e-12 * f.max():
            break
    else:
        raise SceneError(
            f"collisions: the homogeneous state at restitution {restitution:g}, R* = {collision_number:.3g} is out of reach; "
            "allowed: a given initial.temperature, or a smaller R*"
        )
    theta = float(v**2 @ f) * dv
    kurtosis = float(v**4 @ f) * dv / (3 * theta**2) - 1
    distance = float(f @ np.abs(v[:, None] - v[None, :]) @ f) * dv**2
    # The kink of |v - v'| at 0 costs the plain sum dv²/6 ∫f²; the next correction is O(dv⁴).
    return theta, kurtosis, distance + dv**2 / 6 * float(f @ f) * dv


def _closure_temperature(restitution: float, collision_number: float) -> float:
    """θ of the three-moment closure, (θ - 1) + Cθ^{3/2} = 0, C = R*(1 - ε²)/√π: a first guess."""
    from scipy.optimize import brentq

    c = collision_number * (1 - restitution**2) / math.sqrt(math.pi)
    return float(brentq(lambda theta: theta - 1 + c * theta**1.5, 0.0, 1.0))


def _derivative(nv: int, dv: float) -> Array:
    """The Fourier differentiation matrix on nv (even) periodic points."""
    k = 2 * np.pi * np.fft.rfftfreq(nv, dv)
    k[-1] = 0.0
    return np.fft.irfft(1j * k[:, None] * np.fft.rfft(np.eye(nv), axis=0), n=nv, axis=0)
