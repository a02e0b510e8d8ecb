"""What a run will use, decided before it starts: grid, window, step, schemes, memory. The rules are in rules.py."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.plan.moving_frame import Frame
from kinetic_solver.plan.rules import Rules, frame_times
from kinetic_solver.scene import FOLLOW_LEADER, Scene

WORTH_MOVING = 1.5
"""How much narrower a moving frame must make the window: frames are interpolated then."""
MOST_VELOCITIES = 20_000
"""Of the output of a noiseless run."""
STATE_ARRAYS = 30
"""Arrays of the size of f alive at once: the state, its transform, collision stages, diagnostics."""


@dataclass(frozen=True)
class Plan:
    """The discretisation of one run. What is stepped is `inner`, the scene in its frame of reference."""

    scene: Scene
    frame: Frame
    inner: Scene
    times: Array
    """When anything is written, by the frame's clock."""
    grid: PhaseSpaceGrid
    """Of the first step: error control may change it."""
    output: PhaseSpaceGrid
    """Of the dataset, in the laboratory: fixed."""
    velocity: str
    """"points" or "hermite"."""
    stepping: str
    """"exact", "extrapolated" or "strang"."""
    time_step: float | None
    """Longest step; None: from frame to frame, or as error control finds."""
    shortest_step: float
    """Exact steps shorter than this are not built upon: their kernel is not resolved."""
    drift_diffusion: str
    deposit: str | None
    expected_steps: int
    """Exactly so many; with error control, about."""
    error_share: float = 1.0
    """Of rtol, to local errors: less where operator (6) amplifies them."""
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def symmetric(self) -> bool:
        """True where the quadrature path's base method is Strang's: both substeps are exact."""
        return self.velocity == "points" and self.scene.operator == FOLLOW_LEADER

    @property
    def controlled(self) -> bool:
        """True where steps are found while running."""
        return self.stepping == "extrapolated" and self.scene.grid.time_step is None

    @property
    def memory_time(self) -> float:
        """How long errors last: the run, or a few relaxation times; by the frame's clock."""
        friction = self.inner.model.friction
        return min(self.inner.run.end_time, 5 / friction if friction > 0 else math.inf)

    @property
    def memory(self) -> int:
        """Bytes: the arrays of f's size, and kernels and phases for the step lengths in use."""
        nx, nv = self.grid.nx, self.grid.nv
        lengths = {"exact": 2, "strang": 2, "extrapolated": 8}[self.stepping]
        propagators, kernels = 16 * (nx // 2 + 1) * nv**2, 8 * (nv**2 + 4 * nx * nv)
        tables = lengths * (propagators if self.velocity == "hermite" else kernels)
        return 8 * STATE_ARRAYS * nx * nv + tables + 8 * 3 * nv**2


def make_plan(scene: Scene) -> Plan:
    """Choose what the scene leaves open. Raises SceneError where no grid in this machine's memory can do it."""
    reasons: dict[str, str] = {}
    if scene.initial.file is not None:
        scene = _on_the_files_grid(scene, reasons)
    try:
        return _make_plan(scene, reasons)
    except (OverflowError, ZeroDivisionError) as error:
        groups = scene.groups
        raise SceneError(
            f"the scene's numbers are out of range ({error}): R* = {groups.collision_number:.3g}, L* = {groups.length:.3g}, "
            f"end_time = {scene.run.end_time:.3g}; allowed: what double precision can hold"
        ) from None


def _make_plan(scene: Scene, reasons: dict[str, str]) -> Plan:
    rules = Rules(scene, reasons)
    rules.check_given()
    frame = _frame(rules)
    lab, scene = scene, frame.scene(scene)
    times = np.array([frame.clock(float(time)) for time in frame_times(lab)])
    if frame.moving:
        reasons.clear()
        rules = Rules(scene, reasons, times)
        rules.lab_friction = lab.model.friction
    velocity, stepping = rules.velocity(), rules.stepping()
    window = scene.grid.velocity_window or rules.window()
    deposit = rules.deposit()
    drift_diffusion = rules.drift_diffusion()
    time_step = rules.time_step(stepping, velocity, window)
    if velocity == "hermite":
        nv = shown = scene.grid.nv or rules.hermite_count()
    else:
        nv = shown = scene.grid.nv or rules.nv(window, stepping, time_step, deposit, drift_diffusion)
        if rules.hermite_pays(nv):
            velocity, nv = "hermite", rules.hermite_count()
    nx = scene.grid.nx or rules.nx()
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, *window)
    shortest = 0.0
    if stepping == "exact" and velocity == "points" and drift_diffusion == "kernel":
        shortest = rules.shortest_exact_step(grid)
    elif stepping == "strang":
        rules.warn_of_a_long_strang_step()
        rules.warn_of_an_unresolved_kernel(grid, time_step, drift_diffusion)
    steps, share = rules.expected_steps(stepping, time_step), rules.error_share()
    output = _output_grid(replace(grid, nv=shown), frame, times, lab)
    plan = Plan(
        lab, frame, scene, times, grid, output, velocity, stepping, time_step, shortest, drift_diffusion, deposit, steps, share,
        reasons,
    )  # fmt: skip
    check_memory(plan)
    return plan


