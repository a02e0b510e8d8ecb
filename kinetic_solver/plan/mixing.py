"""How finely free motion folds waves along x in v, before noise damps them."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import spreads


def mixing(model: Model, k: Array, digits: Array, theta: float, left: float, first: float | None = None) -> float:
    """The largest v-wavenumber at which free motion still leaves more than the dropped amplitude of waves k in x, within a time.

    A gas of temperature θ has waves of amplitude e^digits times the dropped one. f's joint characteristic function is Gaussian:
    at x-wavenumber k it has its peak at q = -kC/V with amplitude exp(-k²(D - C²/V)/2) and width V^(-1/2), where V, C, D are the
    variances and the covariance of velocity and displacement. `first` is the earliest time that is looked at.
    """
    times = np.linspace(0, left, 65)[1:]
    if first is not None and first < times[0]:
        times = np.concatenate([np.geomspace(first, times[0], 33), times])
    e, b, s2, c, r = np.array(spreads(model, times))[:, :, None]
    variance = theta * e * e + s2
    covariance = theta * b * e + c
    with np.errstate(divide="ignore", invalid="ignore"):  # what has no variance of velocity does not mix
        rest = theta * b * b + r - covariance**2 / variance
        room = 2 * (digits - k**2 * rest / 2)
        q = k * covariance / variance + np.sqrt(room / variance)
    return float(q.max(initial=0.0, where=(variance > 0) & (room > 0)))
