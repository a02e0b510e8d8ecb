"""One of two datasets, of whatever kind: what can be asked of it."""

from __future__ import annotations

import abc

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.systematic import systematic_parts
from kinetic_solver.compare.values import Points, Values
from kinetic_solver.scene import Scene


class Side(abc.ABC):
    """A dataset as values on the points that both sides share, with each replica's share of them."""

    particles: bool
    """Whether its fields are made here, from positions and velocities."""
    stochastic: bool
    """Whether there is chance in it."""
    fields_usable = True
    """False where there is chance in it but nothing that says how much."""

    def __init__(self, dataset: xr.Dataset, name: str, scene: Scene | None) -> None:
        self.dataset = dataset
        self.name = name
        """What messages call it."""
        self.scene = scene
        self.ruling = scene
        """The scene whose density particles without one take, and whose S(k) a single ensemble is taken to have."""
        self.bounds = {} if scene is None else systematic_parts(dataset, scene)

    @property
    def bound(self) -> float:
        """On the relative systematic error, all its parts together."""
        return sum(self.bounds.values())

    def describe(self) -> str:
        """In one line: method, size, systematic parts."""
        method = self.dataset.attrs.get("method", "particles that others made")
        parts = ", ".join(f"{name} {size:.1e}" for name, size in self.bounds.items())
        systematic = f"systematic part at most {parts}" if parts else "its systematic errors are not known, and taken to be none"
        return f"{self.name}: {method}, {self._size()}; {systematic}"

    @abc.abstractmethod
    def _size(self) -> str:
        """How many points or particles, in words."""

    @property
    @abc.abstractmethod
    def number(self) -> float:
        """Of particles in all replicas; inf of what has none."""

    @property
    @abc.abstractmethod
    def particles_of_a_replica(self) -> float:
        """Or of what stands for one."""

    @property
    @abc.abstractmethod
    def nx(self) -> int:
        """Points over x that it has, or that its particles are counted on."""

    @property
    @abc.abstractmethod
    def v(self) -> Array | None:
        """Velocities on which it has fields; None where they can be had on any."""

    @property
    @abc.abstractmethod
    def velocity_range(self) -> tuple[float, float]:
        """(lowest, highest) velocity."""

    @abc.abstractmethod
    def times(self, name: str) -> Array:
        """Of the frames in which a variable is there; [NaN] where there is one frame without a time."""

    @abc.abstractmethod
    def over_x(self, time: float, points: Points, scatter: bool) -> dict[str, Values]:
        """`OVER_X`, by the moments ρ, ρu, ρ(θ + u²). `scatter`: either side has chance in it; then only of the moments' waves
        that the points can hold, since particles have no others."""

    @abc.abstractmethod
    def totals(self, time: float, points: Points) -> dict[str, Values]:
        """`TOTALS`, each (1,)."""

    @abc.abstractmethod
    def distribution(self, time: float, points: Points) -> Values:
        """w(v)."""

    @abc.abstractmethod
    def phase_space(self, time: float, points: Points, scatter: bool) -> Values:
        """f(x, v), flattened; `scatter` likewise."""

    def unresolved(self, time: float) -> float:
        """What waves of the moments that the points of x do not hold may do to them, relative to their maxima."""
        return 0.0

    def unresolved_f(self, time: float) -> float:
        """The same of f."""
        return 0.0


def whole_frames(values: Array) -> Array:
    """Of values (time, …): in which frames there is any number, (time,). A stopped run leaves NaN in the frames to come."""
    return np.asarray(np.isfinite(values.reshape(len(values), -1)).any(axis=1))
