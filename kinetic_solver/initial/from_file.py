"""Starts from f(x, v) in a netCDF file: `initial.file`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import open_netcdf
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

SAME_PLACE = 1e-9
"""Of the pipe's length: points no further than this from those that begin at 0 are these. Chosen, as for the period."""


def from_file(scene: Scene, x: Array, v: Array) -> Array:
    """The last complete f(x, v) of the netCDF file `initial.file`, which has f(time, x, v) or f(x, v), on the points x, v.

    In x, of which the file may have any uniform points of one period, the trigonometric interpolant, in v a cubic spline, zero
    outside the file's window; both exact where the points agree.
    Raises SceneError where the file has no such f, or another period.
    """
    from scipy.interpolate import make_interp_spline

    path = scene.initial.file
    with _opened(scene) as data:
        f, old_x, old_v = data["f"].values, data["x"].values, data["v"].values
    if f.ndim == 2:
        f = f[None]
    complete = f[np.isfinite(f).all(axis=(1, 2))]
    if not len(complete):
        raise SceneError(f"initial.file = {path!r}: has no complete frame of f")
    state = complete[-1]
    if not (old_v.shape == v.shape and np.allclose(old_v, v, rtol=1e-12, atol=1e-12 * (v[-1] - v[0]))):
        inside = (v >= old_v[0]) & (v <= old_v[-1])
        spline = make_interp_spline(old_v, state, k=3, axis=1)
        state = np.where(inside, spline(np.clip(v, old_v[0], old_v[-1])), 0.0)
    shifted = abs(old_x[0]) > SAME_PLACE * scene.pipe.length
    if old_x.size != x.size or shifted:
        spectrum = np.fft.rfft(state, axis=0) / old_x.size
        if old_x.size % 2 == 0 and x.size > old_x.size:
            spectrum[-1] /= 2  # the wave that changes sign from point to point stands for two
        if shifted:
            spectrum *= np.exp(-2j * np.pi / scene.pipe.length * old_x[0] * np.arange(spectrum.shape[0]))[:, None]
        kept = min(spectrum.shape[0], x.size // 2 + 1)
        state = np.fft.irfft(spectrum[:kept] * x.size, n=x.size, axis=0)
    return np.ascontiguousarray(state)


def file_grid(scene: Scene) -> tuple[int, int, float, float]:
    """(nx, nv, low, high) of `initial.file`: the grid on which a run continues it without interpolation."""
    with _opened(scene) as data:
        v = data["v"].values
        half = (v[-1] - v[0]) / (v.size - 1) / 2
        return int(data.sizes["x"]), int(v.size), float(v[0] - half), float(v[-1] + half)


def _period(data: xr.Dataset, where: str) -> float:
    """Of the cells' bounds, or else of the uniform points of which there are two or more."""
    if "x_bounds" in data:
        bounds = data["x_bounds"].values
        return float(bounds[-1, 1] - bounds[0, 0])
    x = data["x"].values
    if x.size < 2 or not np.allclose(np.diff(x), (x[-1] - x[0]) / (x.size - 1), rtol=1e-6, atol=0.0):
        raise SceneError(f"{where}: its x is not uniform; allowed: two or more places, equally far apart, over one period")
    return float((x[-1] - x[0]) * x.size / (x.size - 1))


@contextmanager
def _opened(scene: Scene) -> Iterator[xr.Dataset]:
    """`initial.file`, which holds an f of the scene's period."""
    path = scene.initial.file
    assert path is not None
    where = f"initial.file = {path!r}"
    with open_netcdf(path, where) as data:
        if "f" not in data or data["f"].dims not in (("time", "x", "v"), ("x", "v")):
            raise SceneError(f"{where}: has no f(time, x, v) or f(x, v); the grid method starts from nothing else")
        if missing := [name for name in ("x", "v") if name not in data.coords]:
            raise SceneError(f"{where}: f has no coordinate {missing[0]}; allowed: the places and velocities of its points")
        period = _period(data, where)
        if not np.isclose(period, scene.pipe.length, rtol=1e-9):
            raise SceneError(f"{where}: its period is {period:.10g}, the scene's {scene.pipe.length:.10g}")
        yield data
