"""What sums over velocity points make of the kernel of an exact step of (6), wave by wave along x.

A step is transport by τ, the Ornstein-Uhlenbeck kernel of variance s², transport by τ (operators/linear.py); e = exp(-γh). The
first transport gives the wave exp(ikx) of a Gaussian of variance θ a wave exp(-ikτv), and the kernel, seen from where it ends, is
a Gaussian of variance s²/e² in the velocity where it begins. Their product is a Gaussian of variance

    V = 1/(1/θ + e²/s²)

with that wave. A sum of it over points of spacing dv, Q = 2π/dv, differs from its integral over v, relative to the product of the
Gaussians alone, by exp(-V(Q - kτ)²/2): transport brings waves near to Q, and of a narrow f, or of a narrow kernel, it takes more
points. What noise still does to the wave after the kernel, exp(-k²(σ/γ)(h - 2τ)), it does to this as well. A step that begins
later begins with the waves exp(-ikCv/θ) into which free motion has turned the start's, θ and C then the variance of v and its
covariance with the displacement. What a step makes so, the kernel of the next one takes away: steps do not add up.

The error is relative to the Gaussian of the homogeneous part everywhere: (6) does not amplify it in the slow tail.
In the local gauge (operators/linearised/grid.py) there are two kernels of half a step.
Tests: tests/convergence/test_kernel_sums.py.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.operators.linear import FADED
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import DROPPED, Waves
from kinetic_solver.theory.ornstein_uhlenbeck import (
    bridge_variance,
    excess_displacement,
    half_transport_time,
    spreads,
    transition,
    transport_times,
)

SHARE = 20.0
"""An error of rtol over this is allowed. Chosen."""
LINKS = 12
"""Beginnings of steps that are looked at, of more links of a chain. Chosen: from link to link little changes."""
MOST_WAVES = 400
"""Likewise of more waves along x."""


@dataclass(frozen=True)
class Sums:
    """Of a kernel, (beginnings, waves)."""

    wave: Array
    """In v, of what the kernel acts on."""
    broad: Array
    """The variance of what it acts on, (beginnings, 1)."""
    variance: Array
    """V, likewise."""
    lost: Array
    """By the exponential of which noise makes it smaller."""


def links(scales: Scales, h: float) -> Array:
    """When steps of a chain begin."""
    count = max(1, round(scales.end / h))
    return h * np.unique(np.linspace(0.0, float(count - 1), min(count, LINKS)).round())


def largest_spacing(scales: Scales, waves: Waves, begun: Array, h: float) -> float:
    """The largest dv of which a step h is that accurate, whenever it begins."""
    k, digits = _thinned(waves)
    most, kernels = 0.0, 2 if waves.local_gauge else 1
    for sums in itertools.chain(*before_kernels(scales, waves, k, begun, h)):
        room = 2 * np.maximum(0.0, digits + math.log(2 * SHARE * kernels / DROPPED) - sums.lost)
        needed = np.where(room > 0, sums.wave + np.sqrt(room / sums.variance), 0.0)
        most = max(most, float(needed.max()))
    return 2 * math.pi / most if most > 0 else math.inf


def error(scales: Scales, waves: Waves, dv: float, begun: Array, h: float, together: bool = False) -> float:
    """Of f over max f, that points of this spacing make of a step h: of the worst wave, or of all together, and of the step that
    begins worst."""
    k, digits = _thinned(waves)
    found = 0.0
    for kernels in before_kernels(scales, waves, k, begun, h):
        left = np.zeros((begun.size, k.size))
        for sums in kernels:
            apart = np.maximum(0.0, 2 * math.pi / dv - sums.wave)
            left += np.exp(digits - sums.lost - sums.variance * apart**2 / 2)
        found = max(found, float((left.sum(axis=1) if together else left).max()))
    return 2 * scales.rtol / DROPPED * found


def good(scales: Scales, waves: Waves, dv: float, begun: Array, h: float) -> bool:
    """Whether points of this spacing do for a step h."""
    return error(scales, waves, dv, begun, h) <= scales.rtol / SHARE * (1 + 1e-9)


def before_kernels(scales: Scales, waves: Waves, k: Array, begun: Array, h: float) -> Iterator[tuple[Sums, ...]]:
    """Of waves k of the coldest and of the hottest Gaussian of the start: those of one or of two kernels."""
    model = scales.scene.model
    for theta in {scales.narrowest, float(scales.temperature.max())}:
        broad, covariance, displaced = np.full((begun.size, 1), theta), np.zeros((begun.size, 1)), np.zeros((begun.size, 1))
        if (later := begun > 0).any():
            e, b, s2, c, r = (part[:, None] for part in spreads(model, begun[later]))
            broad[later], covariance[later], displaced[later] = theta * e * e + s2, theta * b * e + c, theta * b * b + r
        wave = k * covariance / broad
        lost = k**2 * np.maximum(0.0, displaced - covariance**2 / broad) / 2
        if waves.local_gauge:
            yield _two_kernels(scales, wave, broad, lost, k, h)
        else:
            step = transition(model, h)
            after = model.noise / model.friction * excess_displacement(model.friction, h)
            faded = np.where(k**2 * bridge_variance(model, h) / 2 > FADED, math.inf, 0.0)
            moved = wave + k * half_transport_time(model.friction, h)
            seen = step.velocity_variance / step.decay**2
            yield (Sums(moved, broad, _together(broad, seen), lost + k**2 * after + faded),)


def _two_kernels(scales: Scales, wave: Array, broad: Array, lost: Array, k: Array, h: float) -> tuple[Sums, Sums]:
    """Of what is before a step in the local gauge: transport by a, kernel, transport by b, kernel."""
    model = scales.scene.model
    half, (a, b) = transition(model, h / 2), transport_times(model.friction, h)
    seen = half.velocity_variance / half.decay**2
    wave, first = wave + k * a, _together(broad, seen)
    after = broad * half.decay**2 + half.velocity_variance
    second, left = _together(after, seen), broad * half.decay / after
    # What the first sum is off by is a wave left·(Q - q) - kb for the second kernel, which leaves little of it where f is broad.
    damped = second * left**2
    part = damped / (first + damped)
    return (
        Sums(wave + part * k * b / left, broad, first + damped, lost + first * part * (k * b / left) ** 2 / 2),
        Sums(wave * left + k * b, after, second, lost + first * wave**2 / 2),
    )


def _thinned(waves: Waves) -> tuple[Array, Array]:
    k, digits = waves.in_play
    if k.size <= MOST_WAVES:
        return k, digits
    some = np.linspace(0, k.size - 1, MOST_WAVES).round().astype(int)
    return k[some], digits[some]


def _together(variance: Array, of_kernel: float) -> Array:
    return np.asarray(variance * of_kernel / (variance + of_kernel))
