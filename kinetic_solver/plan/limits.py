"""What no plan may exceed: velocities, memory, turns around the pipe. Refusals name the keys that may mend them (refusal.py)."""

from __future__ import annotations

import math
import warnings

import numpy as np

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.machine import too_large
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.refusal import MORE_RTOL, Refused, Remedy
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import Waves

MOST_VELOCITIES = 20_000
"""Of a grid that is not given, and of the output in a moving frame. Chosen: products with kernels of that size take seconds."""
FEWER_VELOCITIES = (
    Remedy("run.end_time", "less"),
    Remedy("initial.mean_velocity", "less"),
    Remedy("model.gravity", "less"),
    Remedy("initial.temperature", "more"),
    Remedy("initial.temperature", "less"),
    Remedy("model.noise", "less"),
    Remedy("model.noise", "more"),
    Remedy("collisions.cross_section", "less"),
    Remedy("initial.density", "less"),
    Remedy("model.friction", "less"),
    Remedy("model.friction", "more"),
    Remedy("pipe.length", "more"),
    MORE_RTOL,
)
"""What may bring the number of velocities down."""

DEVIATIONS = 37.6
"""From the mean, at which a Gaussian is still a double of full precision: exp(-708). Measured: with 39 f erred by 2 rtol (1e-4),
with 42 by 4000, and nothing of it was told. tests/contracts/test_refusals.py."""
FEWER_COLLISIONS = (
    Remedy("run.end_time", "less"),
    Remedy("collisions.cross_section", "less"),
    Remedy("initial.density", "less"),
    Remedy("initial.temperature", "less"),
    Remedy("model.friction", "more"),
    MORE_RTOL,
)
"""What may keep the flow within reach of what is known of its start."""


def of_velocities(nv: int, reason: str) -> None:
    """Raises Refused for more than MOST_VELOCITIES."""
    if nv > MOST_VELOCITIES:
        raise Refused(f"grid.nv: {nv:.3g} would be needed, more than {MOST_VELOCITIES} ({reason})", FEWER_VELOCITIES)


def of_memory(needed: int, grid: PhaseSpaceGrid) -> None:
    """Raises Refused where this machine cannot hold a plan."""
    if (why := too_large(needed)) is not None:
        given = (Remedy("grid.nx", "less"), Remedy("grid.nv", "less"), Remedy("pipe.length", "less"))
        raise Refused(f"grid: nx = {grid.nx}, nv = {grid.nv} {why}", (*given, *FEWER_VELOCITIES))


def check_memory(needed: int, grid: PhaseSpaceGrid) -> None:
    """Likewise of a plan that a run changes to: raises SceneError, without trying what else would do."""
    if (why := too_large(needed)) is not None:
        raise SceneError(f"grid: nx = {grid.nx}, nv = {grid.nv} {why}; raise accuracy.rtol, or give grid.nx and grid.nv")


def of_turns(scales: Scales, waves: Waves, frame: ReferenceFrame) -> None:
    """Raises Refused where the flow has gone around the pipe so often in the end that doubles do not know where it is."""
    there = frame.place(scales.end)
    turns = abs(there.position) / scales.scene.pipe.length
    if 2 * math.pi * waves.highest_mode * turns * np.finfo(float).eps > scales.rtol:
        raise Refused(
            f"run.end_time = {there.time:g}: the flow goes {turns:.2g} times around the pipe by then, and of so many doubles "
            "do not know the last",
            (
                Remedy("run.end_time", "less"),
                Remedy("initial.mean_velocity", "less"),
                Remedy("model.gravity", "less"),
                Remedy("pipe.length", "more"),
                MORE_RTOL,
            ),
        )


def of_doubles(scales: Scales) -> None:
    """With (6) whoever is in the flow at a time t comes from Sρ̄r√θ0 standard deviations below the start's mean velocity,
    r = (1 - exp(-γt))/γ: there, and as far beyond it as f is looked at, f must still be a double, or all of it is lost unseen."""
    if not scales.amplifies:
        return
    drift, thermal = scales.whole.drift_time, math.sqrt(float(scales.temperature.max()))
    deviations = scales.cross_section * scales.scene.initial.density * drift * thermal + scales.tail
    if deviations <= DEVIATIONS:
        return
    text = (
        f"collisions.cross_section = {scales.cross_section:g}: until the end the flow slows down to where its start "
        f"has only what is {deviations:.3g} standard deviations from the mean, and a double holds {DEVIATIONS:.3g}"
    )
    if scales.scene.grid.nv is None:
        raise Refused(text, FEWER_COLLISIONS)
    warnings.warn(f"{text}; lower it, or end the run before", stacklevel=3)
