"""Which scheme serves each part of the equation, and the longest step: made from the criteria of in_x.py, in_v.py and in_t.py.

What `[grid]` gives is kept; what cannot be is refused, with SceneError.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np

from kinetic_solver import initial
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions import has_deposit, has_hermite
from kinetic_solver.operators.velocity.kernel import resolved_spacing
from kinetic_solver.plan import in_finite_volumes, in_t, in_v, in_x, measured
from kinetic_solver.plan.cooling import cooling_frame
from kinetic_solver.plan.criterion import strictest
from kinetic_solver.plan.edges import longest_bounded_step
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import Waves
from kinetic_solver.scene import Deposit, DriftDiffusionScheme, Scene, SteppingScheme, VelocityScheme

WORTH_MOVING = 1.5
"""How many times narrower a moving frame must make the window: frames are interpolated then. Chosen."""
FINITE_VOLUMES_COARSER = 4.0
"""How many times the dv of the kernel finite volumes of order 8 must allow, to take its place. Chosen: they are less accurate."""
FINER_WHEN_EARLY = 3
"""How many times denser points a frame needs at least that comes before the first exact step of the kernel."""
JUMP_IN_THE_LOCAL_GAUGE = 1e-4
"""rtol of f at most, where (6) steps a jump in the local gauge: on fewer points its first, unresolved moments spoil the budgets.
Chosen: R* = 4."""
LINEAR_ENOUGH = 1e-2
"""rtol from which on operator (12) takes the linear deposit, which is positive."""
PRODUCT_COST = 200
"""Velocity points at which an exact step's product with the kernel costs as much as its transforms and exponentials. Chosen: it
decides between steps of nearly the same cost."""
EXACT_STEP_PARTS = (1, 1.5, 2, 3, 4, 6, 8, 12, 16)
"""Parts of the farthest exact step that are tried."""
HERMITE_NEAR = (0.5, 1.5)
"""Temperatures over σ between which Hermite functions of variance σ are few: coefficients fall as |1 - θ/σ|^(n/2). Chosen."""


def for_thin_places(scales: Scales) -> tuple[Scene, float]:
    """The scene with the rtol that f must meet, so that mean velocity and temperature, ratios of its moments, meet that of the
    scene wherever they are given: at a density down to rtol of the largest (solver/writer.py); and what the edges may cut off."""
    scene, rtol = scales.scene, scales.rtol
    of_edges = rtol
    if scene.output.moments is not False:
        of_edges = scales.stricter_at_edges(rtol)
        rtol = min(rtol, scales.stricter(rtol))
    if Waves(scales).products_of_a_step and scales.amplifies:
        rtol = min(rtol, JUMP_IN_THE_LOCAL_GAUGE)
    return scene.model_copy(update={"accuracy": scene.accuracy.model_copy(update={"rtol": rtol})}), of_edges


def check_given(scales: Scales) -> None:
    """Refuses what no tolerance could excuse."""
    scene = scales.scene
    if scene.initial.eigenmodes:
        initial.check_eigenmodes(scene, scales.start.mean_velocity, scales.start.temperature)
    if scene.grid.velocity_window is not None:
        (low, high), (slowest, fastest) = scene.grid.velocity_window, scales.flow
        if not (low < slowest and fastest < high):
            holding = in_v.window(scales)
            raise SceneError(
                f"grid.velocity_window = [{low:g}, {high:g}]: does not hold the mean velocities from {slowest:.4g} to "
                f"{fastest:.4g} that the flow takes; allowed: one that does, as [{holding.low:.4g}, {holding.high:.4g}]"
            )
    if scene.grid.nx is not None and not scales.start.homogeneous:
        least = in_x.least_points(scales)
        if scene.grid.nx < least:
            raise SceneError(f"grid.nx = {scene.grid.nx}: cannot hold the initial state; allowed: {least} or more")


def reference_frame(scales: Scales, clocked: Callable[[ReferenceFrame], Scales]) -> tuple[ReferenceFrame, Scales]:
    """The frame to solve in, and the scales there: a moving one where gravity would ask for a much wider window, or friction
    without noise, or collisions without friction and noise, for an ever finer dv. `clocked` gives the scales in a frame."""
    scene, given = scales.scene, scales.scene.grid
    rest = ReferenceFrame(scene.model)
    if given.nv or given.velocity_window or given.velocity == "hermite" or scene.output.moment_equations:
        return rest, scales
    moving = ReferenceFrame(scene.model, moving=True, start=scales.start.mean_velocity)
    if moving.noiseless and (cooling := cooling_frame(scales, moving)) is not None:
        return cooling, clocked(cooling)
    if moving.noiseless:
        return (moving, clocked(moving)) if scales.shifted else (rest, scales)
    there = clocked(moving)
    here_window, there_window = in_v.window(scales), in_v.window(there)
    # Finite volumes, which stand in for the kernel where noise hardly acts, want the terminal velocity within the window.
    outside = not here_window.low < scene.model.gravity / scene.model.friction < here_window.high
    if here_window.width > WORTH_MOVING * there_window.width or outside:
        return moving, there
    return rest, scales


def velocity(scales: Scales) -> VelocityScheme:
    """As given, or points."""
    scene, model, law = scales.scene, scales.scene.model, scales.law
    name = scene.grid.velocity or "points"
    if name == "points":
        return name
    if law is not None and not has_hermite(law):
        raise SceneError(
            f"grid.velocity = 'hermite': operator {law.label} has no rate in Hermite functions; allowed here: 'points'"
        )
    hottest = float(scales.temperature.max())
    if model.noise > 0 and hottest >= 2 * model.noise:
        raise SceneError(
            f"grid.velocity = 'hermite': functions of variance noise = {model.noise:g} cannot hold a temperature of "
            f"{hottest:g}, twice that or more; allowed here: 'points'"
        )
    if model.friction * model.noise == 0:
        raise SceneError("grid.velocity = 'hermite': needs friction > 0 and noise > 0; allowed here: 'points'")
    if scene.grid.stepping in ("strang", "exponential") or scene.grid.drift_diffusion is not None:
        raise SceneError(
            f"grid.velocity = 'hermite': has no '{scene.grid.stepping or 'strang'}' stepping and no drift_diffusion scheme; "
            "remove grid.stepping or "
            "grid.drift_diffusion, or set grid.velocity = 'points'"
        )
    return name


def hermite_may_pay(scales: Scales) -> bool:
    """Whether Hermite functions are worth counting: for (12), near σ at all times, and nothing said that speaks of points."""
    scene, sigma, given, law = scales.scene, scales.scene.model.noise, scales.scene.grid, scales.law
    if law is None or law.linearises or not has_hermite(law):
        return False
    if scene.model.friction * sigma == 0 or not scales.start.closed_form:
        return False
    if any((given.nv, given.velocity_window, given.velocity, given.stepping, given.drift_diffusion, given.deposit)):
        return False
    low, high = HERMITE_NEAR
    return scales.theta_min > low * sigma and scales.theta_max < high * sigma


def stepping(scales: Scales) -> SteppingScheme:
    """As given; else exact where there is an exact step."""
    law, given = scales.law, scales.scene.grid.stepping
    if law is None:
        return "exact"
    able = law.name in measured.STRANG_ERROR
    if given == "exponential" and law.linearises:
        raise SceneError(f"grid.stepping = 'exponential': operator {law.label} has an exact step; allowed: 'exact'")
    if given == "exact" and not law.linearises:
        allowed = "'extrapolated', 'strang'" if able else "'extrapolated'"
        raise SceneError(f"grid.stepping = 'exact': operator {law.label} has no exact step; allowed: {allowed}")
    if given == "strang" and not able:
        raise SceneError(f"grid.stepping = 'strang': operator {law.label} has no substep; allowed: 'extrapolated'")
    return given or ("exact" if law.linearises else "extrapolated")


def drift_diffusion(scales: Scales, waves: Waves) -> DriftDiffusionScheme:
    """As given; else the kernel, but where noise hardly acts with (6), which needs accuracy relative to f: the kernel has that
    where dv resolves its width."""
    model, given = scales.scene.model, scales.scene.grid.drift_diffusion
    if model.friction * model.noise == 0 and given not in (None, "kernel"):
        raise SceneError(f"grid.drift_diffusion = {given!r}: needs friction > 0 and noise > 0; allowed here: 'kernel'")
    if given is None and scales.amplifies and model.friction * model.noise > 0:
        longest = in_t.farthest_exact_step(scales)
        kernel = in_v.exact_step_spacing(scales, waves, longest)
        # A frame within the first step is found on finer points (solver/scheme.py), if dv is that of the kernel.
        early = float(np.mean(scales.times[1:] < longest * (1 - 1e-9)))
        enough = FINITE_VOLUMES_COARSER * kernel / math.sqrt(1 + (FINER_WHEN_EARLY**2 - 1) * early)
        # The first question costs least, and is answered by no in most scenes.
        if (
            in_v.steepest(scales) > enough
            and in_v.for_weak_noise(scales, waves, longest) > enough
            and strictest(in_v.spacings(scales, waves, in_v.Schemes("exact", "finite-volume-8", None, longest))).value > kernel
        ):
            return "finite-volume-8"
    return given or "kernel"


def deposit(scales: Scales) -> tuple[Deposit | None, str | None]:
    """Of laws of pairs that have no scheme of their own, and the reason where it was not given."""
    scene = scales.scene
    if not has_deposit(scales.law):
        return None, None
    if scene.grid.deposit:
        return scene.grid.deposit, None
    if scene.accuracy.rtol >= LINEAR_ENOUGH:
        return "linear", "positive, and accurate enough"
    return "quintic", "fewest points in v"


def time_step(
    scales: Scales, waves: Waves, stepping: SteppingScheme, velocity: VelocityScheme, window: tuple[float, float]
) -> tuple[float | None, str | None]:
    """The longest step (None: from time 0 to each frame), and the reason where it was not given."""
    scene, given = scales.scene, scales.scene.grid.time_step
    if stepping == "exact":
        return _exact_step(scales, waves, velocity, window)
    if given:
        return given, None
    if stepping == "strang":
        found = in_t.longest_strang_step(scales, waves)
        return found.value, found.reason
    limits = [in_t.longest_gap(scales)]
    if scene.output.budgets is not False and scales.amplifies and velocity == "points":
        limits.append(in_t.budget_step(scales))
    found = strictest(limits)
    return found.value, "error control; at most " + found.reason


def _exact_step(
    scales: Scales, waves: Waves, velocity: VelocityScheme, window: tuple[float, float]
) -> tuple[float | None, str | None]:
    """From link to link: of the run's length, whatever the frames."""
    scene, given = scales.scene, scales.scene.grid.time_step
    collide = scales.law is not None
    farthest, (low, high) = scales.end, window
    if collide:
        farthest = in_t.farthest_exact_step(scales)
        if velocity == "points":
            farthest = longest_bounded_step(scales, low, high, farthest)
        farthest = in_t.filling(scales, farthest)
    if collide and given:
        return in_t.filling(scales, min(given, farthest)), None
    cheapest = farthest
    if velocity == "points" and scene.grid.nv is None:
        cheapest = cheapest_exact_step(scales, waves, high - low, farthest)
    if not collide and cheapest == scales.end:
        return None, None
    return cheapest, "exact; " + (
        "fewest points in v" if cheapest < farthest else "how far collisions move the flow within a step"
    )


