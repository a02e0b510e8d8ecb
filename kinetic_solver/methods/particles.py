"""Particles into a file, with checkpoints: a run may be stopped and resumed, and its file has the same bits as without."""

from __future__ import annotations

import warnings
from time import monotonic

from kinetic_solver.dataset import recording
from kinetic_solver.methods.job import Job
from particles.plan import ParticlePlan, make_plan
from particles.records import coordinates, variables
from particles.report import report
from particles.simulation import Simulation
from particles.simulation import run as simulate

OUTSIDE = 1e-3
"""Share of particles outside the window beyond which a run warns."""


def run(job: Job) -> list[str]:
    """Raises RunUnfinished after the step in which the run is told to stop, its state written beside the file."""
    plan = make_plan(job.scene, job.operator, job.initial)
    scene, said, notes = plan.scene, report(plan), job.notes(plan.start)
    resumed = job.resumed(scene, notes=notes)
    if resumed.finished:
        return ["it has finished already"]
    state = resumed.state
    after = None if state is None else float(state["time"])
    table, more = variables(scene, plan.grid), coordinates(scene, plan.grid)
    recorder = job.recorder(plan.grid, plan.schedule, table, scene, more, after, notes)
    keeper = job.keeper(resumed, recorder)
    if "warning" in said:
        warnings.warn(said["warning"], stacklevel=4)

    def after_step(simulation: Simulation) -> None:
        keeper.look(simulation.reached, simulation.state)

    with recording(recorder):
        done = simulate(plan, recorder, job.progress, after_step, state, keeper.look_before)
    recorder.close(report=said)
    keeper.finish()
    if done.outside > OUTSIDE:
        warnings.warn(
            f"up to {done.outside:.2g} of the particles are outside the velocity window and missing in f and w(v); "
            "widen grid.velocity_window",
            stacklevel=4,
        )
    steps = done.number - (int(state["number"]) if state is not None else 0)
    return _in_words(plan, done, steps, monotonic() - job.began, said)


def _in_words(plan: ParticlePlan, done: Simulation, steps: int, seconds: float, said: dict[str, str]) -> list[str]:
    particles = plan.scene.particles.count * plan.scene.particles.replicas
    speed = particles * steps / seconds / 1e6
    how = f"cells: {said['cells']}" if "cells" in said else f"overtakings: {done.candidates}, {said['overtakings']}"
    return [
        f"{particles} particles, {steps} steps, {speed:.3g} million particle-steps a second, start and output included",
        f"memory of the ensemble {plan.memory / 2**20:.0f} MiB; {done.collisions} collisions; {how}",
    ]
