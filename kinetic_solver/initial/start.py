"""What a run starts from: the one owner of that, whatever it is made of.

A plan and the solver ask a `Start`, not the scene, what f is at time 0, and how far and how fine it is. `SceneStart` is what the
table [initial] says; `GivenStart` (given.py) is an f(x, v) that somebody hands to `solve`, or that a file holds.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

from kinetic_solver.arrays import Array
from kinetic_solver.initial import fields, state
from kinetic_solver.scene import Scene

Gaussians = list[tuple[float, Array, Array]]
"""(share, mean velocities, variances) of Gaussians in v, at given places."""


class Start(Protocol):
    """f at time 0. Shapes: x (nx,), v (nv,)."""

    @property
    def homogeneous(self) -> bool:
        """Whether nothing depends on x."""

    @property
    def band_limited(self) -> bool:
        """Whether all its waves along x are on any grid that a plan accepts: then none of them is cut off."""

    @property
    def gaussian(self) -> bool:
        """Whether f is the sum of `gaussians`, and not merely bounded by them."""

    @property
    def closed_form(self) -> bool:
        """Whether f is known to round-off of itself, however far into its tails."""

    @property
    def mean_velocity(self) -> float:
        """u0, the mean velocity of all particles, without modes."""

    @property
    def temperature(self) -> float:
        """θ0, likewise."""

    def density(self, x: Array) -> Array:
        """ρ0(x)."""

    def resolved_density(self, x: Array) -> Array:
        """As the points of a period can carry it: of the scene's mass on any."""

    def density_integral(self, x: Array) -> Array:
        """∫_0^x ρ0."""

    def hottest(self, x: Array) -> float:
        """The largest variance of v over the places x."""

    def gaussians(self, x: Array) -> Gaussians:
        """What f is made of at every x, or what has f's reach in v."""

    def mean_velocities(self, x: Array) -> tuple[float, float]:
        """The least and the largest mean velocity over the places x, of each of the Gaussians that f is the sum of."""

    def narrowest(self, x: Array) -> float:
        """The variance of a Gaussian as fine in v as f is anywhere."""

    def distribution(self, x: Array, v: Array, density: Array | None = None) -> Array:
        """f, (nx, nv), on the points of a period; of this density instead of its own."""

    def outline(self, x: Array, v: Array) -> Array:
        """f, (nx, nv), as plans look at it: anywhere."""


class SceneStart:
    """What [initial] says, but for a file, which is a `GivenStart` (given.py)."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    @property
    def homogeneous(self) -> bool:
        return self.scene.homogeneous

    @property
    def band_limited(self) -> bool:
        return self.scene.initial.step is None and self.scene.initial.pulse is None

    @property
    def gaussian(self) -> bool:
        return not self.scene.initial.eigenmodes

    @property
    def closed_form(self) -> bool:
        return True

    @property
    def mean_velocity(self) -> float:
        return self._state[0]

    @property
    def temperature(self) -> float:
        return self._state[1]

    @cached_property
    def _state(self) -> tuple[float, float]:
        return fields.start_state(self.scene)

    def density(self, x: Array) -> Array:
        return fields.density(self.scene, x)

    def resolved_density(self, x: Array) -> Array:
        return fields.resolved_density(self.scene, x)

    def density_integral(self, x: Array) -> Array:
        return fields.density_integral(self.scene, x)

    def hottest(self, x: Array) -> float:
        if not self.scene.initial.temperature_modes:
            return self.temperature
        return float(fields.temperature(self.scene, x, self.temperature).max())

    def gaussians(self, x: Array) -> Gaussians:
        scene = self.scene
        return [
            (share, fields.mean_velocity(scene, x, u), fields.temperature(scene, x, theta))
            for share, u, theta in fields.beams(scene)
        ]

    def mean_velocities(self, x: Array) -> tuple[float, float]:
        means = [mean for _, mean, _ in self.gaussians(x)]
        return min(float(mean.min()) for mean in means), max(float(mean.max()) for mean in means)

    def narrowest(self, x: Array) -> float:
        if not self.scene.initial.temperature_modes:
            return min(theta for _, _, theta in fields.beams(self.scene))
        return min(float(theta.min()) for _, _, theta in self.gaussians(x))

    def distribution(self, x: Array, v: Array, density: Array | None = None) -> Array:
        return state.distribution(self.scene, x, v, density)

    def outline(self, x: Array, v: Array) -> Array:
        return state.distribution(self.scene, x, v)
