"""A scene's waves, and the change between its units and those of linear theory: γ = σ = 1, at rest in the frame of u_h."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

Complex: TypeAlias = NDArray[np.complexfloating[Any, Any]]
"""A complex array, as arrays.Array is a real one."""


@dataclass(frozen=True)
class Units:
    """From the flow's units (γ = σ = 1, rest) to the scene's."""

    gamma: float
    sigma: float
    mean_velocity: float
    """u_h."""

    def rate(self, s: Complex, wavenumber: float) -> Complex:
        """s in the scene's frame, `wavenumber` in its units."""
        return self.gamma * s - 1j * wavenumber * self.mean_velocity

    def velocity(self, v: Array) -> Array:
        """w of v."""
        return (np.asarray(v, dtype=float) - self.mean_velocity) / math.sqrt(self.sigma)


def stationary(scene: Scene) -> None:
    """Raises SceneError without friction and noise: no homogeneous state is stationary then."""
    for name, value in (("friction", scene.model.friction), ("noise", scene.model.noise)):
        if value == 0:
            raise SceneError(f"model.{name} = 0: linear theory is about a stationary homogeneous state; allowed: above 0")


def wavenumber(scene: Scene, mode: int) -> float:
    """k = 2πn/L. Raises SceneError unless n is 1, 2, …"""
    if mode < 1 or mode != int(mode):
        raise SceneError(f"mode = {mode}: must be 1 or more, and whole")
    return 2 * math.pi * mode / scene.pipe.length


def mode_numbers(modes: int | Iterable[int]) -> list[int]:
    """One mode number or several, as a list."""
    return [int(modes)] if isinstance(modes, int | np.integer) else [int(n) for n in modes]


def dimensionless(scene: Scene, mode: int) -> float:
    """k* of mode n."""
    return wavenumber(scene, mode) * math.sqrt(scene.model.noise) / scene.model.friction
