"""What the points in v make of the kernel of an exact step of (6), which is to be accurate relative to f."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.plan import kernel_sums
from kinetic_solver.solver.observation import Observation
from kinetic_solver.stepping import ExactSteps
from kinetic_solver.theory.ornstein_uhlenbeck import half_transport_time, transition


@dataclass(frozen=True)
class Spectrum:
    """Of f: amplitudes over the largest, of waves in x and in v."""

    of_x: Array
    of_v: Array


def spectrum_of(seen: Observation) -> Spectrum:
    return Spectrum(seen.waves_in_x, seen.waves_in_v)


def kernel_error(seen: Observation, start: Spectrum) -> float:
    """Of the step to this state, over max f (plan/kernel_sums.py)."""
    plan, model, steps = seen.plan, seen.plan.inner.model, seen.scheme.stepper
    exact = isinstance(steps, ExactSteps) and plan.scales.amplifies and plan.velocity == "points"
    if not exact or plan.drift_diffusion != "kernel" or model.friction * model.noise == 0 or seen.clock < plan.shortest_step:
        return 0.0  # before the shortest step f is found on finer points
    assert isinstance(steps, ExactSteps)
    begun = steps.begins(seen.clock)
    h = seen.clock - begun
    if plan.scene.initial.file is None:
        return kernel_sums.error(plan.scales, plan.waves, seen.grid.dv, np.array([begun]), h, together=True)
    return _of_spectra(seen, start if begun == 0 else spectrum_of(seen), h / 2 if plan.waves.local_gauge else h)


def _of_spectra(seen: Observation, of: Spectrum, h: float) -> float:
    """Of a step from a start that plans do not know: a wave exp(ikx + iqv) is no larger than both of its amplitudes. Later steps
    begin with much the same spectra as they end with."""
    model, grid = seen.plan.inner.model, seen.grid
    step, tau = transition(model, h), half_transport_time(model.friction, h)
    q = 2 * np.pi / (grid.high - grid.low) * np.arange(of.of_v.size)
    apart = np.maximum(0.0, 2 * np.pi / grid.dv - q - tau * grid.wavenumbers[: of.of_x.size, None])
    amplitude = np.minimum(of.of_v, of.of_x[:, None])
    return float(2 * (amplitude * np.exp(-step.velocity_variance / step.decay**2 * apart**2 / 2)).max())
