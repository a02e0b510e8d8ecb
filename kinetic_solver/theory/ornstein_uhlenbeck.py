"""The Ornstein-Uhlenbeck process of (1): exact statistics of velocity and displacement over a time h, for any γ, σ ≥ 0.

γ < 0 with σ = 0, an expansion of velocities, is what a cooling gas shows in scaled ones (plan/moving_frame.py).

With e = exp(-γh), a velocity v becomes V = m + (v - m) e + noise, m = g/γ, while the displacement X is
m h + (v - m)(1 - e)/γ + noise. The two noises are jointly Gaussian (Uhlenbeck and Ornstein 1930; Chandrasekhar 1943).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Model

TERMS = 18
"""Of the series for short times, a = γh ≤ 0.5: more than there are digits."""
OF_PHI2 = tuple((-1.0) ** n / math.factorial(n + 2) for n in range(TERMS))
"""Coefficients of a^n in (a - 1 + e^-a)/a²."""
OF_PSI = tuple((-1.0) ** n * (2.0 ** (n + 3) - 4.0) / math.factorial(n + 3) for n in range(TERMS))
"""Likewise in (2a - 3 + 4e^-a - e^-2a)/a³."""


class Transition(NamedTuple):
    """Statistics over one step h."""

    decay: float
    """e = exp(-γh)."""
    drift_time: float
    """b = (1 - e)/γ (h where γ = 0)."""
    velocity_shift: float
    """Mean of V for v = 0: g b."""
    displacement_shift: float
    """Mean of X for v = 0: g (h - b)/γ (g h²/2 where γ = 0)."""
    velocity_variance: float
    """s² = σ(1 - e²), of V's noise."""
    covariance: float
    """c = (σ/γ)(1 - e)², of the noises of V and X."""
    displacement_variance: float
    """r = (σ/γ²)(2γh - 3 + 4e - e²), of X's noise."""


def transition(model: Model, h: float) -> Transition:
    """The transition over h; full relative accuracy at any γh, 0 included (tests/exact/test_ornstein_uhlenbeck.py)."""
    g, gamma, sigma = model.gravity, model.friction, model.noise
    a = gamma * h
    e = math.exp(-a)
    b = h * phi1(a)
    return Transition(
        decay=e,
        drift_time=b,
        velocity_shift=g * b,
        displacement_shift=g * h * h * phi2(a),
        velocity_variance=-sigma * math.expm1(-2 * a),
        covariance=sigma * gamma * b * b,
        displacement_variance=sigma * gamma * h**3 * _psi(a) if sigma > 0 else 0.0,
    )


def bridge_variance(model: Model, h: float) -> float:
    """The variance of displacement over h that is left once the velocities at both ends are known: σγh³/6 for short times.

    A wave exp(ikx) is damped by exp(-k² bridge/2) at least, whatever it looks like in v.
    """
    step = transition(model, h)
    if step.velocity_variance == 0:
        return 0.0
    return max(0.0, step.displacement_variance - step.covariance**2 / step.velocity_variance)


def spreads(model: Model, h: Array) -> tuple[Array, Array, Array, Array, Array]:
    """(decay, drift time, variance of V, covariance, variance of X) of `transition`, of many times h > 0 at once, which planning
    asks for by the hundred."""
    gamma, sigma = model.friction, model.noise
    zero = np.zeros_like(h)
    if gamma == 0:
        return np.ones_like(h), h, zero, zero, zero
    a = gamma * h
    e, b = np.exp(-a), -np.expm1(-a) / gamma
    if sigma == 0:
        return e, b, zero, zero, zero
    late = np.maximum(a, 0.5)
    long = (2 * late + 4 * np.expm1(-late) - np.expm1(-2 * late)) / late**3
    short = np.polynomial.polynomial.polyval(np.minimum(a, 0.5), OF_PSI)
    return e, b, -sigma * np.expm1(-2 * a), sigma * gamma * b * b, sigma * gamma * h**3 * np.where(a > 0.5, long, short)


def bridge_variances(model: Model, h: Array) -> Array:
    """`bridge_variance` of many times h > 0 at once."""
    if model.friction * model.noise == 0:
        return np.zeros_like(h)
    _, _, of_velocity, covariance, of_displacement = spreads(model, h)
    return np.maximum(0.0, of_displacement - covariance * (covariance / of_velocity))


def half_transport_time(gamma: float, h: float) -> float:
    """τ = tanh(γh/2)/γ, the transport time on either side of the kernel in the exact linear step (operators/linear.py)."""
    a = gamma * h / 2
    return h / 2 * (math.tanh(a) / a if abs(a) > 1e-8 else 1 - a * a / 3)


def excess_displacement(gamma: float, h: float) -> float:
    """(γh - 2 tanh(γh/2))/γ = h - 2τ, without cancellation at small γh."""
    a = gamma * h
    if abs(a) > 0.2:
        return h - 2 * half_transport_time(gamma, h)
    z, total = a * a, 0.0
    # x - 2 tanh(x/2) = x³/12 - x⁵/120 + 17x⁷/20160 - 31x⁹/362880 + 691x¹¹/79833600 - …
    series = (1 / 12, -1 / 120, 17 / 20160, -31 / 362880, 691 / 79833600, -5461 / 6227020800, 929569 / 10461394944000)
    for coefficient in reversed(series):
        total = total * z + coefficient
    return h * z * total


def transport_times(gamma: float, h: float) -> tuple[float, float]:
    """(a, b): transport for a, Ornstein-Uhlenbeck for h/2, transport for b, Ornstein-Uhlenbeck for h/2, transport for a
    give displacement and velocity the joint Gaussian law of a whole step h, exactly (up to a uniform shift by gravity).

    Both are positive: a/h goes from (1 - 1/√3)/2 at γh = 0, where the kernels act at the Gauss-Legendre points of the step, to
    1/(γh). From the means, 2a cosh(γh/2) + b = 2 sinh(γh/2)/γ, and from the variance of the displacement.
    """
    x = gamma * h
    e, phi = math.exp(-x), phi1(x)
    ratio = _psi(x) / phi  # displacement variance over the velocity variance of half a step, over h²
    a = (phi - math.sqrt(e * ((1 + e) * ratio - phi**2))) / (1 + e)
    return a * h, math.sqrt((1 + e) * ratio - phi**2) * h


def phi1(a: float) -> float:
    """(1 - e^-a)/a."""
    return -math.expm1(-a) / a if a != 0 else 1.0


def phi2(a: float) -> float:
    """(a - 1 + e^-a)/a²."""
    return (a + math.expm1(-a)) / a**2 if abs(a) > 0.5 else _series(OF_PHI2, a)


def _psi(a: float) -> float:
    """(2a - 3 + 4e^-a - e^-2a)/a³: 2/3 at a = 0."""
    if a > 0.5:
        return (2 * a + 4 * math.expm1(-a) - math.expm1(-2 * a)) / a**3
    return _series(OF_PSI, a)


def _series(coefficients: tuple[float, ...], a: float) -> float:
    """Σ coefficients[n] a^n, for |a| ≤ 0.5."""
    total = 0.0
    for coefficient in reversed(coefficients):
        total = total * a + coefficient
    return total
