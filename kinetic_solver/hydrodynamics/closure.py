"""The paper's closure (3)-(5), from the start of a scene to its end, at one resolution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.budgets import budget, sample
from kinetic_solver.hydrodynamics.gas import Gas
from kinetic_solver.hydrodynamics.lawson import ClosureSteps
from kinetic_solver.hydrodynamics.start import start_fields
from kinetic_solver.scene import Scene


@dataclass(frozen=True)
class Frames:
    """What a run has at the times of its schedule, as far as it came."""

    fields: Array
    """ρ, u, θ and the heat flux at the points: shape (frames, 4, nx)."""
    totals: Array
    """∫ρ, ∫ρu and ∫½ρ(u² + θ): shape (frames, 3)."""
    budgets: list[dict[str, float]] | None = None
    """The group `budgets`; None of M moments."""
    stopped: str | None = None
    """Why it came no further."""
    work: int = 0
    """Points times steps."""


def run_closure(
    scene: Scene, times: Array, nx: int, longest: float, refined: float = 1.0, watch: Callable[[float], None] | None = None
) -> Frames:
    """At nx points, with the steps of `ClosureSteps`. Mass is conserved to rounding."""
    dx = scene.pipe.length / nx
    steps = ClosureSteps(Gas.of(scene), dx, longest, refined)
    state = conserved(*start_fields(scene, dx * np.arange(nx)))
    states, budgets, now, stopped = [], [], 0.0, None
    for time in times.tolist():
        if time > now:
            try:
                state, now = steps.advance(state, now, time, watch), time
            except SolverStopped as stop:
                stopped = str(stop)
                break
        states.append(state)
        at = sample(steps.gas, state, dx, 0.0)
        start, here = (each.sum(axis=1) * dx for each in (states[0], state))
        budgets.append(budget(scene.model, time, start, here, at, steps.integral))
    fields = np.array([[*primitive(state), np.zeros(nx)] for state in states])
    return Frames(fields, np.array(states).sum(axis=2) * dx, budgets, stopped, nx * steps.steps)


def conserved(rho: Array, u: Array, theta: Array) -> Array:
    """(ρ, ρu, ½ρ(u² + θ))."""
    return np.stack([rho, rho * u, 0.5 * rho * (u * u + theta)])


def primitive(state: Array) -> Array:
    """(ρ, u, θ)."""
    rho, m, e = state
    u = m / rho
    return np.stack([rho, u, 2 * e / rho - u * u])
