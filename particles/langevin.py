"""The Langevin equation (1) without collisions, exact over any step: dx = v dt, dv = (g - γv) dt + √(2σγ) dW.

x and v after h are jointly Gaussian (G. E. Uhlenbeck and L. S. Ornstein 1930; S. Chandrasekhar 1943). With e = exp(-γh), m = g/γ:
means x + mh + (v - m)(1 - e)/γ and m + (v - m)e; variance of v σ(1 - e²); of x given v (2σ/γ²)(γh - 2 tanh(γh/2));
x's mean moves by (1/γ) tanh(γh/2) times v's noise. γ = 0 is free fall, σ = 0 friction alone.
Tests: tests/cross_validation/particles/test_langevin.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Model
from particles.random import BLOCK, LANGEVIN, normals, scratch
from particles.threads import over_particles


@dataclass(frozen=True)
class LangevinStep:
    """Coefficients of x' = x + x_v v + x_0 + x_n n_v + x_m n_x and v' = v_v v + v_0 + v_n n_v, n standard normal deviates."""

    x_velocity: float
    x_constant: float
    x_noise_of_v: float
    x_noise: float
    v_velocity: float
    v_constant: float
    v_noise: float

    @classmethod
    def over(cls, model: Model, h: float) -> LangevinStep:
        """The step over the time h; every coefficient to round-off, for γh from 0 up."""
        g, gamma, sigma = model.gravity, model.friction, model.noise
        tau = gamma * h
        decayed = -math.expm1(-tau)  # 1 - e
        # (1 - e)/γ and the displacement by gravity, (γh - 1 + e)/γ²: both by their series where that cancels
        reach = h * _relative(tau, decayed)
        fall = h * h * _fall(tau)
        v_noise = math.sqrt(sigma * -math.expm1(-2 * tau))
        half = h / 2 * (math.tanh(tau / 2) / (tau / 2) if tau else 1.0)
        x_noise = h * math.sqrt(2 * sigma * tau * _excess(tau))
        return cls(reach, g * fall, half * v_noise, x_noise, math.exp(-tau), g * reach, v_noise)


def _relative(tau: float, decayed: float) -> float:
    """(1 - exp(-τ))/τ."""
    return decayed / tau if tau else 1.0


def _fall(tau: float) -> float:
    """(τ - 1 + exp(-τ))/τ²."""
    if tau > 0.5:
        return (1 + math.expm1(-tau) / tau) / tau
    return sum((-tau) ** n / math.factorial(n + 2) for n in range(16))


def _excess(tau: float) -> float:
    """(τ - 2 tanh(τ/2))/τ³."""
    if tau > 1.0:
        return (1 - 2 * math.tanh(tau / 2) / tau) / tau / tau
    # With u = τ/2, x = u²: tanh u = u/(1 + x/(3 + x/(5 + …))), so u - tanh u = u x/(3 + x/(5 + …) + x)
    x = tau * tau / 4
    fraction = 0.0
    for odd in range(25, 3, -2):
        fraction = x / (odd + fraction)
    return 1 / (4 * (3 + fraction + x))


@numba.njit
def move(x, v, length, coefficients, deviates):  # type: ignore[no-untyped-def]
    """x, v of at most BLOCK particles in place over one step, with these deviates, (2, BLOCK).

    x is kept in [0, length). Returns how many of the particles are no longer finite.
    """
    x_velocity, x_constant, x_noise_of_v, x_noise, v_velocity, v_constant, v_noise = coefficients
    lost = 0
    for j in range(x.size):
        n_v, n_x = deviates[0, j], deviates[1, j]
        place = wrapped(x[j] + x_velocity * v[j] + x_constant + x_noise_of_v * n_v + x_noise * n_x, length)
        velocity = v_velocity * v[j] + v_constant + v_noise * n_v
        lost += not (place >= 0.0 and abs(velocity) < np.inf)
        x[j], v[j] = place, velocity
    return lost


def advance(
    x: Array, v: Array, length: float, coefficients: tuple[float, ...], step: np.uint64, k0: np.uint64, k1: np.uint64
) -> int:
    """x, v (n,) in place over one step; particle i takes counter i's deviates, whatever the threads. Returns as `move` does."""
    lost: list[int] = []

    def of(part: slice) -> None:
        lost.append(_advance(x[part], v[part], length, coefficients, part.start, step, k0, k1))

    over_particles(of, x.size)
    return sum(lost)


@numba.njit(nogil=True, cache=True)
def _advance(x, v, length, coefficients, start, step, k0, k1):  # type: ignore[no-untyped-def]
    """Of the particles from `start` on."""
    bits, deviates = scratch()
    lost = 0
    for first in range(0, x.size, BLOCK):
        last = min(first + BLOCK, x.size)
        normals(deviates, bits, LANGEVIN, start + first, step, k0, k1)
        lost += move(x[first:last], v[first:last], length, coefficients, deviates)
    return lost


@numba.njit(inline="always")
def wrapped(x, length):  # type: ignore[no-untyped-def]
    """x in [0, length). Within one period of it, by a comparison; rounding just below 0 or to `length` becomes 0."""
    if x < 0.0 or x >= length:
        x -= length * math.floor(x / length)
        if x < 0.0 or x >= length:
            x = 0.0
    return x
