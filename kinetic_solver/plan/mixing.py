"""How finely free motion folds waves along x in v, before noise damps them."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition


def mixing(model: Model, k: Array, digits: Array, theta: float, left: float, first: float | None = None) -> float:
    """The largest v-wavenumber at which free motion still leaves more than the dropped amplitude of waves k in x, within a time.

    A gas of temperature θ has waves of amplitude e^digits times the dropped one. f's joint characteristic function is Gaussian:
    at x-wavenumber k it has its peak at q = -kC/V with amplitude exp(-k²(D - C²/V)/2) and width V^(-1/2), where V, C, D are the
    variances and the covariance of velocity and displacement. `first` is the earliest time that is looked at.
    """
    worst = 0.0
    times = np.linspace(0, left, 65)[1:]
    if first is not None and first < times[0]:
        times = np.concatenate([np.geomspace(first, times[0], 33), times])
    for t in times:
        step = transition(model, float(t))
        e, b = step.decay, step.drift_time
        variance = theta * e * e + step.velocity_variance
        if variance == 0:
            continue
        covariance = theta * b * e + step.covariance
        rest = theta * b * b + step.displacement_variance - covariance**2 / variance
        room = 2 * (digits - k**2 * rest / 2)
        alive = room > 0
        q = k[alive] * covariance / variance + np.sqrt(room[alive] / variance)
        worst = max(worst, float(q.max(initial=0.0)))
    return worst
