"""What the points in v make of the kernel of an exact step of (6), which is to be accurate relative to f."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.solver.observation import Observation
from kinetic_solver.theory.ornstein_uhlenbeck import transition


@dataclass(frozen=True)
class Spectrum:
    """Of f in v."""

    wavenumbers: Array
    amplitude: Array
    """Of the largest."""


def spectrum_of(seen: Observation) -> Spectrum:
    q = 2 * np.pi / (seen.grid.high - seen.grid.low) * np.arange(seen.waves_in_v.size)
    return Spectrum(q, seen.waves_in_v)


def kernel_error(seen: Observation, start: Spectrum) -> float:
    """Of the step to this state, over max f: a sum over points, of spacing dv, of the kernel times f counts the waves q of f
    together with the kernel's Q - q, Q = 2π/dv, which its variance s² leaves exp(-s²(Q - q)²/2). f is that of the last link of
    the chain (stepping/exact_steps.py): the start, or much as it is now."""
    plan, model = seen.plan, seen.plan.inner.model
    exact = seen.scheme.exact and plan.law is not None and plan.velocity == "points" and plan.drift_diffusion == "kernel"
    if not exact or model.friction * model.noise == 0 or seen.clock < plan.shortest_step:
        return 0.0  # before the shortest step f is found on finer points
    link = math.inf if plan.time_step is None else plan.time_step
    h = min(seen.clock, link)
    variance = transition(model, h / 2 if plan.waves.local_gauge else h).velocity_variance
    of = start if seen.clock <= link else spectrum_of(seen)
    apart = np.maximum(0.0, 2 * np.pi / seen.grid.dv - of.wavenumbers)
    return float(2 * (of.amplitude * np.exp(-variance * apart**2 / 2)).max())