def cheapest_exact_step(scales: Scales, waves: Waves, width: float, farthest: float) -> float:
    """Shorter steps shear less, so dv may be coarser, until the kernel of a step asks for a finer one."""
    best, fewest = (math.inf, 0.0), width / in_v.coarsest(scales, waves)
    for n in EXACT_STEP_PARTS:
        if n * fewest * (PRODUCT_COST + fewest) > best[0]:
            break  # nor can more parts be cheaper
        h = in_t.filling(scales, farthest / n)
        points = width / strictest(in_v.spacings(scales, waves, in_v.Schemes("exact", "kernel", None, h))).value
        best = min(best, (n * points * (PRODUCT_COST + points), h))
    return best[1]


def warn_of_waves_left_out(scales: Scales, waves: Waves) -> None:
    """Where a given nx leaves out waves of a smooth start, and nothing couples them: with collisions the monitor looks."""
    nx = scales.scene.grid.nx
    if nx is None or scales.start.band_limited or scales.scene.initial.step is not None or scales.law is not None:
        return
    if (lost := waves.beyond(nx)) > scales.rtol:
        warnings.warn(
            f"grid.nx = {nx}: leaves out waves of the start that carry {lost:.2g} of it (accuracy.rtol = {scales.rtol:g}); raise "
            "it, or leave it out",
            stacklevel=3,
        )


