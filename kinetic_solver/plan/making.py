"""How a scene becomes a plan.

The way from a scene: `scales_of` (what it asks to be resolved), `choices.reference_frame`, the scales and `Waves` in that frame,
then the choices, each made from criteria that carry their reasons.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from kinetic_solver import initial
from kinetic_solver.dataset import VARIABLES
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import CollisionLaw, check_frequency, check_law
from kinetic_solver.plan import choices, continuing, homogeneous, in_hermite, in_t, in_v, in_x, limits, measured, relaxing
from kinetic_solver.plan.cost import cost
from kinetic_solver.plan.criterion import Criterion, strictest
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.output import LEAST_VELOCITIES, output_grids
from kinetic_solver.plan.plan import Plan, Stepping
from kinetic_solver.plan.refusal import ARITHMETIC, Refused, explained, out_of_range
from kinetic_solver.plan.scales import Scales, scales_of
from kinetic_solver.plan.waves import Waves
from kinetic_solver.scene import (
    DriftDiffusionScheme,
    Scene,
    Schedule,
    VelocityScheme,
    check_is_scene,
)

CHECKED_VELOCITIES, CHECKED_REACH = 240, 9.5
"""Points, and thermal velocities, on which a law of one's own is looked at before a run: Maxwellians end there to round-off."""
AMPLIFIED = 8.0
"""R_t up to which (6) was seen to be solved whatever the start, for the same purpose. benchmarks/hard_cases.py."""
PRACTICAL = 5.0
"""Seconds that a run may take with a change that a refusal advises. Chosen."""


def make_plan(scene: Scene, law: CollisionLaw | None = None, given: initial.Given | None = None) -> Plan:
    """Choose what the scene leaves open. `law` stands in for [collisions], and `given`, an f(x, v), for [initial]: the scene must
    not have these then.

    Raises SceneError where no grid in this machine's memory can do it, where the law is not what it says, and where that f cannot
    be started from.
    """
    check_is_scene(scene)
    scene.law_with(law)
    reasons: dict[str, str] = {}
    start, recorded = None, scene
    if given is not None:
        scene, start = initial.take(scene, given)
        recorded = scene
    elif scene.initial.file is not None:
        scene, start, resolved = initial.of_file(scene)
        if not resolved:
            scene, reasons = continuing.on_the_files_grid(scene, start, law)

    def works(changed: Scene) -> bool:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            plan = _make_plan(changed, reasons, law, start)
            return cost(plan).seconds < PRACTICAL and (not plan.scales.amplifies or plan.scales.amplification < AMPLIFIED)

    try:
        return replace(_make_plan(scene, reasons, law, start), scene=recorded)
    except Refused as refused:
        raise explained(scene, refused, works) from None
    except ARITHMETIC as error:
        raise explained(scene, out_of_range(scene, error), works) from None


def _make_plan(scene: Scene, known: Mapping[str, str], law: CollisionLaw | None, start: initial.GivenStart | None) -> Plan:
    schedule = Schedule.of(scene, VARIABLES)
    here = scales_of(scene, schedule.times, law=law, start=start)
    if law is not None:
        _check(law, here)
    stricter, of_edges = choices.for_thin_places(here)
    here = replace(here, scene=stricter, of_edges=of_edges)
    choices.check_given(here)

    def clocked(frame: ReferenceFrame) -> Scales:
        times = np.array([frame.clock(float(time)) for time in schedule.times])
        seen = None if start is None else start.seen_from(frame.start)
        return scales_of(frame.scene(stricter), times, scene.model.friction, law, seen, of_edges, here.density)

    frame, scales = choices.reference_frame(here, clocked)
    continuing.check_tail(scales)
    waves, inner = Waves(scales), scales.scene
    chosen: dict[str, str | None] = dict(known)
    if frame.cooling > 0:
        chosen["reference_frame"] = f"the frame's velocities shrink with the gas, by 1 + {frame.cooling:.3g} t: it cools"
    if homogeneous.serves(scales):
        return _in_one_place(scene, here, schedule, frame, scales, chosen)
    velocity, stepping = choices.velocity(scales), choices.stepping(scales)
    low, high = inner.grid.velocity_window or _window(scales, chosen)
    deposit, chosen["deposit"] = choices.deposit(scales)
    drift_diffusion = choices.drift_diffusion(scales, waves)
    time_step, chosen["time_step"] = choices.time_step(scales, waves, stepping, velocity, (low, high))
    # Steps under error control begin with this one, and while waves are to be moved they stay about as short.
    step = time_step if inner.grid.time_step or time_step is None else min(time_step, in_t.first_step(scales, waves))
    shown = _velocities(scales, waves, velocity, in_v.Schemes(stepping, drift_diffusion, deposit, step), high - low)
    nv, chosen["nv"] = int(shown.value), chosen.get("nv", shown.reason)
    if choices.hermite_may_pay(scales):
        functions = in_hermite.count(scales, waves, nv / measured.HERMITE_PAYS)
        if measured.HERMITE_PAYS * functions.value <= nv:
            velocity, nv, chosen["nv"] = "hermite", int(functions.value), functions.reason
    if velocity == "points":
        limits.of_doubles(scales)
    if velocity == "points" and inner.grid.nv is None:
        limits.of_velocities(nv, shown.reason)
    points = Criterion(inner.grid.nx, "") if inner.grid.nx else in_x.points(scales, waves)
    chosen["nx"] = chosen.get("nx", points.reason)
    limits.of_turns(scales, waves, frame)
    choices.warn_of_waves_left_out(scales, waves)
    grid = PhaseSpaceGrid(int(points.value), nv, inner.pipe.length, low, high)
    own = scales.start if isinstance(scales.start, initial.GivenStart) and scales.start.tabulated else None
    if own is not None and velocity == "points" and inner.grid.nv is None and inner.grid.velocity_window is None:
        grid = continuing.on_its_points(grid, own)
    shortest = 0.0
    if scales.law is not None and stepping in ("extrapolated", "exponential"):
        stepping, chosen["stepping"] = relaxing.chosen(scales, waves, grid, velocity, drift_diffusion)
    if stepping == "exact" and velocity == "points" and drift_diffusion == "kernel":
        shortest = in_t.shortest_exact_step(scales, waves, grid)
    elif stepping == "strang":
        choices.warn_of_a_long_strang_step(scales, waves)
        choices.warn_of_an_unresolved_kernel(scales, grid, time_step, drift_diffusion)
    looked_at = grid if velocity == "points" else replace(grid, nv=int(shown.value))
    output, whole = output_grids(looked_at, frame, scales.times, here)
    steps = in_t.expected_steps(scales, waves, stepping, time_step)
    if stepping == "exponential":
        steps = max(steps, math.ceil(relaxing.exponential_steps(scales, waves)))
    plan = Plan(
        scene,
        here.start,
        schedule,
        frame,
        scales,
        waves,
        grid,
        output,
        whole,
        velocity,
        stepping,
        drift_diffusion,
        deposit,
        time_step,
        shortest,
        steps,
        in_t.error_share(scales),
        MappingProxyType({name: reason for name, reason in chosen.items() if reason}),
    )
    limits.of_memory(plan.memory, grid)
    return plan


