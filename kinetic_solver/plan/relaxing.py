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
from kinetic_solver.plan.waves import Waves
from kinetic_solver.rounding import rounded
from kinetic_solver.scene import DriftDiffusionScheme, SteppingScheme, VelocityScheme
from kinetic_solver.stability.homogeneous import HomogeneousState, homogeneous_state

MOST_TABLES = 4e8
"""Bytes of the tables of three step lengths, beyond which it is not considered. Chosen."""
SHARED = 0.4
"""Of the tables' cost that is counted: later runs of the process find them. Chosen."""
TABLE_SECONDS = 2.4e-8
"""Of all tables of a run, over nx/2·nv³, where the machine's pace (cost.py) is 1. Measured like all seconds here with seeds 0 to
43 of benchmarks/random_scenes.py at rtol 1e-3 to 1e-5 and the scenes of benchmarks/against.py, 25 × 23 to 105 × 124 points:
within a factor of 1.6 for tables, 1.2 for steps. Between methods only their ratios matter."""
LAWSON_STEP, EXPONENTIAL_STEP = (1.5e-9, 5.7e-7, 4.2e-4), (1.06e-8, 4.0e-7, 4.0e-4)
"""Seconds of a step: over nx·nv², over nx·nv, and of its calls."""
STARTING, RELAXING, BY_RTOL, BY_RATE, ACTIVE, LATER = 2.7, 1.9, 0.2, 0.42, 2.0, 1.2
"""The exponential method takes about (a + b |ln θ0/θ_h|)(1e-3/rtol)^p (Λ min(t, d/γ))^q + e γt steps, tries included, but at
least one to a frame; measured on those scenes and of benchmarks/random_kinds.py: within a factor of two in 84 %."""
WIDTH = 2.0
"""Of the homogeneous state in dv, and of the window's edges from its mean in such widths, at the least. Chosen."""


def chosen(
    scales: Scales, waves: Waves, grid: PhaseSpaceGrid, velocity: VelocityScheme, drift_diffusion: DriftDiffusionScheme
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
    ours, theirs = exponential_seconds(scales, waves, grid), lawson_seconds(scales, waves, grid)
    cheaper = f"by its rule the {'cheaper' if ours < theirs else 'dearer'} one: {ours:.2g} s to {theirs:.2g} s"
    return ("exponential" if ours < theirs else "extrapolated"), f"relaxation to the homogeneous state is {cheaper}"


def lawson_seconds(scales: Scales, waves: Waves, grid: PhaseSpaceGrid) -> float:
    """Of a run by Lawson's method."""
    return in_t.lawson_steps(scales, waves) * _of_a_step(grid, LAWSON_STEP)


def exponential_steps(scales: Scales, waves: Waves) -> float:
    """Of a run by the exponential method, about."""
    state, friction = _state(scales), scales.scene.model.friction
    assert state is not None
    off = abs(math.log(float(scales.temperature.max()) / state.temperature))
    active = in_t.commutation_rate(scales, waves) * min(scales.end, ACTIVE / friction)
    early = max(1.0, 1e-3 / scales.rtol) ** BY_RTOL * max(1.0, active) ** BY_RATE
    steps = (STARTING + RELAXING * off) * early + LATER * friction * scales.end
    return max(len(scales.times) - 1.0, steps, in_t.steps_after_a_jump(scales, waves))


def exponential_seconds(scales: Scales, waves: Waves, grid: PhaseSpaceGrid, shared: float = SHARED) -> float:
    """Of a run by the exponential method, with this share of its tables."""
    tables = shared * TABLE_SECONDS * (grid.nx // 2 + 1) * grid.nv**3
    return tables + exponential_steps(scales, waves) * _of_a_step(grid, EXPONENTIAL_STEP)


def _of_a_step(grid: PhaseSpaceGrid, seconds: tuple[float, float, float]) -> float:
    matrix, point, call = seconds
    return (matrix * grid.nv + point) * grid.nx * grid.nv + call


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
