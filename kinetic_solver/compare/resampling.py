"""Fields brought from their own points to others, and how much of them lies in waves that fewer points cannot hold."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.interpolation import through_splines, through_waves


def waves_of(values: Array, nx: int) -> Array:
    """At nx points along the last axis, of the waves that these can hold; the Nyquist wave of an even nx is left out."""
    modes = np.fft.rfft(values, axis=-1, norm="forward")
    return np.asarray(np.fft.irfft(modes[..., : (nx - 1) // 2 + 1], n=nx, axis=-1, norm="forward"))


def at_points(values: Array, nx: int) -> Array:
    """At nx points along the last axis, of all waves: the trigonometric interpolant."""
    own = values.shape[-1]
    if own == nx:
        return values
    return np.asarray(values @ through_waves(np.arange(own) / own, np.arange(nx) / nx, 1.0).T)


def over_v(own: Array, values: Array, v: Array) -> Array:
    """Values (…, len(own)) at the velocities v within `own`, by a quintic spline."""
    if own.size == v.size and np.allclose(own, v, rtol=0, atol=1e-12 * np.abs(own).max()):
        return values
    return np.asarray(values @ through_splines(own, v).T)


def shortest_waves(values: Array) -> float:
    """The highest eighth of the waves of values (nx, nv): the sum of their largest amplitudes over v, over the largest value."""
    size = np.abs(np.fft.rfft(values, axis=0, norm="forward")).max(axis=1)
    largest = np.abs(values).max()
    return float(2 * size[-(size.size // 8) :].sum() / largest) if size.size >= 8 and largest > 0 else 0.0
