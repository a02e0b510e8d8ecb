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


def from_file(scene: Scene, x: Array, v: Array) -> Array:
    """The last complete f(x, v) of the netCDF file `initial.file`, on the points x, v.

    In x the trigonometric interpolant, in v a cubic spline, zero outside the file's window; both exact where the points agree.
    Raises SceneError where the file has no such f, or another period.
    """
    from scipy.interpolate import make_interp_spline

    path = scene.initial.file
    with _opened(scene) as data:
        f, old_x, old_v = data["f"].values, data["x"].values, data["v"].values
    complete = f[np.isfinite(f).all(axis=(1, 2))]
    if not len(complete):
        raise SceneError(f"initial.file = {path!r}: has no complete frame of f")
    state = complete[-1]
    if not (old_v.shape == v.shape and np.allclose(old_v, v, rtol=1e-12, atol=1e-12 * (v[-1] - v[0]))):
        inside = (v >= old_v[0]) & (v <= old_v[-1])
        spline = make_interp_spline(old_v, state, k=3, axis=1)
        state = np.where(inside, spline(np.clip(v, old_v[0], old_v[-1])), 0.0)
    if old_x.size != x.size:
        spectrum = np.fft.rfft(state, axis=0) / old_x.size
        kept = min(spectrum.shape[0], x.size // 2 + 1)
        state = np.fft.irfft(spectrum[:kept] * x.size, n=x.size, axis=0)
    return np.ascontiguousarray(state)


def file_grid(scene: Scene) -> tuple[int, int, float, float]:
    """(nx, nv, low, high) of `initial.file`: the grid on which a run continues it without interpolation."""
    with _opened(scene) as data:
        v = data["v"].values
        half = (v[-1] - v[0]) / (v.size - 1) / 2
        return int(data.sizes["x"]), int(v.size), float(v[0] - half), float(v[-1] + half)


@contextmanager
def _opened(scene: Scene) -> Iterator[xr.Dataset]:
    """`initial.file`, which holds an f of the scene's period."""
    path = scene.initial.file
    assert path is not None
    where = f"initial.file = {path!r}"
    with open_netcdf(path, where) as data:
        if "f" not in data or data["f"].dims != ("time", "x", "v"):
            raise SceneError(f"{where}: has no f(time, x, v); the grid method starts from nothing else")
        if "x_bounds" in data:
            bounds = data["x_bounds"].values
            period = bounds[-1, 1] - bounds[0, 0]
            if not np.isclose(period, scene.pipe.length, rtol=1e-9):
                raise SceneError(f"{where}: its period is {period:.10g}, the scene's {scene.pipe.length:.10g}")
        yield data