def warn_of_a_long_strang_step(scales: Scales, waves: Waves) -> None:
    """A given step is kept as given."""
    h = scales.scene.grid.time_step
    if h is not None and (error := in_t.strang_error(scales, waves, h)) > scales.rtol:
        warnings.warn(
            f"grid.time_step = {h:g}: Strang's splitting errs by about {error:.2g} of max f (accuracy.rtol = {scales.rtol:g}); "
            "reduce it, or leave it out",
            stacklevel=3,
        )


def warn_of_an_unresolved_kernel(
    scales: Scales, grid: PhaseSpaceGrid, shortest: float | None, drift_diffusion: DriftDiffusionScheme
) -> None:
    """Where dv is too coarse for the kernel of a run's steps with (6), none longer than this, and what takes its place, finite
    volumes of order 8, errs by more than rtol."""
    model = scales.scene.model
    kernel = drift_diffusion == "kernel" and model.friction * model.noise > 0
    if shortest is None or not kernel or not scales.amplifies:
        return
    h = in_t.shortest_step_that_fills(scales, shortest)
    resolved = resolved_spacing(model, h)
    coefficient, order = measured.FINITE_VOLUME_ERROR["finite-volume-8"]
    error = coefficient * in_finite_volumes.tail_weight(scales) * (grid.dv / math.sqrt(model.noise)) ** order
    if grid.dv > resolved and error > scales.rtol:
        enough = math.ceil((grid.high - grid.low) / resolved)
        warnings.warn(
            f"dv = {grid.dv:.3g} is too coarse for the Ornstein-Uhlenbeck kernel of a step of {h:.3g}, and what takes its "
            f"place errs by about {error:.1g} (accuracy.rtol = {scales.rtol:g}); raise grid.nv to {enough} or lengthen "
            "grid.time_step",
            stacklevel=3,
        )
