"""Starts from f(x, v) in a netCDF file: `initial.file`."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import open_netcdf, scales_of, velocity_axis
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.coordinates import Points, uniform_points
from kinetic_solver.interpolation import through_splines
from kinetic_solver.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

SAME_PLACE = 1e-9
"""Of the pipe's length: points no further than this from those that begin at 0 are these. Chosen, as for the period."""


def from_file(scene: Scene, x: Array, v: Array) -> Array:
    """The last f(x, v) of the netCDF file `initial.file`, on the points x, v.

    In x, of which the file may have any points of one period, the trigonometric interpolant, in v a cubic spline, zero outside
    the file's window; both exact where the points agree. Raises SceneError as `read_state`.
    """
    there, length = read_state(scene), scene.pipe.length
    state, old_v = there.f, there.v
    if not (old_v.shape == v.shape and np.allclose(old_v, v, rtol=1e-12, atol=1e-12 * (v[-1] - v[0]))):
        inside = (v >= old_v[0]) & (v <= old_v[-1])
        within = np.clip(v, old_v[0], old_v[-1])
        state = np.where(inside, state @ through_splines(old_v, within, degree=3).T, 0.0)
    old_nx = state.shape[0]
    shifted = abs(there.first) > SAME_PLACE * length
    if old_nx != x.size or shifted:
        spectrum = np.fft.rfft(state, axis=0) / old_nx
        if old_nx % 2 == 0 and x.size > old_nx:
            spectrum[-1] /= 2  # the wave that changes sign from point to point stands for two
        if shifted:
            spectrum *= np.exp(-2j * np.pi / length * there.first * np.arange(spectrum.shape[0]))[:, None]
        kept = min(spectrum.shape[0], x.size // 2 + 1)
        state = np.fft.irfft(spectrum[:kept] * x.size, n=x.size, axis=0)
    return np.ascontiguousarray(state)


def file_grid(scene: Scene) -> tuple[int, int, float, float]:
    """(nx, nv, low, high): the grid on which a run continues `initial.file` without interpolation.

    Warns of what had to be changed of the file. Raises SceneError as `read_state`.
    """
    there = read_state(scene)
    for text in there.changed:
        warnings.warn(f"initial.file = {scene.initial.file!r}: {text}", stacklevel=2)
    v = there.v
    half = (v[-1] - v[0]) / (v.size - 1) / 2
    return there.f.shape[0], v.size, float(v[0] - half), float(v[-1] + half)


def file_notes(scene: Scene) -> list[str]:
    """What is read of `initial.file`, and what is done with it, in words."""
    there = read_state(scene)
    return [*there.exact, *there.changed]


def read_state(scene: Scene) -> Points:
    """The last f(x, v) that the file has, with or without a dimension `time…`, its dimensions in any order; over scaled
    velocities, those of that frame.

    Raises SceneError where the file has no f(x, v) of the scene's period, and where that f is not finite, or negative by more
    than accuracy.rtol of its maximum.
    """
    path, rtol = scene.initial.file, scene.accuracy.rtol
    assert path is not None
    where = f"initial.file = {path!r}"
    if Path(path).suffix.lower() == ".csv":
        raise SceneError(f"{where}: is a table of particles; allowed for the grid: f(x, v) in a netCDF file")
    with open_netcdf(path, where) as data:
        over = velocity_axis(data["f"]) if "f" in data else "v"
        if "f" not in data or {str(d) for d in data["f"].dims if not str(d).startswith("time")} != {"x", over}:
            raise SceneError(
                f"{where}: has no f(time, x, v) or f(x, v); the grid method starts from nothing else (its variables: "
                f"{', '.join(map(str, list(data.data_vars)[:8])) or 'none'})"
            )
        if missing := [name for name in ("x", over) if name not in data.coords]:
            raise SceneError(f"{where}: f has no coordinate {missing[0]}; allowed: the places and velocities of its points")
        f, frame, exact, changed = _last(data["f"].transpose(..., "x", over), where)
        v = data[over].values
        if over != "v":
            s, origin = (float(value) for value in scales_of(frame))
            v, f = origin + s * v, f / s
            exact.append(f"its scaled velocities are {s:.4g} w + {origin:.4g}")
        bounds = data["x_bounds"].values if "x_bounds" in data and data["x_bounds"].ndim == 2 else None
        found = uniform_points(f, data["x"].values, v, bounds, scene.pipe.length, rtol, where)
    least, most = float(found.f.min()), float(found.f.max())
    if not most > 0:
        raise SceneError(f"{where}: its f is nowhere positive; allowed: some f > 0")
    if least < -rtol * most:
        raise SceneError(
            f"{where}: its f is negative, {-least / most:.2g} of its maximum; allowed: 0 or more, but for "
            f"accuracy.rtol = {rtol:g}"
        )
    return dataclasses.replace(found, exact=(*exact, *found.exact), changed=(*changed, *found.changed))


def _last(f: xr.DataArray, where: str) -> tuple[Array, xr.DataArray, list[str], list[str]]:
    """(f (x, v) of the last frame that is there, itself, what was read in words, what was left out). A run that was
    stopped leaves NaN in the frames to come, and those alone are passed over."""
    if f.dtype.kind not in "fiu":
        raise SceneError(f"{where}: its f is of type {f.dtype}; allowed: real numbers")
    times = [dim for dim in f.dims if str(dim).startswith("time")]
    if len(times) > 1:
        raise SceneError(f"{where}: its f has dimensions {', '.join(map(str, f.dims))}; allowed: one time, x and v")
    frames = f.transpose(*times, ...)
    count = frames.sizes[times[0]] if times else 1
    for n in reversed(range(count)):
        frame = frames.isel({times[0]: n}) if times else frames
        values = np.asarray(frame.values, dtype=float)
        finite = np.isfinite(values)
        if not finite.any():
            continue
        at = f", t = {float(f[times[0]][n]):g}" if times and times[0] in f.coords and f[times[0]].dtype.kind in "fiu" else ""
        name = f"frame {n + 1} of {count}{at}" if times else "f"
        if not finite.all():
            raise SceneError(
                f"{where}: {name} is not finite at {int((~finite).sum())} of its points; allowed: numbers, or a file that ends "
                "with an earlier frame"
            )
        late = [f"starts from {name}: the later ones are empty"] if n < count - 1 else []
        return values, frame, [] if late or not times else [f"read {name}"], late
    raise SceneError(f"{where}: has no frame of f with numbers in it")
