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

from kinetic_solver.scene import Model
from particles.random import LANGEVIN, normal, words


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


@numba.njit(inline="always")
def moved(x, v, length, coefficients, index, step, k0, k1):  # type: ignore[no-untyped-def]
    """(x, v) of one particle after the step, with the two deviates of counter `index`."""
    x_velocity, x_constant, x_noise_of_v, x_noise, v_velocity, v_constant, v_noise = coefficients
    a, b, c, d = words(LANGEVIN, index, step, 0, k0, k1)
    first = normal(a, b, LANGEVIN, index, step, 0, k0, k1)
    second = normal(c, d, LANGEVIN, index, step, 1, k0, k1)
    place = x + x_velocity * v + x_constant + x_noise_of_v * first + x_noise * second
    return wrapped(place, length), v_velocity * v + v_constant + v_noise * first


@numba.njit(parallel=True, cache=True)
def advance(x, v, length, coefficients, step, k0, k1):  # type: ignore[no-untyped-def]
    """x, v (n,) in place over one step, x kept in [0, length). Particle i takes counter i's deviates, whatever the threads."""
    for i in numba.prange(x.size):
        x[i], v[i] = moved(x[i], v[i], length, coefficients, i, step, k0, k1)


@numba.njit(inline="always")
def wrapped(x, length):  # type: ignore[no-untyped-def]
    """x in [0, length). Within one period of it, by a comparison; rounding just below 0 or to `length` becomes 0."""
    if x < 0.0 or x >= length:
        x -= length * math.floor(x / length)
        if x < 0.0 or x >= length:
            x = 0.0
    return x
