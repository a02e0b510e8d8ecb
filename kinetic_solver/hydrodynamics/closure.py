"""The paper's closure (3)-(5), from the start of a scene to its end, at one resolution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.budgets import budget, sample
from kinetic_solver.hydrodynamics.gas import Gas
from kinetic_solver.hydrodynamics.lawson import ClosureSteps
from kinetic_solver.hydrodynamics.start import start_fields
from kinetic_solver.scene import Scene


@dataclass(frozen=True)
class Frame:
    """What a pass has at one time."""

    fields: Array
    """ρ, u and θ at the points, shape (3, nx)."""
    totals: Array
    """∫ρ, ∫ρu and ∫½ρ(u² + θ)."""
    budget: Mapping[str, float]
    """The group `budgets`."""


class ClosurePass:
    """From a scene's start on, at nx points, with the steps of `ClosureSteps`. Mass is conserved to rounding."""

    def __init__(self, scene: Scene, nx: int, longest: float, refined: float = 1.0) -> None:
        self.scene, self.dx = scene, scene.pipe.length / nx
        self.steps = ClosureSteps(Gas.of(scene), self.dx, longest, refined)
        self.conserved = conserved(*start_fields(scene, self.dx * np.arange(nx)))
        self.start = self._totals()

    @property
    def work(self) -> int:
        """Points times steps so far."""
        return self.conserved.shape[1] * self.steps.steps

    def advance(self, start: float, end: float, after_step: Callable[[], None] = lambda: None) -> None:
        """As `ClosureSteps.advance`."""
        self.conserved = self.steps.advance(self.conserved, start, end, after_step)

    def frame(self, time: float) -> Frame:
        """Of now, which is this time."""
        at = sample(self.steps.gas, self.conserved, self.dx, 0.0)
        totals = self._totals()
        found = budget(self.scene.model, time, self.start, totals, at, self.steps.integral)
        return Frame(primitive(self.conserved), totals, found)

    def _totals(self) -> Array:
        return self.conserved.sum(axis=1) * self.dx

    def state(self) -> dict[str, Any] | None:
        """A tree from which a new pass of the same arguments goes on; None where the next step will find the fields lost."""
        steps = self.steps.state()
        return None if steps is None else {"conserved": self.conserved, "steps": steps}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.conserved = state["conserved"]
        self.steps.restore(state["steps"])


def conserved(rho: Array, u: Array, theta: Array) -> Array:
    """(ρ, ρu, ½ρ(u² + θ))."""
    return np.stack([rho, rho * u, 0.5 * rho * (u * u + theta)])


def primitive(state: Array) -> Array:
    """(ρ, u, θ)."""
    rho, m, e = state
    u = m / rho
    return np.stack([rho, u, 2 * e / rho - u * u])
