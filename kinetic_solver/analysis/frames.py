"""Frames of a run one at a time, and as they are drawn: between their points too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of

if TYPE_CHECKING:
    import xarray as xr


def times_of(dataset: xr.Dataset, name: str) -> Array:
    """Times of the frames of `name` that are complete."""
    dimension, *others = map(str, dataset[name].dims)
    whole = np.isfinite(dataset[name].isel(dict.fromkeys(others, 0)).values)
    return np.asarray(dataset[dimension].values[whole], dtype=float)


def frame_of(dataset: xr.Dataset, name: str, n: int) -> Array:
    """One frame: a file is read no further."""
    return np.asarray(dataset[name].isel({dataset[name].dims[0]: n}).values)


def some(count: int, most: int) -> Array:
    """Indices of that many of `count` frames, evenly, both ends among them; all where there are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def period_of(dataset: xr.Dataset) -> float:
    return scene_of(dataset).pipe.length


def fine_x(values: Array, length: float, axis: int) -> tuple[Array, Array]:
    """(x, values) on at least 240 intervals of the period, its end included, by the trigonometric interpolant."""
    nx = values.shape[axis]
    factor = max(1, -(-240 // nx))
    spectrum = np.fft.rfft(values, axis=axis)
    if nx % 2 == 0 and factor > 1:  # the Nyquist cosine becomes an ordinary mode, which counts twice
        spectrum[(slice(None),) * axis + (-1,)] /= 2
    fine = np.fft.irfft(spectrum, n=nx * factor, axis=axis) * factor
    return np.linspace(0, length, nx * factor + 1), np.concatenate([fine, fine.take([0], axis=axis)], axis=axis)


def fine_v(v: Array, values: Array, axis: int) -> tuple[Array, Array]:
    """(v, values) on at least 300 points, by a cubic spline."""
    from scipy.interpolate import make_interp_spline

    if v.size >= 300:
        return v, values
    fine = np.linspace(v[0], v[-1], 400)
    return fine, make_interp_spline(v, values, k=3, axis=axis)(fine)
