"""Periodic functions from samples at uniform points: what is between the points, and how fast their waves fall off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array

Complex = NDArray[np.complex128]


def coefficients(values: Array) -> Complex:
    """c_k, k = 0 … n//2, along axis 0: values = Re(c_0 + 2Σ c_k exp(2πi k j/n)) at point j.

    Of an even number of points the last wave, which is seen as a cosine alone, is shared between k and -k.
    """
    n = values.shape[0]
    c = np.fft.rfft(values, axis=0) / n
    if n % 2 == 0 and n > 1:
        c[-1] /= 2
    return np.asarray(c)


def interpolated(c: Complex, places: Array, period: float) -> Array:
    """The periodic function of these coefficients, (k, …), at any places; shape (places, …)."""
    n, modes = places.size, c.shape[0]
    flat = c.reshape(modes, -1)
    if n > 2 * (modes - 1) and np.allclose(places, period * np.arange(n) / n, rtol=0.0, atol=1e-15 * period):
        return np.fft.irfft(flat * n, n=n, axis=0).reshape(n, *c.shape[1:])
    weight = np.where(np.arange(modes) == 0, 1.0, 2.0)
    phase = 2 * np.pi / period * places[:, None] * np.arange(modes)
    found = (weight * np.cos(phase)) @ flat.real - (weight * np.sin(phase)) @ flat.imag
    return np.asarray(found).reshape(n, *c.shape[1:])


def amplitudes(f: Array, axis: int) -> Array:
    """The largest amplitude of every wave along an axis of f (nx, nv), whatever the other index, over that of all waves."""
    size = np.abs(np.fft.rfft(f, axis=axis)).max(axis=1 - axis)
    return np.asarray(size / size.max())


def tail(f: Array, axis: int) -> float:
    """The largest of the last eighth of them: about the error of having no shorter waves."""
    size = amplitudes(f, axis)
    return float(size[-max(1, size.size // 8) :].max())
