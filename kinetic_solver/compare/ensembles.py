"""A side that is positions and velocities of particles, whoever made them: its fields are made here, on any points."""

from __future__ import annotations

import functools
import math

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.sides import Side, whole_frames
from kinetic_solver.compare.values import OVER_X, Points, Values, totals_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from particles.estimators import Sampler, fields
from particles.files import frame_of_particles, outside_of_pipe, particle_names, time_dimension

PARTS = 20
"""Parts that a single ensemble is divided into: their scatter gives its errors, as if particles were independent."""
MOST_POINTS = 33
"""Points in x on which particles are counted."""


class EnsembleSide(Side):
    """Replicas of particles, (replica, particle), or a single ensemble, whose parts stand for replicas."""

    particles = True
    stochastic = True

    def __init__(self, dataset: xr.Dataset, name: str, scene: Scene | None) -> None:
        super().__init__(dataset, name, scene)
        self._seen: tuple[tuple[float, int], dict[str, Array]] | None = None
        """The fields last made, with their time and nx: everything that is compared at a time is made of them."""

    @functools.cached_property
    def _shape(self) -> tuple[int, int]:
        """(replicas, particles of each)."""
        x, _ = frame_of_particles(self.dataset, 0)
        return x.shape[0], x.shape[1]

    @property
    def _parts(self) -> int:
        """Parts of a single ensemble. Raises SceneError where it is too small for two."""
        _, count = self._shape
        if count < 4:
            raise SceneError(f"{self.name}: {count} particles have no standard errors; allowed: 4 or more, or replicas")
        return min(PARTS, count // 2)

    def _size(self) -> str:
        replicas, count = self._shape
        text = f"{count} particles" + (f" in each of {replicas} replicas" if replicas > 1 else ", one ensemble")
        outside = 0 if self.ruling is None else outside_of_pipe(frame_of_particles(self.dataset, 0)[0], self.ruling.pipe.length)
        return text + (f", positions of {outside} outside the pipe taken modulo its period" if outside else "")

    @property
    def number(self) -> float:
        return float(math.prod(self._shape))

    @property
    def particles_of_a_replica(self) -> float:
        replicas, count = self._shape
        return count if replicas > 1 else count / self._parts

    @property
    def nx(self) -> int:
        return MOST_POINTS

    @property
    def v(self) -> None:
        return None

    @property
    def velocity_range(self) -> tuple[float, float]:
        _, v = frame_of_particles(self.dataset, 0)
        return float(v.min()), float(v.max())

    def times(self, name: str) -> Array:
        names = particle_names(self.dataset)
        assert names is not None
        dimension = time_dimension(self.dataset[names[0]])
        if dimension is None:
            return np.array([float(self.dataset["time"])]) if "time" in self.dataset.coords else np.array([math.nan])
        if dimension not in self.dataset.coords:
            if self.dataset.sizes[dimension] == 1:
                return np.array([math.nan])
            raise SceneError(f"{self.name}: its frames have no times; allowed: a coordinate {dimension!r}")
        times = self.dataset[dimension].values
        if times.dtype.kind not in "fiu":
            raise SceneError(f"{self.name}: its times are of type {times.dtype}; allowed: numbers")
        return np.asarray(times, dtype=float)[whole_frames(self.dataset[names[0]].transpose(dimension, ...).values)]

    def over_x(self, time: float, points: Points, scatter: bool) -> dict[str, Values]:
        return {name: self._values(time, points, name) for name in OVER_X}

    def totals(self, time: float, points: Points) -> dict[str, Values]:
        found = self._fields(time, points)
        return totals_of(np.array([found[f"{name}_replica"] for name in ("mass", "momentum", "energy")]), True, self._inflation())

    def distribution(self, time: float, points: Points) -> Values:
        return self._values(time, points, "velocity_distribution")

    def phase_space(self, time: float, points: Points, scatter: bool) -> Values:
        found = self._fields(time, points)
        replicas, _ = self._shape
        errors = found["f_stderr"].ravel(), replicas if replicas > 1 else self._parts
        return Values(found["f"].ravel(), None, self._inflation(), errors)

    def _values(self, time: float, points: Points, name: str) -> Values:
        found = self._fields(time, points)
        return Values(found[name], found[f"{name}_replica"], self._inflation())

    def _inflation(self) -> float:
        """The largest S(k) of a single ensemble, whose parts are not independent of one another; 1 for replicas, which are."""
        from kinetic_solver.stability import structure_factor

        ruling = self.ruling
        if self._shape[0] > 1 or ruling is None or ruling.law is None or ruling.model.friction * ruling.model.noise == 0:
            return 1.0
        return float(structure_factor(ruling, range(1, 9)).max())

    def _fields(self, time: float, points: Points) -> dict[str, Array]:
        """All fields on the points, of the frame nearest to this time."""
        if self._seen is not None and self._seen[0] == (time, points.nx):
            return self._seen[1]
        times = self.times("density")
        x, u = frame_of_particles(self.dataset, 0 if np.isnan(times).all() else int(np.nanargmin(np.abs(times - time))))
        if not (np.isfinite(x).all() and np.isfinite(u).all()):
            raise SceneError(f"{self.name}: positions or velocities at t = {time:g} are not finite")
        assert self.ruling is not None
        if len(x) > 1:
            parts = list(zip(x, u, strict=True))
        else:  # at random: particles may be in an order
            shuffled = np.random.default_rng(0).permutation(x.shape[1])
            parts = [(x[0, chosen], u[0, chosen]) for chosen in np.array_split(shuffled, self._parts)]
        samples = []
        for places, velocities in parts:
            sampler = Sampler(points.length, points.nx, points.v, self.ruling.initial.density * points.length / places.size)
            samples.append(sampler.sample(np.ascontiguousarray(places), np.ascontiguousarray(velocities)))
        self._seen = (time, points.nx), fields(samples, points.length, points.nx, points.v)
        return self._seen[1]
