"""Whether operator (12) is stepped by its relaxation to the homogeneous state (operators/relaxation.py), or by Lawson's method.

The exponential method's steps are bound by neither stability nor the collisions' own rate, but its tables, a dense matrix for
every wavenumber, cost what many of Lawson's steps do: few waves, narrow windows, many collisions and long runs are its own.
"""

from __future__ import annotations

import contextlib
import math

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import Inelastic
from kinetic_solver.plan import in_t
from kinetic_solver.plan.scales import Scales
from kinetic_solver.rounding import rounded
from kinetic_solver.scene import DriftDiffusionScheme, SteppingScheme, VelocityScheme
from kinetic_solver.stability.homogeneous import HomogeneousState, homogeneous_state

MOST_TABLES = 4e8
"""Bytes of the tables of three step lengths, beyond which it is not considered. Chosen."""
SHARED = 0.4
"""Of the tables' cost that is counted: later runs of the process find them. Chosen."""
TABLE_SECONDS = 2.5e-8
"""Of all tables of a run, over nx/2·nv³: about 60 products of complex matrices. Measured like all seconds here on one core of an
AMD EPYC, 25 × 23 to 63 × 121 points; only their ratios matter. benchmarks/against.py, docs/performance.md."""
RATE_SECONDS, CALL_SECONDS = 3.75e-10, 1.5e-5
"""Of a collision rate: over nx·nv², and besides."""
LINEAR_SECONDS, TRANSFORM_SECONDS = 5e-11, 1.5e-8
"""Of a linear step: over nx·nv² and over nx·nv."""
MATRIX_SECONDS, FARTHER_SECONDS = 1e-9, 2.5e-9
"""Of a table's product with a state, over nx/2·nv²: from the second-level cache, and from memory."""
CACHE = 2e7
"""Bytes of tables that stay in that cache."""
RATES, LINEAR, PRODUCTS = 12, 20, 18
"""Of an extrapolated step: collision rates, linear steps of Lawson's method, and products with tables of the other."""
STARTING, RELAXING, LATER, BY_RTOL = 3.0, 6.0, 1.5, 1 / 6
"""The exponential method takes about (a + b |ln θ0/θ_h| + c γt)(1e-3/rtol)^p steps; measured, S from 2 to 50, t to 20/γ."""
WIDTH = 2.0
"""Of the homogeneous state in dv, and of the window's edges from its mean in such widths, at the least. Chosen."""
DYADIC = 1.7
"""By how many times more steps Lawson's method takes, powers of two of an interval, than stability alone asks for; measured."""


def chosen(
    scales: Scales, grid: PhaseSpaceGrid, velocity: VelocityScheme, drift_diffusion: DriftDiffusionScheme
) -> tuple[SteppingScheme, str]:
    """The stepping of a scene that error control steps, as given or the cheaper, and why. Raises SceneError where what is given
    cannot be."""
    given = scales.scene.grid.stepping
    why_not = _obstacle(scales, grid, velocity, drift_diffusion)
    if given == "exponential":
        if why_not is not None:
            raise SceneError(f"grid.stepping = 'exponential': {why_not}; allowed: 'extrapolated'")
        return given, "as given"
    if given is not None:
        return given, "as given"
    if scales.amplifies:
        return "extrapolated", ""
    if why_not is not None:
        return "extrapolated", why_not
    if grid.nx == 1:
        return "exponential", "relaxation to the homogeneous state"
    ours, theirs = exponential_seconds(scales, grid), lawson_seconds(scales, grid)
    cheaper = f"by its rule the {'cheaper' if ours < theirs else 'dearer'} one: {ours:.2g} s to {theirs:.2g} s"
    return ("exponential" if ours < theirs else "extrapolated"), f"relaxation to the homogeneous state is {cheaper}"


def lawson_seconds(scales: Scales, grid: PhaseSpaceGrid) -> float:
    """Of a run by Lawson's method, where stability at the window's edge limits its steps."""
    steps = STARTING + DYADIC * scales.end * scales.collision_rate * scales.tail / in_t.STABLE
    points = grid.nx * grid.nv
    rate = RATE_SECONDS * points * grid.nv + CALL_SECONDS
    linear = (LINEAR_SECONDS * grid.nv + TRANSFORM_SECONDS) * points
    return steps * (RATES * rate + LINEAR * linear)


def exponential_steps(scales: Scales) -> float:
    """Of a run by the exponential method, about."""
    state = _state(scales)
    assert state is not None
    off = abs(math.log(float(scales.temperature.max()) / state.temperature))
    steps = STARTING + RELAXING * off + LATER * scales.scene.model.friction * scales.end
    return steps * max(1.0, 1e-3 / scales.rtol) ** BY_RTOL


def exponential_seconds(scales: Scales, grid: PhaseSpaceGrid, shared: float = SHARED) -> float:
    """Of a run by the exponential method, with this share of its tables."""
    steps = exponential_steps(scales)
    points, waves = grid.nx * grid.nv, grid.nx // 2 + 1
    product = waves * grid.nv**2 * (MATRIX_SECONDS if _bytes(grid) < CACHE else FARTHER_SECONDS)
    rate = RATE_SECONDS * points * grid.nv + CALL_SECONDS + 2 * TRANSFORM_SECONDS * points
    return shared * TABLE_SECONDS * waves * grid.nv**3 + steps * (RATES * rate + PRODUCTS * product)


def _obstacle(
    scales: Scales, grid: PhaseSpaceGrid, velocity: VelocityScheme, drift_diffusion: DriftDiffusionScheme
) -> str | None:
    """Why there is no such relaxation, or none that is known or fits; None where there is."""
    model = scales.scene.model
    if not isinstance(scales.law, Inelastic):
        return "relaxation to a homogeneous state is known of inelastic collisions (12) alone"
    if model.friction * model.noise == 0 or scales.noise_hardly_acts:
        return "no friction and noise lead to a homogeneous state"
    if velocity != "points" or drift_diffusion != "kernel":
        return "relaxation to the homogeneous state wants velocity points and the kernel"
    if scales.scene.grid.time_step is not None:
        return "steps are given"
    if _bytes(grid) > MOST_TABLES:
        return "its tables would be too large"
    state = _state(scales)
    if state is None:
        return "the homogeneous state is not known"
    width = math.sqrt(state.temperature)
    if not (width > WIDTH * grid.dv and grid.low + WIDTH * width < state.mean_velocity < grid.high - WIDTH * width):
        return "the grid does not hold the homogeneous state"
    return None


def _state(scales: Scales) -> HomogeneousState | None:
    """At the mean density."""
    start = scales.scene.initial.model_copy(update={"density": rounded(float(scales.density.mean()))})
    with contextlib.suppress(SceneError):
        return homogeneous_state(scales.scene.model_copy(update={"initial": start}))
    return None


def _bytes(grid: PhaseSpaceGrid) -> float:
    """Of the tables of three lengths, three functions each."""
    return 9.0 * 16 * (grid.nx // 2 + 1) * grid.nv**2
