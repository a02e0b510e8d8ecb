"""What a run of particles will use: cells and step for collisions, points for the output, memory."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import start_state
from kinetic_solver.laws import CollisionLaw, PairLaw, check_pairs
from kinetic_solver.machine import too_large
from kinetic_solver.scene import Scene, Schedule, check_is_scene
from particles import ensemble, single_file
from particles.estimators import memory_of_samples
from particles.files import count_of, start_from_file
from particles.records import GROUPS, written_bytes
from particles.specialised import check_compiles

LEAST_IN_CELL = 20
MOST_STEPS = 2**32
"""That the random numbers' counter tells apart."""
MOST_PERIODS = 1e9
"""Flown through in one step: a place then has seven digits left."""


@dataclasses.dataclass(frozen=True)
class ParticlePlan:
    """What a run will use: cells and step for collisions, points for the output."""

    scene: Scene
    law: PairLaw | None
    """What collisions do: the scene's, or one that was brought along; None where they do nothing."""
    grid: PhaseSpaceGrid
    """The points of the output; the particles know none."""
    cells: int
    time_step: float
    """inf without collisions: one step from frame to frame."""
    mean_free_path: float
    """1/(Sρ) where the start is densest."""
    fastest: float
    """The largest of γ, the rate of collisions and that of flight over 1/k."""
    relative_width: float
    """A cell's width over the shortest of the mean free path, the thermal free path √θ/γ and 1/k; 0 without cells."""
    start: initial.GivenStart | None = None
    """Instead of what the scene says, where one was given."""

    @cached_property
    def schedule(self) -> Schedule:
        """When anything is written."""
        return Schedule.of(self.scene, GROUPS)

    @property
    def longest_step(self) -> float:
        """That is taken: frames are closer where steps are long."""
        return min(self.time_step, float(np.diff(self.schedule.times).max()))

    @property
    def cell_width(self) -> float:
        return self.scene.pipe.length / self.cells

    @property
    def relative_step(self) -> float:
        """The longest step times the fastest rate."""
        return self.longest_step * self.fastest

    @property
    def single_file(self) -> bool:
        return self.law is not None and self.scene.particles.collisions == "single-file"

    @property
    def weight(self) -> float:
        """w, the real particles that each simulated one stands for."""
        return self.scene.initial.density * self.scene.pipe.length / self.scene.particles.count

    @property
    def probability(self) -> float:
        """S_C w: of a collision at an overtaking."""
        return 0.0 if self.law is None else self.law.cross_section * self.weight

    @property
    def sticks(self) -> bool:
        """True where a pair has no relative velocity after a collision."""
        if self.law is None:
            return False
        behind, ahead = self.law.after(1.0, *self.law.numbers)
        return behind == ahead

    @property
    def memory(self) -> int:
        """Bytes of the particles, their cells, and what is made for output."""
        particles = self.scene.particles
        count = single_file.memory(particles.count) if self.single_file else ensemble.memory(particles.count, self.cells)
        samples = memory_of_samples(self.grid.nx, self.grid.nv, particles.replicas)
        return particles.replicas * count + samples + written_bytes(self.scene, self.grid)


@dataclasses.dataclass(frozen=True)
class _Scales:
    """Of a scene's start: what steps and cells have to resolve."""

    fastest: float
    """The largest of γ, the rate of collisions and that of flight over 1/k."""
    shortest: float
    """The smallest of the free paths and 1/k."""
    path: float


