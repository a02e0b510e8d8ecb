"""The grid solver: equation (2) on phase space, from scene to Dataset."""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.budgets import Ledger
from kinetic_solver.collisions.protocol import CollisionOperator
from kinetic_solver.linearised import GridLinearisedStep
from kinetic_solver.moments import moment_equations, moments, totals
from kinetic_solver.monitor import Monitor, SolverStopped
from kinetic_solver.output import MemoryRecorder, Recorder
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.representation import Representation, collision_operator, initial_state, make_representation
from kinetic_solver.rules import Rules, frame_times
from kinetic_solver.scene import Scene, SceneError
from kinetic_solver.stepping import Controlled, ExactStep, ExactSteps, Extrapolated, LostAccuracy, Plain, Stepper, StepTooSmall
from kinetic_solver.threads import one_blas_thread

if TYPE_CHECKING:
    import xarray as xr
Progress = Callable[[float, float], None]
"""Called as progress(time, end time)."""

CHECK_EVERY = 10
"""Steps between two full checks by the monitor; NaN is looked for in every step."""


def solve(scene: Scene, progress: Progress | None = None) -> xr.Dataset:
    """Solve (2) for `scene` on the phase-space grid; return every frame as an xarray Dataset (docs/output.md).

    Exact in time without collisions and with operator (6); with (12) of high order, under error control. Mass is conserved to
    round-off. Raises SceneError where the scene cannot be run, and SolverStopped, with the frames so far as its `dataset`, where
    a run cannot go on.
    """
    plan = make_plan(scene)
    recorder = MemoryRecorder(plan.grid, scene)
    try:
        integrate(plan, recorder, progress)
    except SolverStopped as stop:
        recorder.close(stopped=str(stop))
        stop.dataset = recorder.dataset()  # type: ignore[attr-defined]
        raise
    recorder.close()
    return recorder.dataset()


def make_stepper(plan: Plan, representation: Representation) -> Stepper:
    """The stepper that the plan names."""
    scene, rtol = plan.scene, plan.scene.accuracy.rtol
    longest = math.inf if plan.time_step is None else plan.time_step
    if scene.operator is None:
        return ExactSteps(Plain(representation.linear))
    base = representation.split()
    if plan.stepping == "strang":
        return Controlled(Extrapolated(base), lambda f: math.inf, fixed=plan.time_step)
    method = Extrapolated(base, (1, 2, 3, 4), (2, 4, 6)) if plan.symmetric else Extrapolated(base, (1, 2), (4,))
    # Errors made long ago have decayed: the allowance is spread over the run, but over no more than a few relaxation times.
    memory = min(scene.run.end_time, 5 / scene.model.friction if scene.model.friction > 0 else math.inf)
    share = plan.error_share * rtol / memory

    def tolerance(f: Array) -> float:
        return share * float(np.abs(f).max())

    if plan.stepping == "extrapolated":
        return Controlled(method, tolerance, longest, scene.grid.time_step)
    step = representation.linearised(0.05 * rtol)
    early = Early(plan) if plan.shortest_step > 0 and scene.initial.file is None else None
    return ExactSteps(step, longest, plan.shortest_step, early, Controlled(method, tolerance))


