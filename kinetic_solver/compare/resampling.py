"""Fields brought from their own points to others, and how much of them lies in waves that fewer points cannot hold."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from kinetic_solver.arrays import Array


def waves_of(values: Array, nx: int) -> Array:
    """At nx points along the last axis, of the waves that these can hold; the Nyquist wave of an even nx is left out."""
    modes = np.fft.rfft(values, axis=-1, norm="forward")
    return np.asarray(np.fft.irfft(modes[..., : (nx - 1) // 2 + 1], n=nx, axis=-1, norm="forward"))


def at_points(values: Array, nx: int) -> Array:
    """At nx points along the last axis, of all waves: the trigonometric interpolant."""
    own = values.shape[-1]
    if own == nx:
        return values
    modes = np.fft.rfft(values, axis=-1, norm="forward")
    weight = np.full(modes.shape[-1], 2.0)
    weight[0] = 1.0
    if own % 2 == 0:
        weight[-1] = 1.0
    waves = np.exp(2j * np.pi * np.outer(np.arange(weight.size), np.arange(nx)) / nx)
    return np.asarray(((weight * modes) @ waves).real)


def over_v(own: Array, values: Array, v: Array) -> Array:
    """Values (…, len(own)) at the velocities v within `own`, by a quintic spline."""
    if own.size == v.size and np.allclose(own, v, rtol=0, atol=1e-12 * np.abs(own).max()):
        return values
    return np.asarray(make_interp_spline(own, values, k=5, axis=-1)(v))


def shortest_waves(values: Array) -> float:
    """The highest eighth of the waves of values (nx, nv): the sum of their largest amplitudes over v, over the largest value."""
    size = np.abs(np.fft.rfft(values, axis=0, norm="forward")).max(axis=1)
    largest = np.abs(values).max()
    return float(2 * size[-(size.size // 8) :].sum() / largest) if size.size >= 8 and largest > 0 else 0.0