def make_plan(scene: Scene, operator: CollisionLaw | None = None, own: initial.Given | None = None) -> ParticlePlan:
    """Cells no wider than a quarter of the mean free path, of the thermal free path and of 1/k of the start's shortest wave, but
    for `LEAST_IN_CELL` particles in each; steps in which friction, collisions and flight over 1/k each do a tenth of what they do
    in all, where the start is densest and for the largest differences of velocity in it. What `[particles]` gives is kept.
    Errors: docs/particles_details.md.

    `operator` stands in for [collisions], and `own`, an f(x, v), for [initial], which
    counts with its waves down to a tenth of the strongest:
    the scene must not have these then.

    Raises SceneError where the scene asks for what the particles do not do or this machine cannot hold, and where that f cannot
    be started from.
    """
    check_is_scene(scene)
    start = None
    if own is not None:
        scene, start = initial.take(scene, own)
    law = scene.law if operator is None else _pair_law(scene, operator)
    if scene.initial.file is not None:
        scene = _of_the_file(scene)
    given, length = scene.particles, scene.pipe.length
    if scene.initial.eigenmodes:
        raise SceneError("initial.eigenmodes: the particles start from a Maxwellian or a file of particles; remove it")
    if not any((scene.output.f, scene.output.moments, scene.output.scalars, scene.output.particles)):
        raise SceneError("output: f, moments, scalars and particles are all false; nothing would be written")
    scales = _scales(scene, law, start)
    in_file = law is not None and given.collisions == "single-file"
    if in_file and given.cells:
        raise SceneError("particles.cells: single-file collisions have no cells; remove it")
    wanted = min(math.ceil(min(4 * length / scales.shortest, 1e18)), given.count // LEAST_IN_CELL)
    cells = 1 if in_file else given.cells or max(1, wanted)
    step = (given.time_step or 0.1 / scales.fastest) if law else math.inf
    shown = scene.output
    low, high = shown.velocity_window or scene.grid.velocity_window or _window(scene, law, start)
    grid = PhaseSpaceGrid(shown.nx or scene.grid.nx or 65, shown.nv or scene.grid.nv or 64, length, low, high)
    width = 0.0 if in_file else length / cells / scales.shortest
    plan = ParticlePlan(scene, law, grid, cells, step, scales.path, scales.fastest, width, start)
    _check(plan)
    return plan


def _pair_law(scene: Scene, operator: CollisionLaw) -> PairLaw:
    """The law, if it is one for particles. Raises SceneError."""
    scene.law_with(operator)
    if not isinstance(operator, PairLaw):
        raise SceneError(f"operator {operator.label}: says nothing of pairs; particles need a PairLaw")
    check_pairs(operator, math.sqrt(start_state(scene)[1]))
    check_compiles(operator)
    return operator


def _check(plan: ParticlePlan) -> None:
    scene, given = plan.scene, plan.scene.particles
    if plan.single_file and plan.probability > 1:
        least = math.ceil(plan.probability * given.count)
        raise SceneError(
            f"particles.count = {given.count}: an overtaking would be a collision with the probability S_C·w = "
            f"{plan.probability:.4g}; allowed: up to 1; raise particles.count to {least} or more"
        )
    if not scene.run.end_time < MOST_STEPS * plan.time_step:
        raise SceneError(
            f"particles.time_step: run.end_time = {scene.run.end_time:g} in steps of {plan.time_step:g} "
            f"({'given' if given.time_step else 'a tenth of the shortest time in the scene'}); allowed: fewer than 2³² steps"
        )
    longest, fastest = plan.longest_step, max(abs(plan.grid.low), abs(plan.grid.high))
    if not fastest * longest <= MOST_PERIODS * scene.pipe.length:
        raise SceneError(
            f"pipe.length = {scene.pipe.length:g}: particles as fast as {fastest:.3g} fly through it "
            f"{fastest * longest / scene.pipe.length:.2g} times in one step, so that places have no digits left; allowed: up to "
            f"{MOST_PERIODS:g} times"
        )
    if (problem := too_large(plan.memory)) is not None:
        asked = f"particles: count = {given.count}, replicas = {given.replicas}, cells = {plan.cells}"
        raise SceneError(f"{asked} {problem}; reduce them, or what is written")


def _of_the_file(scene: Scene) -> Scene:
    """With as many particles and replicas as `initial.file` holds. Raises SceneError where the scene asks for another."""
    replicas, count = count_of(scene)
    wanted = scene.particles
    if wanted.count != count and "count" in wanted.model_fields_set:
        raise SceneError(f"particles.count = {wanted.count}: allowed: {count}, as in initial.file; or leave it out")
    if replicas not in (1, wanted.replicas) and "replicas" in wanted.model_fields_set:
        raise SceneError(f"particles.replicas = {wanted.replicas}: allowed: {replicas}, as in initial.file; or leave it out")
    # Copies of one ensemble have the same start: their scatter is that of the noise alone, which is to be asked for.
    copies = wanted.replicas if "replicas" in wanted.model_fields_set else replicas
    return scene.model_copy(update={"particles": wanted.model_copy(update={"count": count, "replicas": copies})})


def _start(scene: Scene, given: initial.GivenStart | None) -> tuple[Array, Array, Array]:
    """Densities, and mean velocities and temperatures of every beam, at the start over the pipe; of a file over all its
    particles."""
    if scene.initial.file is not None:
        _, v = start_from_file(scene)
        return np.array([scene.initial.density]), np.array([v.mean()]), np.array([v.var()])
    x = scene.pipe.length * np.arange(4096) / 4096
    if given is not None:
        parts = given.gaussians(x)
        return given.density(x), np.array([u for _, u, _ in parts]), np.array([theta for _, _, theta in parts])
    fields = [
        (initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0)) for _, u0, theta0 in initial.beams(scene)
    ]
    u, theta = (np.array(part) for part in zip(*fields, strict=True))
    return initial.density(scene, x), u, theta


