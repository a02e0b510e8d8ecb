"""What a run of particles will use: cells and step for collisions, points for the output, memory."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.homogeneous import start_state
from kinetic_solver.scene import Scene, SceneError
from particles import single_file
from particles.files import count_of, start_from_file

LEAST_IN_CELL = 20
BYTES_PER_PARTICLE = 36


@dataclasses.dataclass(frozen=True)
class ParticlePlan:
    """What a run will use: cells and step for collisions, points for the output."""

    scene: Scene
    grid: PhaseSpaceGrid
    """The points of the output; the particles know none."""
    cells: int
    time_step: float
    """inf without collisions: one step from frame to frame."""
    mean_free_path: float
    """1/(Sρ) at the mean density."""
    relative_step: float
    """The step times the largest of γ, the rate of collisions and that of flight over 1/k."""
    relative_width: float
    """A cell's width over the shortest of the mean free path, the thermal free path √θ/γ and 1/k; 0 without cells."""

    @property
    def cell_width(self) -> float:
        return self.scene.pipe.length / self.cells

    @property
    def single_file(self) -> bool:
        return self.scene.operator is not None and self.scene.particles.collisions == "single-file"

    @property
    def weight(self) -> float:
        """w, the real particles that each simulated one stands for."""
        return self.scene.initial.density * self.scene.pipe.length / self.scene.particles.count

    @property
    def probability(self) -> float:
        """S_C w: of a collision at an overtaking."""
        return self.scene.cross_section * self.weight

    @property
    def memory(self) -> int:
        each = single_file.BYTES_PER_PARTICLE if self.single_file else BYTES_PER_PARTICLE
        return each * self.scene.particles.count * self.scene.particles.replicas


def make_plan(scene: Scene) -> ParticlePlan:
    """Cells no wider than a quarter of the mean free path, of the thermal free path and of 1/k of the start's shortest wave, but
    for `LEAST_IN_CELL` particles in each; steps in which friction, collisions and flight over 1/k each do a tenth of what they do
    in all. What `[particles]` gives is kept. Errors: docs/particles.md.
    """
    if scene.initial.file is not None:
        scene = _of_the_file(scene)
    start, model, length = scene.initial, scene.model, scene.pipe.length
    if start.eigenmodes:
        raise SceneError("initial.eigenmodes: the particles start from a Maxwellian or a file of particles; remove it")
    hottest = math.sqrt(max(_start(scene)[1].max(), model.noise))
    modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
    wave = length / (2 * math.pi * max((m.mode for m in modes), default=1))
    rate = scene.cross_section * start.density if scene.operator else 0.0
    path = 1 / rate if rate else math.inf
    thermal = hottest / model.friction if model.friction else math.inf
    shortest = min(path, thermal, wave)
    wanted = math.ceil(4 * length / shortest)
    cells = scene.particles.cells or max(1, min(wanted, scene.particles.count // LEAST_IN_CELL))
    in_file = scene.operator is not None and scene.particles.collisions == "single-file"
    if in_file and scene.particles.cells:
        raise SceneError("particles.cells: single-file collisions have no cells; remove it")
    fastest = max(model.friction, 2 * rate * hottest, hottest / wave)
    step = (scene.particles.time_step or 0.1 / fastest) if rate else math.inf
    grid = PhaseSpaceGrid(scene.grid.nx or 65, scene.grid.nv or 64, length, *(scene.grid.velocity_window or _window(scene)))
    width = 0.0 if in_file else length / cells / shortest
    plan = ParticlePlan(scene, grid, 1 if in_file else cells, step, path, step * fastest, width)
    if in_file and plan.probability > 1:
        least = math.ceil(scene.cross_section * start.density * length)
        raise SceneError(
            f"particles.count = {scene.particles.count}: an overtaking would be a collision with the probability S_C·w = "
            f"{plan.probability:.4g}; allowed: up to 1; raise particles.count to {least} or more"
        )
    available = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if plan.memory > 0.9 * available:
        asked = f"particles: count = {scene.particles.count}, replicas = {scene.particles.replicas}"
        needed, there = plan.memory / 2**30, available / 2**30
        raise SceneError(f"{asked} need {needed:.3g} GiB, this machine has {there:.3g} GiB; reduce them")
    return plan


def _of_the_file(scene: Scene) -> Scene:
    """With the number of particles that `initial.file` holds. Raises SceneError where the scene asks for another."""
    replicas, count = count_of(scene)
    wanted = scene.particles
    if wanted.count != count and "count" in wanted.model_fields_set:
        raise SceneError(f"particles.count = {wanted.count}: allowed: {count}, as in initial.file; or leave it out")
    if replicas not in (1, wanted.replicas) and "replicas" in wanted.model_fields_set:
        raise SceneError(f"particles.replicas = {wanted.replicas}: allowed: {replicas}, as in initial.file; or leave it out")
    copies = wanted.replicas if replicas == 1 else replicas
    return scene.model_copy(update={"particles": wanted.model_copy(update={"count": count, "replicas": copies})})


def _start(scene: Scene) -> tuple[Array, Array]:
    """Mean velocities and temperatures at the start, over the pipe; of a file over all its particles."""
    if scene.initial.file is not None:
        _, v = start_from_file(scene)
        return np.array([v.mean()]), np.array([v.var()])
    x = scene.pipe.length * np.arange(256) / 256
    u0, theta0 = start_state(scene)
    return initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0)


def _window(scene: Scene) -> tuple[float, float]:
    """Six standard deviations about the mean velocities of the start, and of the homogeneous states of the densities in it."""
    model = scene.model
    x = scene.pipe.length * np.arange(256) / 256
    u, theta = _start(scene)
    means = [float(u.min()), float(u.max())]
    if model.friction > 0:
        thickest = float(initial.density(scene, x).max())
        drag = scene.cross_section * thickest * model.noise if scene.operator == "follow-the-leader" else 0.0
        means += [model.gravity / model.friction, (model.gravity - drag) / model.friction]
    else:
        means += [m + model.gravity * scene.run.end_time for m in means]
    spread = 6 * math.sqrt(max(float(theta.max()), model.noise))
    return min(means) - spread, max(means) + spread
