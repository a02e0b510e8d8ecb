"""Homogeneous runs of (12): whether they are solved in velocities that follow them (operators/homogeneous.py), and where.

There everything is kept to round-off but the steps in time: it costs little, for points are few and there is one place.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.homogeneous import Shape, points
from kinetic_solver.plan.scales import Scales
from kinetic_solver.stability.galerkin import DIGITS
from kinetic_solver.stability.inelastic import InelasticFlow, inelastic_flow

LOCAL, LEAST_LOCAL, MOST_LOCAL = 0.003, 1e-13, 1e-7
"""Of rtol, to the local error of a step of the integrator, over the largest F; and its bounds: round-off, and what budgets and
conservation want, at little cost. Measured: errors add up to less than 0.15 rtol (tests/exact/test_homogeneous_flow.py)."""
FINER = 1.45
"""By how much points are closer than the waves of a Gaussian ask, since f_h has more. Chosen."""
POINTS = 3.5
"""To a standard deviation, where f is looked at: enough for round-off."""
EVALUATIONS, BY_NUMBER, AT_LEAST = 500, 400, 20
"""Of the rate: by a run, for each decade of R*, and by each further frame (python -m benchmarks.homogeneous)."""
CALLS, RATE = 6e-5, 2.5e-9
"""Seconds of one, and for each pair of points. Likewise."""
ROOM = 1.1
"""By how much the window of the points in v exceeds all that it is to hold. Chosen."""


@dataclass(frozen=True)
class ShapeGrid:
    """The points on which F is held: `count`, odd, of [-half, half)."""

    half: float
    count: int


def serves(scales: Scales) -> bool:
    """Whether the run is one of (12) with friction and noise in which nothing depends on x, and nothing is said of the grid."""
    given, model, law = scales.scene.grid, scales.scene.model, scales.law
    said = (
        given.nv,
        given.velocity_window,
        given.velocity,
        given.stepping,
        given.drift_diffusion,
        given.deposit,
        given.time_step,
    )
    return (
        isinstance(law, Inelastic)
        and law.dissipation > 0
        and model.friction > 0
        and model.noise > 0
        and scales.start.homogeneous
        and scales.start.closed_form
        and given.nx in (None, 1)
        and not any(said)
        and _state(scales) is not None
    )


def shape_grid(scales: Scales) -> ShapeGrid:
    """In units of f's own width at any time: pairs up to √2 times its reach apart hold all but round-off of the collisions."""
    state, start = _state(scales), scales.start
    assert state is not None
    width = math.sqrt(start.temperature)
    reach = max(_reach(scales) / width, state.reach / math.sqrt(state.temperature))
    half = math.sqrt(2) * reach
    narrowest = min(1.0, math.sqrt(scales.narrowest) / width)
    # The waves of a Gaussian fall as exp(-(width·q)²/2).
    spacing = math.pi * narrowest / math.sqrt(-2 * math.log(local_error(scales.rtol))) / FINER
    return ShapeGrid(half, 2 * math.ceil(half / spacing) + 1)


def local_error(rtol: float) -> float:
    """What a step of the integrator may err by, over the largest F."""
    return min(max(LOCAL * rtol, LEAST_LOCAL), MOST_LOCAL)


def velocity_grid(scales: Scales) -> PhaseSpaceGrid:
    """The points in v on which f is looked at, and written."""
    state, noise = _state(scales), scales.scene.model.noise
    assert state is not None
    low, high = scales.means
    reach = ROOM * max(_reach(scales), state.reach * math.sqrt(noise))
    narrowest = math.sqrt(min(scales.narrowest, state.temperature * noise))
    nv = math.ceil((high - low + 2 * reach) / narrowest * POINTS)
    return PhaseSpaceGrid(1, nv, scales.scene.pipe.length, low - reach, high + reach)


def at_rest(scales: Scales, shape: Shape) -> Shape:
    """The homogeneous state as F, on the points of this shape and of its variance."""
    state, noise = _state(scales), scales.scene.model.noise
    assert state is not None
    width = math.sqrt(state.temperature / shape.variance)
    f = width * state.distribution(width * points(shape.half, shape.count)).real
    return Shape.of(f, shape.mass, shape.mean, width * math.sqrt(noise), shape.half, shape.even)


def seconds(scales: Scales) -> float:
    """Of a run, on the machine of plan/cost.py's constants: evaluations of the rate, each a few matrix products."""
    law, model = scales.law, scales.scene.model
    assert isinstance(law, Inelastic)
    number = law.cross_section * scales.rho_max * math.sqrt(model.noise) / model.friction
    evaluations = EVALUATIONS + BY_NUMBER * math.log10(1 + number) + AT_LEAST * (len(scales.times) - 2)
    return evaluations * (CALLS + RATE * shape_grid(scales).count ** 2)


def _reach(scales: Scales) -> float:
    """Of the start's Gaussians from the mean of all, to round-off."""
    off = abs(scales.mean_velocity[:, 0] - scales.start.mean_velocity)
    return float((off + (2 * DIGITS * scales.temperature[:, 0]) ** 0.5).max())


def _state(scales: Scales) -> InelasticFlow | None:
    """The homogeneous one, in units of √σ; None where it cannot be computed."""
    law, model = scales.law, scales.scene.model
    assert isinstance(law, Inelastic)
    with contextlib.suppress(SceneError):
        return inelastic_flow(law.restitution, law.cross_section * scales.rho_max * math.sqrt(model.noise) / model.friction)
    return None