def _scales(scene: Scene, law: PairLaw | None, given: initial.GivenStart | None) -> _Scales:
    start, model, length = scene.initial, scene.model, scene.pipe.length
    density, u, theta = _start(scene, given)
    hottest = math.sqrt(max(theta.max(), model.noise))
    spread = hottest + float(u.max() - u.min())
    if given is not None:
        # Parts of f with other mean velocities show in a variance that is larger than that of the narrowest one.
        u, theta = given.local_state()
        thermal = math.sqrt(float(theta.max()))
        hottest = max(hottest, thermal)
        spread = hottest + float(np.ptp(u)) + max(0.0, thermal - math.sqrt(given.narrowest(u)))
    modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
    waves = [length / (2 * math.pi * max((m.mode for m in modes), default=1))]
    if start.step is not None:
        width = start.step.end - start.step.start
        waves += [length * part / (2 * math.pi) for part in (width, 1 - width) if part > 0]
    if start.pulse is not None:
        waves.append(length * start.pulse.width)
    if given is not None:
        waves.append(length / (2 * math.pi * max(1, given.strong_mode)))
    rate = law.cross_section * float(density.max()) if law is not None else 0.0
    path = 1 / rate if rate else math.inf
    thermal = hottest / model.friction if model.friction else math.inf
    return _Scales(max(model.friction, 2 * rate * spread, spread / min(waves)), min(path, thermal, *waves), path)


def _window(scene: Scene, law: PairLaw | None, given: initial.GivenStart | None) -> tuple[float, float]:
    """Six standard deviations about the mean velocities of the start, and of the homogeneous states of the densities in it as far
    as these are approached until the end. Raises SceneError where all velocities are the same to double precision."""
    model, end = scene.model, scene.run.end_time
    density, u, theta = _start(scene, given)
    means = [float(u.min()), float(u.max())]
    if model.friction > 0:
        drags = law is not None and "momentum" not in law.conserves  # at most as follow the leader does
        drag = law.cross_section * float(density.max()) * model.noise if law is not None and drags else 0.0
        approached = -math.expm1(-model.friction * end)
        for force in (model.gravity, model.gravity - drag):
            means += [m + (force / model.friction - m) * approached for m in means[:2]]
    else:
        means += [m + model.gravity * end for m in means]
    warmest = max(float(theta.max()), model.noise * -math.expm1(-2 * model.friction * end))
    low, high = min(means) - 6 * math.sqrt(warmest), max(means) + 6 * math.sqrt(warmest)
    if not high - low > 1e-12 * max(abs(low), abs(high)):
        raise SceneError(
            f"grid.velocity_window: all velocities are {means[0]:g} to within rounding; give a window, or raise the temperature"
        )
    return low, high
