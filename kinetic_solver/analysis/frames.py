"""Which frames of a dataset a picture shows, and what is drawn between their points.

They are read one by one: a file may hold many more than fit into memory.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of, velocity_axis
from kinetic_solver.errors import SceneError
from kinetic_solver.interpolation import through_splines, through_waves
from kinetic_solver.scene.cadence import SAME_TIME

if TYPE_CHECKING:
    import xarray as xr

MOST_FRAMES = 400
"""Frames between which it is seen how much a field changes. Chosen: four of them are shown."""
MOST_TIMES = 12
"""Times for which there is room on a picture."""
FINE_X, FINE_V = 240, 400
"""Points at which a field of few points is drawn. Chosen: no corner is seen."""


def refuse_sweep(dataset: xr.Dataset) -> None:
    """Raises SceneError for the file of a sweep: a run's picture has no place for further dimensions."""
    if "swept" in dataset.attrs:
        raise SceneError(
            f"the file is a sweep over {', '.join(json.loads(dataset.attrs['swept']))}; allowed: the file of one run. "
            "Its points have such files in the folder points; xarray draws the sweep itself: ds['density'].std('x').plot()"
        )


def chosen_frames(dataset: xr.Dataset, name: str, times: Sequence[float] | None, count: int = 4) -> list[int]:
    """Indices of the frames nearest to `times`; by default `count` of them, between which the field changes equally.

    Raises SceneError for a time beyond the frames, for more than twelve of them, and for a file without a frame."""
    t = times_of(dataset, name)
    if not t.size:
        raise SceneError("the file has no frame yet")
    if times is not None:
        if not 0 < len(times) <= MOST_TIMES:
            raise SceneError(f"times: {len(times)} are given; allowed: up to {MOST_TIMES} (a movie has all of them)")
        for time in times:
            if not t[0] <= time <= t[-1] * (1 + SAME_TIME):
                raise SceneError(f"time {time:g}: is beyond the frames of the file; allowed: {t[0]:g} to {t[-1]:g}")
        nearest = [int(np.abs(t - time).argmin()) for time in times]
        if len(set(nearest)) < len(nearest):
            shown = ", ".join(f"{t[n]:g}" for n in sorted(set(nearest)))
            warnings.warn(f"times: some are nearest to the same frame, which is drawn once; drawn: {shown}", stacklevel=3)
        return sorted(set(nearest))
    looked = some(t.size, MOST_FRAMES)
    change, before = [0.0], frame_of(dataset, name, 0)
    for n in looked[1:]:
        now = frame_of(dataset, name, n)
        change.append(float(np.nansum(np.abs(now - before))))
        before = now
    path = np.cumsum(change)
    return sorted({int(looked[np.abs(path - part).argmin()]) for part in np.linspace(0, path[-1], count)})


def some(count: int, most: int) -> Array:
    """Indices of that many of `count` frames, evenly, both ends among them; all where there are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def frame_of(dataset: xr.Dataset, name: str, n: int) -> Array:
    """One frame: a file is read no further."""
    return np.asarray(dataset[name].isel({dataset[name].dims[0]: n}).values)


def times_of(dataset: xr.Dataset, name: str) -> Array:
    """Times of the frames of `name` that are complete. Of ratios, which may be missing in places, those of the density."""
    name = "density" if name in ("mean_velocity", "temperature") else name
    dimension, *others = map(str, dataset[name].dims)
    whole = np.isfinite(dataset[name].isel(dict.fromkeys(others, 0)).values)
    return np.asarray(dataset[dimension].values[whole], dtype=float)


def is_counted(dataset: xr.Dataset) -> bool:
    """Particles are counted in cells: what is between the cells' centres is not known, and not drawn."""
    return str(dataset.attrs.get("method", "")).startswith("particles")


def fine_x(dataset: xr.Dataset, values: Array, axis: int) -> tuple[Array, Array]:
    """(x, values) from 0 to the end of the period, on at least 240 intervals, through the waves that the points hold.

    Fields with missing values, and fields of shocks and of particles, stay at their points.
    """
    x, length = dataset["x"].values, scene_of(dataset).pipe.length
    smooth = np.isfinite(values).all() and "velocity_distribution" in dataset and not is_counted(dataset)
    if smooth and x.size < FINE_X:
        places = np.linspace(0, length, x.size * -(-FINE_X // x.size) + 1)
        return places, np.moveaxis(np.moveaxis(values, axis, -1) @ through_waves(x, places, length).T, -1, axis)
    return np.append(x, x[0] + length), np.concatenate([values, values.take([0], axis=axis)], axis=axis)


def fine_v(dataset: xr.Dataset, values: Array, between: tuple[float, float] | None = None) -> tuple[Array, Array]:
    """(v, values) along the last axis, on 400 points of the window or `between` two velocities of it, by a cubic spline; of
    particles as they are."""
    v = dataset[velocity_axis(dataset)].values
    low, high = between or (v[0], v[-1])
    if is_counted(dataset) or v.size < 4 or np.count_nonzero((low <= v) & (v <= high)) >= FINE_V:
        return v, values
    fine = np.linspace(low, high, FINE_V)
    return fine, values @ through_splines(v, fine, degree=3).T