def _frame(rules: Rules) -> Frame:
    """A moving frame where gravity would ask for a much wider window, or friction without noise for an ever finer dv."""
    scene = rules.scene
    given = scene.grid
    rest, moving = Frame(scene.model), Frame(scene.model, moving=True, start=rules.u0)
    if given.nv or given.velocity_window or given.velocity == "hermite" or scene.initial.file or scene.output.moment_equations:
        return rest
    if moving.noiseless:
        return moving if rules.shifted() else rest
    (low, high), (inner_low, inner_high) = rules.window(), Rules(moving.scene(scene), {}).window()
    # Finite volumes, which stand in for the kernel where noise hardly acts, want the terminal velocity within the window.
    worth = high - low > WORTH_MOVING * (inner_high - inner_low) or not low < scene.model.gravity / scene.model.friction < high
    return moving if worth else rest


def _output_grid(grid: PhaseSpaceGrid, frame: Frame, times: Array, scene: Scene) -> PhaseSpaceGrid:
    """Holds all that the solver's first window holds, at every frame, with its resolution."""
    if not frame.moving:
        return grid
    places = [frame.place(float(clock)) for clock in times]
    low = min(place.velocity + place.scale * grid.low for place in places)
    high = max(place.velocity + place.scale * grid.high for place in places)
    nv = math.ceil((high - low) / (grid.dv * min(place.scale for place in places)) - 1e-9)
    if nv > MOST_VELOCITIES:
        raise SceneError(
            f"run.end_time = {scene.run.end_time:g}: without noise the velocity distribution becomes so narrow that the output "
            f"would need {nv} velocities; allowed: {MOST_VELOCITIES}; end the run earlier"
        )
    return PhaseSpaceGrid(grid.nx, nv, grid.length, low, high)


def _on_the_files_grid(scene: Scene, reasons: dict[str, str]) -> Scene:
    """The rules below are for Maxwellian starts; a start from a file keeps the file's grid where [grid] names no other."""
    nx, nv, low, high = initial.file_grid(scene)
    of_file: dict[str, Any] = {"nx": nx}
    if scene.grid.velocity_window is None:
        of_file |= {"nv": nv, "velocity_window": (low, high)}
    missing = {name: value for name, value in of_file.items() if getattr(scene.grid, name) is None}
    reasons.update(dict.fromkeys(missing, "as in initial.file"))
    return scene.model_copy(update={"grid": scene.grid.model_copy(update=missing)})


def check_memory(plan: Plan) -> None:
    """Raises SceneError where this machine cannot hold the plan."""
    available = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if plan.memory > 0.9 * available:
        g = plan.grid
        raise SceneError(
            f"grid: nx = {g.nx}, nv = {g.nv} need {plan.memory / 2**30:.3g} GiB, this machine has {available / 2**30:.3g} GiB; "
            "reduce nx or nv, or raise accuracy.rtol"
        )
