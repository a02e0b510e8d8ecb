"""A side whose fields a run wrote: on a grid, in closed form, or from particles with every replica's fields."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.resampling import at_points, over_v, shortest_waves, waves_of
from kinetic_solver.compare.sides import Side, whole_frames
from kinetic_solver.compare.values import OVER_X, Points, Values, fields_of, totals_of
from kinetic_solver.scene import Scene


class RunSide(Side):
    """Fields over (time, x) and (time, v) of a dataset; of particles as well those of each replica, `…_replica`."""

    particles = False

    def __init__(self, dataset: xr.Dataset, name: str, scene: Scene | None) -> None:
        super().__init__(dataset, name, scene)
        self.stochastic = dataset.attrs.get("method") == "particles"
        self.fields_usable = not self.stochastic or dataset.sizes.get("replica", 1) > 1

    def _size(self) -> str:
        if self.stochastic and self.scene is not None:
            return f"{self.scene.particles.count} particles in each of {self.scene.particles.replicas} replicas"
        return f"{self.dataset.sizes['x']} × {self.dataset.sizes['v']} points"

    @property
    def number(self) -> float:
        if not self.stochastic or self.scene is None:
            return math.inf
        return float(self.scene.particles.count * self.scene.particles.replicas)

    @property
    def particles_of_a_replica(self) -> float:
        return self.scene.particles.count if self.scene is not None else math.nan

    @property
    def nx(self) -> int:
        return int(self.dataset.sizes["x"])

    @property
    def v(self) -> Array | None:
        """None where the run has no distribution over v: hydrodynamics."""
        return self._v if self._v.size > 1 else None

    @property
    def _v(self) -> Array:
        return np.asarray(self.dataset["v"].values, dtype=float)

    @property
    def velocity_range(self) -> tuple[float, float]:
        return float(self._v[0]), float(self._v[-1])

    def times(self, name: str) -> Array:
        if name not in self.dataset:
            return np.empty(0)
        values = self.dataset[name]
        return np.asarray(values[str(values.dims[0])].values, dtype=float)[whole_frames(values.values)]

    def _frame(self, name: str, time: float) -> Array:
        """A variable in the frame nearest to this time."""
        values = self.dataset[name]
        return np.asarray(values.values[int(np.abs(self.dataset[values.dims[0]].values - time).argmin())])

    def _moments(self, time: float) -> Array:
        """ρ, ρu, ρ(θ + u²), shape (3, nx)."""
        rho, u, theta = (self._frame(name, time) for name in OVER_X)
        return np.stack([rho, rho * u, rho * (theta + u**2)])

    def over_x(self, time: float, points: Points, scatter: bool) -> dict[str, Values]:
        if not self.stochastic:
            return fields_of((waves_of if scatter else at_points)(self._moments(time)[None], points.nx), False)
        rho, u, theta = (self._frame(name, time) for name in OVER_X)
        r, velocities, temperatures = (self._frame(f"{name}_replica", time) for name in OVER_X)
        j = u * r + rho * (velocities - u)
        moments = np.stack([r, j, rho * (temperatures - theta) + 2 * u * j - (u**2 - theta) * r], axis=1)
        return fields_of(waves_of(moments, points.nx), True)

    def totals(self, time: float, points: Points) -> dict[str, Values]:
        names = ("mass", "momentum", "energy")
        if self.stochastic:
            return totals_of(np.array([self._frame(f"{name}_replica", time) for name in names]), True)
        return totals_of(np.array([[float(self._frame(name, time))] for name in names]), False)

    def distribution(self, time: float, points: Points) -> Values:
        name = "velocity_distribution"
        w = over_v(self._v, self._frame(name, time), points.v)
        if not self.stochastic:
            return Values(w)
        return Values(w, over_v(self._v, self._frame(f"{name}_replica", time), points.v))

    def phase_space(self, time: float, points: Points, scatter: bool) -> Values:
        """Of particles on the run's own nx, and those of its velocities that are among the points'."""
        f = self._frame("f", time)
        if not self.stochastic:
            return Values(over_v(self._v, (waves_of if scatter else at_points)(f.T, points.nx).T, points.v).ravel())
        assert self.scene is not None
        kept = np.isin(self._v, points.v)
        error = self._frame("f_stderr", time)[:, kept]
        return Values(f[:, kept].ravel(), None, 1.0, (error.ravel(), self.scene.particles.replicas))

    def unresolved(self, time: float) -> float:
        """Of points of the closed form, and of density steps; the waves of other grids are in their error estimates."""
        stepped = self.scene is not None and self.scene.initial.step is not None
        if self.stochastic or not (stepped or self.dataset.attrs.get("method") == "exact"):
            return 0.0
        return max(shortest_waves(moment[:, None]) for moment in self._moments(time))

    def unresolved_f(self, time: float) -> float:
        return 0.0 if self.stochastic else shortest_waves(self._frame("f", time))
