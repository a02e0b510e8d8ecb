"""What a movie of a run shows of each of its frames, read one at a time, and the scales that hold all of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.analysis.frames import frame_of, times_of
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of, velocity_axis
from kinetic_solver.errors import SceneError
from kinetic_solver.scene.cadence import SAME_TIME

if TYPE_CHECKING:
    import xarray as xr

OF_W, OF_F = 1e-3, 2e-3
"""Shares of the maximum down to which velocities are shown, as in the overview of `plot`."""
NARROW = 1e-9
"""Relative width of the range of a density below which it is drawn as constant."""
NAMES = ("f", "density", "mean_velocity", "temperature", "velocity_distribution")
"""Fields that are shown."""


class MovieFrames:
    """Fields at every time at which there is a frame of any of them: each in its frame nearest to that time.

    `clock`: these times. `densities`, `speeds`: (least, largest) that axes hold; `largest_f`, `largest_w`. `cut`: there is
    more of w(v) than the velocities shown.
    """

    def __init__(self, dataset: xr.Dataset, look: Callable[[int], None]) -> None:
        """Reads all frames once; `look` is called for each, with their number.

        Raises SceneError where there is nothing to show."""
        self.dataset = dataset
        self.scene = scene_of(dataset)
        self.length = self.scene.pipe.length
        self._refuse()
        self.with_x = dataset.sizes["x"] > 1
        self.times = {name: times_of(dataset, name) for name in NAMES if name in dataset}
        if not all(times.size for times in self.times.values()):
            raise SceneError("the dataset has no frame yet; allowed: a run that has written one")
        every = np.unique(np.concatenate(list(self.times.values())))
        self.same = SAME_TIME * float(np.diff(self.times[max(self.times, key=lambda name: self.times[name].size)]).min(initial=1))
        """Times that are no further apart are one."""
        self.clock = every[np.append(True, np.diff(every) > self.same)]
        self.count = self.clock.size
        over = velocity_axis(dataset)
        self.scaled = over != "v"
        """Whether velocities are those of a run that cools, w = (v - u)/s (dataset/scaled.py)."""
        self.v = np.asarray(dataset[over].values, dtype=float) if dataset.sizes.get(over, 1) > 1 else None
        self._last: dict[str, tuple[int, Array]] = {}
        self._scales(look)

    def _refuse(self) -> None:
        ds = self.dataset
        if not any(name in ds for name in ("f", "density")):
            raise SceneError(
                "the dataset has neither f nor density; allowed: a run with output.f = true or output.moments = true"
            )
        name = "f" if "f" in ds else "density"
        if not str(ds[name].dims[0]).startswith("time"):
            raise SceneError(
                f"{name} is over {', '.join(map(str, ds[name].dims))}; allowed: one run over time (of a sweep, one point)"
            )

    # -- one frame of each field

    def frame(self, name: str, n: int) -> Array:
        """The last one of each field is kept, for times at which another field alone has a frame."""
        index = self.index(name, n)
        if self._last.get(name, (-1,))[0] != index:
            self._last[name] = index, frame_of(self.dataset, name, index)
        return self._last[name][1]

    def index(self, name: str, n: int) -> int:
        """Of the frame of a field that is nearest to the n-th time."""
        return int(np.abs(self.times[name] - self.clock[n]).argmin())

    def density(self, n: int) -> Array:
        if "density" in self.dataset:
            return self.frame("density", n)
        assert self.v is not None
        return np.asarray(self.frame("f", n).sum(axis=1) * (self.v[1] - self.v[0]))

    def w(self, n: int) -> Array:
        if "velocity_distribution" in self.dataset:
            return self.frame("velocity_distribution", n)
        return np.asarray(self.frame("f", n).mean(axis=0) * self.length)

    @property
    def has_w(self) -> bool:
        return self.v is not None and ("velocity_distribution" in self.dataset or "f" in self.dataset)

    def band(self, n: int) -> tuple[Array, Array, Array]:
        """u - √θ, u, u + √θ over x."""
        u = self.frame("mean_velocity", n)
        thermal = np.sqrt(np.maximum(self.frame("temperature", n), 0.0))
        return u - thermal, u, u + thermal

    # -- scales

    def _scales(self, look: Callable[[int], None]) -> None:
        density, speeds, w = (math.inf, -math.inf), (math.inf, -math.inf), 0.0
        edges = 0.0
        top = np.zeros(0 if self.v is None else self.v.size)
        shown = np.zeros(top.shape, dtype=bool)
        for n in range(self.count):
            look(self.count)
            rho = self.density(n)
            density = min(density[0], float(np.nanmin(rho))), max(density[1], float(np.nanmax(rho)))
            if "f" in self.dataset:
                top = np.maximum(top, np.nanmax(self.frame("f", n), axis=0))
            elif "mean_velocity" in self.dataset:
                low, _, high = self.band(n)
                speeds = min(speeds[0], float(np.nanmin(low))), max(speeds[1], float(np.nanmax(high)))
            if self.has_w:
                values = self.w(n)
                w = max(w, float(values.max()))
                edges = max(edges, float(values[0]), float(values[-1]))
                shown |= values > OF_W * values.max()
        margin = 0.06 * (density[1] - density[0]) if density[1] - density[0] > NARROW * density[1] else 0.1 * density[1]
        self.densities = (density[0] - margin, density[1] + margin)
        self.cut = edges > OF_W * w
        self.largest_w, self.largest_f = w, float(top.max(initial=0.0))
        if "f" in self.dataset:
            shown = top > OF_F * self.largest_f
        if shown.any():
            assert self.v is not None
            seen = self.v[shown]
            speeds = min(speeds[0], float(seen[0])), max(speeds[1], float(seen[-1]))
        elif math.isfinite(speeds[0]):
            margin = 0.06 * (speeds[1] - speeds[0])
            speeds = speeds[0] - margin, speeds[1] + margin
        self.speeds = speeds
