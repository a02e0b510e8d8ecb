"""What the edges of the velocity window do to exact steps of operator (6), and how long a step they allow.

What would leave the window within a step stays where it was (operators/velocity/kernel.py). A slow particle that would have left
it at the top stays slow: but operator (6) amplifies the slow, by exp(-Rτv) before the kernel and as much after it, R = Sρ (the
exact step of operators/linearised, τ as in operators/linear.py). In a long step that may be more than what the step makes of the
homogeneous state, and then whatever is there, if only rounding, grows from step to step until it is all of f.

Both factors are known. What stays at v is multiplied by

    μ(v) = P(v is above the window after h) exp(-2Rτv),

and a Maxwellian of mean u and variance θ by

    λ = E exp(-Rτ(V + V')) = exp(-Rτ(u + u') + R²τ²[θ(1 + e)² + s²]/2),    u' = m + ue,

V and V' = m + Ve + noise of variance s² the velocities before and after the kernel, e = exp(-γh).
Tests: tests/convergence/test_edges.py: for the homogeneous state ln(μ/λ) is that of the step's largest eigenvalue.
"""

from __future__ import annotations

import math

from kinetic_solver.plan.scales import Scales
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import half_transport_time, transition

STAYS = math.log(0.1)
"""ln of the largest μ/λ. Chosen: what stays where it should not is forgotten within a few steps."""
LOOKED_AT = 32
"""Velocities at which μ is looked at. Chosen: it varies slowly."""
TRIED = 40
"""Lengths of a step that are tried, from the longest down. Chosen."""
FASTER = 2.0
"""Standard deviations above the mean up to which f is looked at for what leaves the window. Chosen: what is faster leaves it in
truth, too, or is slowed down."""


def longest_bounded_step(scales: Scales, low: float, high: float, farthest: float) -> float:
    """The longest step, at most `farthest`, that is bounded in the window (low, high)."""
    lengths = [farthest * (TRIED - n) / TRIED for n in range(TRIED)]
    return next((h for h in lengths if bounded(scales, low, high, h)), lengths[-1])


def bounded(scales: Scales, low: float, high: float, h: float) -> bool:
    """Whether nothing that stays in the window outgrows the homogeneous state of the largest density in steps of h; true where
    there is no friction or no noise, or no operator (6)."""
    model, growth = scales.scene.model, scales.cross_section * scales.rho_max
    return not (scales.amplifies and model.friction * model.noise > 0) or outgrows(model, growth, low, high, h) < STAYS


def outgrows(model: Model, growth: float, low: float, high: float, h: float) -> float:
    """The largest ln(μ/λ) of velocities below the mean of the homogeneous state; `growth` is Sρ [1/length]."""
    mean = (model.gravity - growth * model.noise) / model.friction
    stays = max(value for _, value in _stays(model, growth, low, mean, high, h))
    return stays - _gain(model, growth, h, mean, model.noise)


def stays_slow(model: Model, growth: float, window: tuple[float, float], h: float, mean: float, temperature: float) -> float:
    """What an exact step h puts where it would not be without the window's upper edge, over the largest f, of a Maxwellian."""
    low, high = window
    looked = _stays(model, growth, low, mean + FASTER * math.sqrt(temperature), high, h)
    largest = max(value - (v - mean) ** 2 / (2 * temperature) for v, value in looked)
    return math.exp(min(0.0, largest - _gain(model, growth, h, mean, temperature)))


def _stays(model: Model, growth: float, low: float, fastest: float, high: float, h: float) -> list[tuple[float, float]]:
    """(v, ln μ) from the window's lower edge up."""
    step, tau = transition(model, h), half_transport_time(model.friction, h)
    spread, found = math.sqrt(2 * step.velocity_variance), []
    for n in range(LOOKED_AT):
        v = low + (fastest - low) * n / LOOKED_AT
        leaving = math.erfc((high - step.velocity_shift - v * step.decay) / spread) / 2
        found.append((v, math.log(leaving) - 2 * growth * tau * v if leaving > 0 else -math.inf))
    return found


def _gain(model: Model, growth: float, h: float, mean: float, temperature: float) -> float:
    """ln λ."""
    step, tau = transition(model, h), half_transport_time(model.friction, h)
    both = mean + step.velocity_shift + mean * step.decay
    variance = temperature * (1 + step.decay) ** 2 + step.velocity_variance
    return -growth * tau * both + (growth * tau) ** 2 / 2 * variance
