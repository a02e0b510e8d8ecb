"""What a run of the hydrodynamic method will use."""

from __future__ import annotations

import math
from dataclasses import dataclass

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.hydrodynamics.start import refuse
from kinetic_solver.scene import Scene, Schedule, check_is_scene

FEWEST = 256
"""Points of the output where grid.nx is not given; 32 on the shortest wave of the start, if that is more."""
GROUPS = ("moments", "scalars", "budgets")
"""Of `[output]`; the last one for the closure alone."""


@dataclass(frozen=True)
class Plan:
    scene: Scene
    groups: tuple[str, ...]
    """Of `[output]`, those that it can write."""
    schedule: Schedule
    output: PhaseSpaceGrid
    """Its velocities are no axis of anything: one cell, since hydrodynamics has no f."""
    points: int
    """Of the closure's second pass, or as given: a multiple of the output's."""

    @property
    def moments(self) -> int | None:
        """M of the Hermite hierarchy; None for the closure (3)-(5)."""
        return self.scene.hydrodynamics.moments


def make_plan(scene: Scene) -> Plan:
    """Raises SceneError where the method cannot run the scene."""
    check_is_scene(scene)
    refuse(scene)
    if scene.hydrodynamics.moments is not None:
        _refuse_hierarchy(scene)
    if scene.grid.nx is not None:
        nx = scene.grid.nx
    elif scene.homogeneous:
        nx = 1
    else:
        start = scene.initial
        modes = (*start.modes, *start.velocity_modes, *start.temperature_modes)
        shortest = max((m.mode for m in modes if m.cos or m.sin), default=1)
        if start.pulse is not None:
            shortest = max(shortest, math.ceil(1 / (2 * math.pi * start.pulse.width)))
        nx = max(FEWEST, 32 * shortest)
    reach = scene.model.noise**0.5 or 1.0
    groups = GROUPS if scene.hydrodynamics.moments is None else GROUPS[:2]
    shown = scene.output.nx or nx
    if scene.grid.nx is None and nx > 1:
        nx = 2 * shown * math.ceil(nx / (2 * shown)) if scene.output.nx else nx
    elif scene.hydrodynamics.moments is None and nx > 1 and nx % shown:
        raise SceneError(f"output.nx = {shown}: the closure's points are grid.nx = {nx}; allowed: what divides it")
    return Plan(scene, groups, Schedule.of(scene, groups), PhaseSpaceGrid(shown, 1, scene.pipe.length, -reach, reach), nx)


def _refuse_hierarchy(scene: Scene) -> None:
    if scene.law is not None and not scene.law.linearises:
        raise SceneError(
            'hydrodynamics.moments: the Hermite hierarchy is for operator "follow-the-leader" or none, and '
            'collisions.operator = "inelastic"; remove it for the closure (3)-(5)'
        )
    if scene.initial.step is not None:
        raise SceneError("initial.step: the Hermite hierarchy has no shocks; allowed: modes, or no hydrodynamics.moments")
    for name, value in (("friction", scene.model.friction), ("noise", scene.model.noise)):
        if value == 0:
            raise SceneError(f"model.{name} = 0: the Hermite hierarchy is about a stationary state; allowed: above 0")
