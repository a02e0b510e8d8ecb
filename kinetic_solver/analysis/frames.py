"""Which frames of a dataset a picture shows, read one by one: a file may hold many more than fit into memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene.cadence import SAME_TIME

if TYPE_CHECKING:
    import xarray as xr

MOST_FRAMES = 400
"""Frames between which it is seen how much a field changes. Chosen: four of them are shown."""
MOST_TIMES = 8
"""Times for which there is room side by side."""


def chosen_frames(dataset: xr.Dataset, name: str, times: Sequence[float] | None, count: int = 4) -> list[int]:
    """Indices of the frames nearest to `times`; by default `count` of them, between which the field changes equally.

    Raises SceneError for a time beyond the frames, for more than eight of them, and for a file without a frame."""
    t = times_of(dataset, name)
    if not t.size:
        raise SceneError("the file has no frame yet")
    if times is not None:
        if not 0 < len(times) <= MOST_TIMES:
            raise SceneError(f"times: {len(times)} of them; allowed: 1 to {MOST_TIMES}")
        for time in times:
            if not t[0] <= time <= t[-1] * (1 + SAME_TIME):
                raise SceneError(f"time {time:g}: is beyond the frames of the file; allowed: {t[0]:g} to {t[-1]:g}")
        return sorted({int(np.abs(t - time).argmin()) for time in times})
    looked = some(t.size, MOST_FRAMES)
    change, before = [0.0], frame(dataset, name, 0)
    for n in looked[1:]:
        now = frame(dataset, name, n)
        change.append(float(np.nansum(np.abs(now - before))))
        before = now
    path = np.cumsum(change)
    return sorted({int(looked[np.abs(path - part).argmin()]) for part in np.linspace(0, path[-1], count)})


def some(count: int, most: int) -> Array:
    """Indices of that many of `count` frames, evenly, both ends among them; all where there are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def frame(dataset: xr.Dataset, name: str, n: int) -> Array:
    """One frame: a file is read no further."""
    return np.asarray(dataset[name].isel({dataset[name].dims[0]: n}).values)


def times_of(dataset: xr.Dataset, name: str) -> Array:
    """Times of the frames of `name` that are complete. Of ratios, which may be missing in places, those of the density."""
    name = "density" if name in ("mean_velocity", "temperature") else name
    dimension, *others = map(str, dataset[name].dims)
    whole = np.isfinite(dataset[name].isel(dict.fromkeys(others, 0)).values)
    return np.asarray(dataset[dimension].values[whole], dtype=float)