class Early:
    """f at a time too short for the kernel on the plan's velocity points: one step on points three or nine times as dense,
    on which the Maxwellian start is known as well."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._finer: dict[int, tuple[ExactStep, Any]] = {}

    def __call__(self, time: float) -> Array:
        # The kernel's width goes as the square root of short times.
        factor = next((n for n in (3, 9) if time * n**2 >= self.plan.shortest_step), 9)
        if factor not in self._finer:
            grid = dataclasses.replace(self.plan.grid, nv=self.plan.grid.nv * factor)
            representation = make_representation(dataclasses.replace(self.plan, grid=grid))
            step: ExactStep = representation.linearised(0.05 * self.plan.scene.accuracy.rtol)
            self._finer[factor] = (step, step.lift(representation.start()))
        step, start = self._finer[factor]
        # Three or nine fine cells make one of the plan's, whose centre is the middle one's.
        return step.lower(step.propagate(start, time))[:, factor // 2 :: factor]


def integrate(plan: Plan, recorder: Recorder, progress: Progress | None = None) -> None:
    """Run the time loop and hand each frame to `recorder` as soon as it exists."""
    with one_blas_thread():
        _integrate(plan, recorder, progress)


def _integrate(plan: Plan, recorder: Recorder, progress: Progress | None) -> None:
    scene, grid = plan.scene, plan.grid
    operator = collision_operator(plan)
    representation = make_representation(plan)
    stepper = make_stepper(plan, representation)
    monitor = Monitor(plan)
    state = representation.start()
    f = representation.points(state)
    ledger = Ledger(grid, scene.model, operator, f) if scene.output.budgets is not False else None
    frames = Frames(plan, recorder, operator, ledger)
    try:
        diagnostics = monitor.check(f, 0.0)
    except SolverStopped as stop:
        raise SceneError(str(stop)) from None
    # A step in the density is stepped as the grid can carry it, and shown as it is.
    frames.write(0.0, f, diagnostics, shown=f if scene.initial.step is None else initial_state(scene, grid))
    steps = itertools.count(1)
    times = frame_times(scene).tolist()
    if ledger is not None and operator is not None:
        if isinstance(stepper, ExactSteps):
            book = ledger
            stepper.between = lambda state_at, start, end: book.over(lambda t: representation.points(state_at(t)), start, end)
        else:  # a spline needs a few points from the start
            times = sorted({*times, *np.linspace(0.0, times[1], 5)[1:-1].tolist()})
    for start, end in itertools.pairwise(times):

        def observe(state: Array, elapsed: float, start: float = start, end: float = end) -> None:
            nonlocal f
            now = end if start + elapsed > end - 1e-12 * (end - start) else start + elapsed
            f = representation.points(state)
            monitor.finite(f, now)
            if next(steps) % CHECK_EVERY == 0 and now < end:
                monitor.check(f, now)
            if ledger is not None:
                ledger.step(now, f)
            if progress is not None:
                progress(now, scene.run.end_time)

        try:
            state = stepper.advance(state, end - start, observe)
        except (StepTooSmall, LostAccuracy) as error:
            raise SolverStopped(
                f"between t = {start:.6g} and {end:.6g}: {error}; raise accuracy.rtol, or refine grid.nx and grid.nv"
            ) from None
        frames.write(end, f, monitor.check(f, end, _density_defect(stepper)))
    if isinstance(stepper, Controlled) and plan.symmetric and plan.stepping == "extrapolated":
        shortest = stepper.shortest / stepper.method.counts[-1]
        Rules(scene, {}).warn_of_an_unresolved_kernel(grid, shortest, plan.drift_diffusion)
    if isinstance(stepper, Controlled) and stepper.fixed is not None:
        estimate = stepper.error / float(np.abs(f).max())
        if estimate > scene.accuracy.rtol:
            warnings.warn(
                f"grid.time_step = {stepper.fixed:g}: the steps' errors may add up to {estimate:.2g} of max f (accuracy.rtol = "
                f"{scene.accuracy.rtol:g}); reduce it, or leave it out",
                stacklevel=2,
            )


def _density_defect(stepper: Stepper) -> float:
    """Of steps on velocity points; that of the Hermite step is no measure of f's error after a long step."""
    step = stepper.step if isinstance(stepper, ExactSteps) else None
    return step.density_defect if isinstance(step, GridLinearisedStep) else 0.0


class Frames:
    """Computes, at each time, what `[output]` asks for then, and nothing else."""

    def __init__(self, plan: Plan, recorder: Recorder, operator: CollisionOperator | None, ledger: Ledger | None) -> None:
        self.plan, self.recorder, self.operator, self.ledger = plan, recorder, operator, ledger
        output = plan.scene.output
        self._due = {group: plan.scene.times(getattr(output, group)) for group in type(output).model_fields}

    def _is_due(self, group: str, time: float) -> bool:
        return bool(np.any(np.abs(self._due[group] - time) <= 1e-9 * self.plan.scene.run.end_time))

    def write(self, time: float, f: Array, diagnostics: dict[str, float], shown: Array | None = None) -> None:
        """`shown` stands for f in the fields over x and v, where given."""
        due = {group for group in self._due if self._is_due(group, time)}
        if not due:
            return
        grid, model = self.plan.grid, self.plan.scene.model
        frame: dict[str, dict[str, Any]] = {}
        if "f" in due:
            frame["f"] = {"f": f if shown is None else shown}
        if "moments" in due:
            m = moments(grid, f if shown is None else shown)
            frame["moments"] = {
                "density": m.density,
                "mean_velocity": m.mean_velocity,
                "temperature": m.temperature,
                "heat_flux": m.heat_flux,
                "velocity_distribution": f.sum(axis=0) * grid.dx,
            }
        if "scalars" in due:
            mass, momentum, energy = totals(grid, f)
            frame["scalars"] = {"mass": mass, "momentum": momentum, "energy": energy, **diagnostics}
        if "budgets" in due and self.ledger is not None:
            frame["budgets"] = self.ledger.record()
        if "moment_equations" in due:
            rate = self.operator.rate(f) if self.operator is not None else None
            frame["moment_equations"] = moment_equations(grid, model, f, rate)
        self.recorder.record(time, frame)
