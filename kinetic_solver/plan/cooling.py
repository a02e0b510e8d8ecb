"""Whether a gas is solved in velocities that shrink with it (moving_frame.py), and how fast they shrink."""

from __future__ import annotations

import math
from dataclasses import replace

from kinetic_solver.laws import Inelastic
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.scales import Scales
from kinetic_solver.scene import Scene
from kinetic_solver.stability.scaling import MOST_ELASTIC, cooling_state

WORTH_COOLING = {True: 1.5, False: 3.0}
"""How many times slower a gas must become, one that is homogeneous and one with waves, which may cool otherwise. Chosen: of eight
scenes with waves that finished, six took as long as on a fixed window or less, down to a thirtieth; two that become two times
slower (ε = 0.99; a thin gas) took longer."""
MOST_FRICTION = 15.0
"""γt up to which such a frame follows a gas that friction cools as well: its clock ends, and tells time to e^γt round-off."""


def may_scale(scene: Scene) -> bool:
    """Whether a gas might be solved so: (12) without noise, and nothing said of velocities and steps."""
    law, given, model = scene.law, scene.grid, scene.model
    said = (given.nv, given.velocity_window, given.velocity, given.time_step, given.stepping, given.drift_diffusion)
    return (
        isinstance(law, Inelastic)
        and law.restitution <= MOST_ELASTIC
        and model.friction * model.noise == 0
        and not any(said)
        and not scene.output.moment_equations
    )


def cooling_frame(scales: Scales, moving: ReferenceFrame) -> ReferenceFrame | None:
    """The frame whose velocities shrink as those of a homogeneous gas of the mean density do in the end; None where it would not
    pay. `moving` is the one that only falls, in which the start is at rest."""
    law, scene = scales.law, scales.scene
    if not may_scale(scene) or scene.model.friction * scales.end > MOST_FRICTION:
        return None
    assert isinstance(law, Inelastic)
    unit = math.sqrt(scales.start.temperature)
    rate = cooling_state(law.restitution).cooling_rate * law.cross_section * scene.initial.density * unit
    if 1 + rate * scales.whole.drift_time < WORTH_COOLING[scales.start.homogeneous]:
        return None
    return replace(moving, cooling=rate, unit=unit)
