"""The particle ensemble of a scene, from its start to its end: a Dataset of the grid solver's schema with standard errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import MemoryRecorder, Recorder, law_attribute, recording
from kinetic_solver.initial import Given, notes_of
from kinetic_solver.laws import CollisionLaw, PairLaw
from kinetic_solver.progress import Progress, telling
from kinetic_solver.scene import Scene
from particles.collisions import collide
from particles.drawing import Maxwellians, Tabulated, draw
from particles.ensemble import Ensemble
from particles.estimators import Sampler, density_modes, fields
from particles.files import start_from_file
from particles.langevin import LangevinStep
from particles.plan import ParticlePlan, make_plan
from particles.random import key
from particles.records import coordinates, variables
from particles.report import report
from particles.single_file import SingleFile

if TYPE_CHECKING:
    import xarray as xr

AfterStep = Callable[["Simulation"], None]
Look = Callable[[], None]
"""Called before the first step, where that is long in coming; it may raise."""

SINGLE_FILE_STEPS = 2**18
"""Particle-steps of a single file between two looks at whether to stop. Chosen: some hundredths of a second."""


class Simulation:
    """Replicas of a scene's particles, advanced together. The same numbers on any number of threads, and from `state` on.

    Half a Langevin step, collisions, half a Langevin step: second order in the step; between collisions the two halves are one.
    Single files have steps of their own (`SingleFile`). Without collisions exact over any time. The number of particles is exact,
    momentum of (12)'s collisions to round-off.
    Tests: tests/cross_validation/particles/test_simulation.py.
    """

    def __init__(self, plan: ParticlePlan, state: dict[str, Any] | None = None, look: Look = lambda: None) -> None:
        """From the scene's start, or from a `state` of the same plan. `look` is called meanwhile where it takes long: `draw`."""
        self.plan = plan
        scene = plan.scene
        self.time = 0.0
        self.number = 0
        """Of the next step that draws random numbers."""
        self.candidates = self.collisions = 0
        """Since the start, of all replicas; of single files all overtakings are candidates."""
        self.outside = 0.0
        """Largest share of the particles outside the velocity window, at the frames so far."""
        self.done = (0, 0)
        """Of the interval that begins at `time`: replicas that are done, and steps of the next one."""
        self._interval = (0.0, 1)
        """Its length, and its steps."""
        self._keys = [key(scene.particles.seed, replica) for replica in range(scene.particles.replicas)]
        self.weight = plan.weight
        start = self._start(look) if state is None else zip(state["x"].copy(), state["v"].copy(), strict=True)
        self.ensembles: list[Ensemble] = []
        self.files: list[SingleFile] = []
        """Instead of ensembles, where collisions are those of single files."""
        for x, v in start:
            if plan.single_file:
                self.files.append(SingleFile(x, v, scene.pipe.length, plan.probability, _needed(plan)))
            else:
                self.ensembles.append(Ensemble(x, v, scene.pipe.length, plan.cells))
        if state is not None:
            self.time, self.number = float(state["time"]), int(state["number"])
            self.candidates, self.collisions = int(state["candidates"]), int(state["collisions"])
            self.outside, self.done = float(state["outside"]), state["done"]
            for ensemble in self.ensembles:
                ensemble.count_cells()
        self._tally = np.zeros((plan.cells, 2), dtype=np.int64)

    def _start(self, look: Look) -> Iterator[tuple[Array, Array]]:
        """x and v of every replica; those of a file that holds one are the same for all."""
        scene = self.plan.scene
        if self.plan.start is None and scene.initial.file is not None:
            x, v = start_from_file(scene)
            for replica in range(len(self._keys)):
                yield x[replica % len(x)].copy(), v[replica % len(v)].copy()
            return
        start = Maxwellians(scene) if self.plan.start is None else Tabulated(self.plan.start)
        yield from draw(start, scene.particles.count, self._keys, look)

    def advance_to(self, time: float, after_step: AfterStep = lambda simulation: None) -> None:
        """`after_step` is called whenever some replica has done some steps, and may raise: the state is one to go on from."""
        interval = time - self.time
        if interval <= 0:
            return
        self._interval = (interval, 1 if self.plan.law is None else self._steps(interval))
        if self.plan.law is None:
            self._fly(interval, after_step)
        elif self.plan.single_file:
            self._overtake_to(interval, after_step)
        else:
            self._collide_to(interval, after_step)
        self.time, self.done = time, (0, 0)

    @property
    def reached(self) -> float:
        """The time that replicas have come to in the mean: `time` is that of the last frame."""
        (replicas, steps), (interval, of) = self.done, self._interval
        return self.time + interval * (replicas + steps / of) / len(self._keys)

    def _fly(self, interval: float, after_step: AfterStep) -> None:
        whole = LangevinStep.over(self.plan.scene.model, interval)
        for replica in range(self.done[0], len(self.ensembles)):
            self.ensembles[replica].advance(whole, self.number, self._keys[replica])
            self.done = (replica + 1, 0)
            after_step(self)
        self.number += 1

    def _steps(self, interval: float) -> int:
        return math.ceil(interval / self.plan.time_step * (1 - 1e-12))

    def _overtake_to(self, interval: float, after_step: AfterStep) -> None:
        steps = self._interval[1]
        at_once = max(1, SINGLE_FILE_STEPS // self.plan.scene.particles.count)
        for replica in range(self.done[0], len(self.files)):
            file, k = self.files[replica], self._keys[replica]
            for first in range(self.done[1], steps, at_once):
                part = range(first, min(first + at_once, steps))
                overtakings, collisions = file.advance(self.plan.scene.model, interval, steps, self.number, k, part)
                self.candidates += overtakings
                self.collisions += collisions
                self.done = (replica, part.stop) if part.stop < steps else (replica + 1, 0)
                after_step(self)
        self.number += steps + 1

    def _collide_to(self, interval: float, after_step: AfterStep) -> None:
        scene, plan = self.plan.scene, self.plan
        steps = self._interval[1]
        h = interval / steps
        half, whole = LangevinStep.over(scene.model, h / 2), LangevinStep.over(scene.model, h)
        law = _needed(plan)
        rate = law.cross_section * self.weight * h / plan.cell_width
        for replica in range(self.done[0], len(self.ensembles)):
            ensemble, k, done = self.ensembles[replica], self._keys[replica], self.done[1]
            if done == 0:
                ensemble.advance_and_sort(half, self.number, k)
            for n in range(done + 1, steps + 1):
                number = self.number + n
                collide(ensemble.v, ensemble.starts, rate, law, number, k, self._tally)
                self.candidates += int(self._tally[:, 0].sum())
                self.collisions += int(self._tally[:, 1].sum())
                ensemble.advance_and_sort(whole if n < steps else half, number, k)
                self.done = (replica, n) if n < steps else (replica + 1, 0)
                after_step(self)
        self.number += steps + 1

    def particles(self) -> list[tuple[Array, Array]]:
        """x in [0, length) and v of each replica."""
        return [(f.places(), f.v) for f in self.files] or [(e.x, e.v) for e in self.ensembles]

    def state(self) -> dict[str, Any]:
        """What a simulation needs to go on bit for bit, a tree: x, v (replica, particle), the time of the last frame, how much of
        the interval after it is done, and the counts so far."""
        whole = self.files or self.ensembles
        return {
            "x": np.array([e.x for e in whole]),
            "v": np.array([e.v for e in whole]),
            "time": self.time,
            "number": self.number,
            "candidates": self.candidates,
            "collisions": self.collisions,
            "outside": self.outside,
            "done": self.done,
        }


def _needed(plan: ParticlePlan) -> PairLaw:
    assert plan.law is not None
    return plan.law


def simulate(
    scene: Scene,
    progress: bool | Progress | None = None,
    operator: CollisionLaw | None = None,
    initial: Given | None = None,
) -> xr.Dataset:
    """Run the scene's particles and return its Dataset (docs/output.md): means over replicas, each with `<name>_stderr`.

    `initial` is a start of one's own instead of [initial], from which particles are drawn: f(x, v) as a callable or a DataArray
    (docs/starts.md). `progress` as of `kinetic_solver.solve`.
    Raises SceneError where the scene asks for what the particles do not do, and SolverStopped, with the frames so far as its
    `dataset`, where a run cannot go on.
    """
    with telling(progress) as told:
        plan = make_plan(scene, operator, initial)
        table, more = variables(plan.scene, plan.grid), coordinates(plan.scene, plan.grid)
        notes = {**law_attribute(operator), **notes_of(plan.start)}
        recorder = MemoryRecorder(plan.grid, plan.scene, plan.schedule, "particles", table, more, notes)
        with recording(recorder):
            run(plan, recorder, told)
    recorder.close(report=report(plan))
    return recorder.dataset()


def run(
    plan: ParticlePlan,
    recorder: Recorder,
    progress: Progress | None = None,
    after_step: AfterStep = lambda simulation: None,
    state: dict[str, Any] | None = None,
    look: Look = lambda: None,
) -> Simulation:
    """Hand every frame to the recorder, or from `state` on those after its time; returns the simulation at its end.

    `after_step` is called as in `Simulation.advance_to`, and once a frame is written, but for the last. Before the first frame of
    many particles, while they are drawn and summed, `look` and `progress` are called instead.
    """

    def wait() -> None:
        look()
        if progress is not None:
            progress(0.0, plan.scene.run.end_time)

    simulation = Simulation(plan, state, wait)
    sampler = Sampler(plan.grid.length, plan.grid.nx, plan.grid.v, simulation.weight)
    for time, due in zip(plan.schedule.times.tolist(), plan.schedule.due, strict=True):
        if state is not None and time <= simulation.time:
            continue
        simulation.advance_to(time, after_step)
        recorder.record(time, frame(simulation, sampler, due, wait if time == 0 else lambda: None))
        if progress is not None and time > 0:
            progress(time, plan.scene.run.end_time)
        if time < plan.scene.run.end_time:
            after_step(simulation)
    return simulation


def frame(simulation: Simulation, sampler: Sampler, due: frozenset[str], look: Look = lambda: None) -> dict[str, dict[str, Any]]:
    """What is due at the simulation's time: group → name → value. `look` as of `Sampler.sample`."""
    plan, particles = simulation.plan, simulation.particles()
    samples = [sampler.sample(x, v, look) for x, v in particles]
    values: dict[str, Any] = dict(fields(samples, plan.grid.length, plan.grid.nx, plan.grid.v))
    modes = np.array([density_modes(sample) for sample in samples])
    values |= {"density_mode_real": modes.real, "density_mode_imag": modes.imag}
    values["outside_window"] = sum(s.outside for s in samples) / (len(samples) * plan.scene.particles.count)
    simulation.outside = max(simulation.outside, values["outside_window"])
    values["collisions"], values["candidates"] = float(simulation.collisions), float(simulation.candidates)
    groups = {group: table for group, table in variables(plan.scene, plan.grid).items() if group in due}
    if "particles" in groups:
        values |= {"position": np.array([x for x, _ in particles]), "velocity": np.array([v for _, v in particles])}
    return {group: {name: values[name] for name in table} for group, table in groups.items()}