def _in_one_place(
    scene: Scene, here: Scales, schedule: Schedule, frame: ReferenceFrame, scales: Scales, chosen: dict[str, str | None]
) -> Plan:
    """Of a run of (12) in which nothing depends on x."""
    grid = homogeneous.velocity_grid(scales)
    chosen["velocity_window"] = chosen["nv"] = "all that f may come to, to round-off"
    chosen["stepping"] = chosen["nx"] = "nothing depends on x"
    limits.of_velocities(grid.nv, "to hold the start, and the narrow state to which it relaxes")
    output, whole = output_grids(grid, frame, scales.times, here)
    reasons = MappingProxyType({name: reason for name, reason in chosen.items() if reason})
    schemes: tuple[VelocityScheme, Stepping, DriftDiffusionScheme] = ("points", "homogeneous", "kernel")
    steps, share = len(scales.times) - 1, in_t.error_share(scales)
    waves = Waves(scales)
    return Plan(
        scene, here.start, schedule, frame, scales, waves, grid, output, whole, *schemes, None, None, 0.0, steps, share, reasons
    )


def _check(law: CollisionLaw, scales: Scales) -> None:
    """The law on the start at two places, and on what is far from a Maxwellian: each beside a displaced one of half its width."""
    reach = CHECKED_REACH * math.sqrt(float(scales.temperature.max()))
    low, high = float(scales.mean_velocity.min()) - reach, float(scales.mean_velocity.max()) + reach
    v = low + (high - low) / CHECKED_VELOCITIES * (np.arange(CHECKED_VELOCITIES) + 0.5)
    places = [0, scales.density.size // 3]
    f, u, theta = scales.start.outline(scales.x[places], v), scales.mean_velocity[0, places], scales.temperature[0, places]
    displaced = initial.maxwellian(scales.density[places], u + np.sqrt(theta), theta / 2, v)
    check_law(law, np.concatenate([f, (f + displaced) / 2]), v, scales.rtol)
    check_frequency(law, scales.rho_max, scales.hottest)


def _window(scales: Scales, chosen: dict[str, str | None]) -> tuple[float, float]:
    window = in_v.window(scales)
    chosen["velocity_window"] = window.reason
    return window.low, window.high


def _velocities(scales: Scales, waves: Waves, velocity: VelocityScheme, schemes: in_v.Schemes, width: float) -> Criterion:
    """nv as given; else the functions or the points that are needed."""
    if scales.scene.grid.nv:
        return Criterion(scales.scene.grid.nv, "")
    if velocity == "hermite":
        return in_hermite.count(scales, waves)
    coarsest = strictest(in_v.spacings(scales, waves, schemes))
    continued = scales.amplifies and scales.amplification > continuing.STRONG
    points = max(LEAST_VELOCITIES if continued else in_v.LEAST_POINTS, math.ceil(width / coarsest.value))
    return Criterion(points, f"dv = {coarsest.value:.3g} resolves {coarsest.reason}")
