"""The grid solver: equation (2) on phase space, from scene to Dataset."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.budgets import Ledger
from kinetic_solver.collisions.protocol import CollisionOperator
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.homogeneous import start_state
from kinetic_solver.linear import LinearStep
from kinetic_solver.moments import moment_equations, moments, totals
from kinetic_solver.monitor import Monitor, SolverStopped
from kinetic_solver.output import MemoryRecorder, Recorder
from kinetic_solver.plan import Plan, frame_times, make_plan
from kinetic_solver.scene import FOLLOW_LEADER, Scene
from kinetic_solver.stepping import strang
from kinetic_solver.threads import one_blas_thread
from kinetic_solver.velocity import DriftDiffusion, FiniteVolume, OrnsteinUhlenbeckKernel

if TYPE_CHECKING:
    import xarray as xr
Progress = Callable[[float, int, int], None]
"""Called as progress(time, step, total steps)."""

CHECK_EVERY = 10
"""Steps between two full checks by the monitor; NaN is looked for in every step."""


def solve(scene: Scene, progress: Progress | None = None) -> xr.Dataset:
    """Solve (2) for `scene` on the phase-space grid; return every frame as an xarray Dataset (docs/output.md).

    Exact in time without collisions; second order in the time step with them (Strang). Mass is conserved to round-off.
    Raises SceneError where the scene cannot be run, and SolverStopped, with the frames so far as its `dataset`, where
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


def collision_operator(plan: Plan) -> CollisionOperator | None:
    """The operator that the scene needs, on the plan's velocity points; None without collisions."""
    scene = plan.scene
    if scene.operator is None:
        return None
    from kinetic_solver.collisions import FollowLeader, Inelastic

    if scene.operator == FOLLOW_LEADER:
        return FollowLeader(plan.grid.v, scene.cross_section)
    assert plan.deposit is not None
    return Inelastic(plan.grid.v, scene.cross_section, scene.restitution, plan.deposit)


def drift_diffusion(plan: Plan) -> DriftDiffusion:
    chosen = FiniteVolume if plan.drift_diffusion == "finite-volume" else OrnsteinUhlenbeckKernel
    return chosen(plan.grid, plan.scene.model)


def initial_state(scene: Scene, grid: PhaseSpaceGrid) -> Array:
    """f at time 0, shape (nx, nv): Maxwellian, or the last frame of `initial.file` on this grid."""
    if scene.initial.file is not None:
        return initial.from_file(scene, grid.x, grid.v)
    u0, theta0 = start_state(scene)
    return initial.maxwellian(
        initial.density(scene, grid.x),
        initial.mean_velocity(scene, grid.x, u0),
        initial.temperature(scene, grid.x, theta0),
        grid.v,
    )


def integrate(plan: Plan, recorder: Recorder, progress: Progress | None = None) -> None:
    """Run the time loop and hand each frame to `recorder` as soon as it exists."""
    with one_blas_thread():
        _integrate(plan, recorder, progress)


def _integrate(plan: Plan, recorder: Recorder, progress: Progress | None) -> None:
    scene, grid = plan.scene, plan.grid
    operator = collision_operator(plan)
    linear = LinearStep(grid, scene.model, drift_diffusion(plan))
    monitor = Monitor(plan)
    f = initial_state(scene, grid)
    ledger = Ledger(grid, scene.model, f) if scene.output.budgets is not False else None
    frames = Frames(plan, recorder, operator, ledger)
    frames.write(0.0, f, monitor.check(f, 0.0))

    def collide(f: Array, h: float) -> Array:
        assert operator is not None
        f = operator(f, h)
        if ledger is not None:
            ledger.collision(f)
        return f

    def drift(f: Array, h: float) -> Array:
        f = linear(f, h)
        if ledger is not None:
            ledger.linear(f, h)
        return f

    done, total = 0, plan.total_steps
    for start, end in itertools.pairwise(frame_times(scene).tolist()):
        steps = plan.steps(end - start)
        if operator is None:
            f = drift(f, end - start)
        else:

            def observe(f: Array, n: int, start: float = start, end: float = end, steps: int = steps, done: int = done) -> None:
                now = start + (end - start) * n / steps
                monitor.finite(f, now)
                if n % CHECK_EVERY == 0:
                    monitor.check(f, now)
                if progress is not None:
                    progress(now, done + n, total)

            f = strang(collide, drift, f, end - start, steps, observe)
        done += steps
        frames.write(end, f, monitor.check(f, end))
        if progress is not None:
            progress(end, done, total)


class Frames:
    """Computes, at each time, what `[output]` asks for then, and nothing else."""

    def __init__(self, plan: Plan, recorder: Recorder, operator: CollisionOperator | None, ledger: Ledger | None) -> None:
        self.plan, self.recorder, self.operator, self.ledger = plan, recorder, operator, ledger
        output = plan.scene.output
        self._due = {group: plan.scene.times(getattr(output, group)) for group in type(output).model_fields}

    def _is_due(self, group: str, time: float) -> bool:
        return bool(np.any(np.abs(self._due[group] - time) <= 1e-9 * self.plan.scene.run.end_time))

    def write(self, time: float, f: Array, diagnostics: dict[str, float]) -> None:
        due = {group for group in self._due if self._is_due(group, time)}
        if not due:
            return
        grid, model = self.plan.grid, self.plan.scene.model
        rate = None
        if self.operator is not None and due & {"budgets", "moment_equations"}:
            rate = self.operator.rate(f)
        frame: dict[str, dict[str, Any]] = {}
        if "f" in due:
            frame["f"] = {"f": f}
        if "moments" in due:
            m = moments(grid, f)
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
            frame["budgets"] = self.ledger.record(rate)
        if "moment_equations" in due:
            frame["moment_equations"] = moment_equations(grid, model, f, rate)
        self.recorder.record(time, frame)
