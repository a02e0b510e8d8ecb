"""The particle ensemble of a scene, from its start to its end: a Dataset of the grid solver's schema with standard errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.homogeneous import start_state
from kinetic_solver.output import VARIABLES, MemoryRecorder, Recorder, Variables
from kinetic_solver.scene import INELASTIC, Scene, SceneError
from particles.collisions import FOLLOW, collide
from particles.ensemble import Ensemble
from particles.estimators import Sampler, density_modes, fields
from particles.langevin import LangevinStep
from particles.random import POSITIONS, VELOCITIES, key, standard_normals, uniforms

if TYPE_CHECKING:
    import xarray as xr

Progress = Callable[[float, float], None]

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

    @property
    def cell_width(self) -> float:
        return self.scene.pipe.length / self.cells

    @property
    def memory(self) -> int:
        return BYTES_PER_PARTICLE * self.scene.particles.count * self.scene.particles.replicas


def make_plan(scene: Scene) -> ParticlePlan:
    """Cells no wider than a quarter of the mean free path, of the thermal free path and of 1/k of the start's shortest wave, but
    for `LEAST_IN_CELL` particles in each; steps in which friction, collisions and flight over 1/k each do a tenth of what they do
    in all. What `[particles]` gives is kept. Errors: docs/particles.md.
    """
    start, model, length = scene.initial, scene.model, scene.pipe.length
    for name, given in (("file", start.file), ("eigenmodes", start.eigenmodes)):
        if given:
            raise SceneError(f"initial.{name}: the particles start from a Maxwellian; remove it")
    if scene.particles.collisions != "dsmc":
        raise SceneError(f"particles.collisions = {scene.particles.collisions!r}: allowed: 'dsmc'")
    _, theta0 = start_state(scene)
    hottest = math.sqrt(max(theta0, model.noise))
    modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
    wave = length / (2 * math.pi * max((m.mode for m in modes), default=1))
    rate = scene.cross_section * start.density if scene.operator else 0.0
    path = 1 / rate if rate else math.inf
    thermal = hottest / model.friction if model.friction else math.inf
    wanted = math.ceil(4 * length / min(path, thermal, wave))
    cells = scene.particles.cells or max(1, min(wanted, scene.particles.count // LEAST_IN_CELL))
    fastest = max(model.friction, 2 * rate * hottest, hottest / wave)
    step = (scene.particles.time_step or 0.1 / fastest) if rate else math.inf
    grid = PhaseSpaceGrid(scene.grid.nx or 65, scene.grid.nv or 64, length, *(scene.grid.velocity_window or _window(scene)))
    return ParticlePlan(scene, grid, cells, step, path)


def _window(scene: Scene) -> tuple[float, float]:
    """Six standard deviations about the mean velocities of the start, and of the homogeneous states of the densities in it."""
    model = scene.model
    x = scene.pipe.length * np.arange(256) / 256
    u0, theta0 = start_state(scene)
    u, theta = initial.mean_velocity(scene, x, u0), initial.temperature(scene, x, theta0)
    means = [float(u.min()), float(u.max())]
    if model.friction > 0:
        thickest = float(initial.density(scene, x).max())
        drag = scene.cross_section * thickest * model.noise if scene.operator == "follow-the-leader" else 0.0
        means += [model.gravity / model.friction, (model.gravity - drag) / model.friction]
    else:
        means += [m + model.gravity * scene.run.end_time for m in means]
    spread = 6 * math.sqrt(max(float(theta.max()), model.noise))
    return min(means) - spread, max(means) + spread


class Simulation:
    """Replicas of a scene's particles, advanced together. The same numbers on any number of threads, and from `state` on.

    Half a Langevin step, collisions, half a Langevin step: second order in the step; between collisions the two halves are one.
    Without collisions exact over any time. Number of particles exact, momentum of (12)'s collisions to round-off.
    Tests: tests/particles/test_simulation.py.
    """

    def __init__(self, plan: ParticlePlan) -> None:
        self.plan = plan
        scene = plan.scene
        self.time = 0.0
        self.number = 0
        """Of the next step that draws random numbers."""
        self._keys = [key(scene.particles.seed, replica) for replica in range(scene.particles.replicas)]
        self.weight = scene.initial.density * scene.pipe.length / scene.particles.count
        self.ensembles = [self._start(k) for k in self._keys]
        self._tally = np.zeros((plan.cells, 2), dtype=np.int64)
        self.candidates = self.collisions = 0
        """Since the start, of all replicas."""

    def _start(self, k: NDArray[np.uint64]) -> Ensemble:
        """Independent particles of the scene's Maxwellian: positions by the inverse of ∫ρ0, to 1e-9 of the pipe's length."""
        scene, count = self.plan.scene, self.plan.scene.particles.count
        length = scene.pipe.length
        x, normals = np.empty(count), np.empty((count, 2))
        uniforms(x, POSITIONS, np.uint64(0), k[0], k[1])
        standard_normals(normals, VELOCITIES, np.uint64(0), k[0], k[1])
        if scene.initial.step is not None or scene.initial.modes:
            table = length * np.linspace(0, 1, 2**17 + 1)
            cumulative = initial.density_integral(scene, table)
            x = np.interp(x, cumulative / cumulative[-1], table)
        else:
            x *= length
        x[x >= length] = 0.0
        u0, theta0 = start_state(scene)
        theta = initial.temperature(scene, x, theta0)
        v = initial.mean_velocity(scene, x, u0) + np.sqrt(theta) * normals[:, 0]
        return Ensemble(x, v, length, self.plan.cells)

    def advance_to(self, time: float) -> None:
        scene, interval = self.plan.scene, time - self.time
        if interval <= 0:
            return
        if scene.operator is None:
            whole = LangevinStep.over(scene.model, interval)
            for ensemble, k in zip(self.ensembles, self._keys, strict=True):
                ensemble.advance(whole, self.number, k)
            self.number += 1
        else:
            self._collide_to(interval)
        self.time = time

    def _collide_to(self, interval: float) -> None:
        scene, plan = self.plan.scene, self.plan
        steps = math.ceil(interval / plan.time_step * (1 - 1e-12))
        h = interval / steps
        half, whole = LangevinStep.over(scene.model, h / 2), LangevinStep.over(scene.model, h)
        rate = scene.cross_section * self.weight * h / plan.cell_width
        kind = scene.restitution if scene.operator == INELASTIC else FOLLOW
        for ensemble, k in zip(self.ensembles, self._keys, strict=True):
            number = self.number
            ensemble.advance_and_sort(half, number, k)
            for n in range(1, steps + 1):
                number += 1
                collide(ensemble.v, ensemble.starts, rate, kind, number, k, self._tally)
                self.candidates += int(self._tally[:, 0].sum())
                self.collisions += int(self._tally[:, 1].sum())
                ensemble.advance_and_sort(whole if n < steps else half, number, k)
        self.number += steps + 1

    def state(self) -> dict[str, Any]:
        """What `restore` needs to go on bit for bit: x, v (replica, particle), time, number, candidates, collisions."""
        return {
            "x": np.array([e.x for e in self.ensembles]),
            "v": np.array([e.v for e in self.ensembles]),
            "time": self.time,
            "number": self.number,
            "candidates": self.candidates,
            "collisions": self.collisions,
        }

    def restore(self, state: dict[str, Any]) -> None:
        for ensemble, x, v in zip(self.ensembles, state["x"], state["v"], strict=True):
            ensemble.x[:], ensemble.v[:] = x, v
        self.time, self.number = float(state["time"]), int(state["number"])
        self.candidates, self.collisions = int(state["candidates"]), int(state["collisions"])


def simulate(scene: Scene, progress: Progress | None = None) -> xr.Dataset:
    """Run the scene's particles and return its Dataset (docs/output.md): means over replicas, each with `<name>_stderr`.

    Raises SceneError where the scene asks for what the particles do not do.
    """
    plan = make_plan(scene)
    recorder = MemoryRecorder(plan.grid, scene, "particles", VARIABLES_OF_PARTICLES, coordinates(plan))
    run(plan, recorder, progress)
    recorder.close(report=report(plan))
    return recorder.dataset()


def run(plan: ParticlePlan, recorder: Recorder, progress: Progress | None = None) -> Simulation:
    """Hand every frame to the recorder; returns the simulation at its end."""
    scene, grid = plan.scene, plan.grid
    simulation = Simulation(plan)
    sampler = Sampler(grid.length, grid.nx, grid.v, simulation.weight)
    for time in frame_times(scene):
        simulation.advance_to(float(time))
        samples = [sampler.sample(e.x, e.v) for e in simulation.ensembles]
        values: dict[str, Any] = dict(fields(samples, grid.length, grid.nx, grid.v))
        modes = np.array([density_modes(sample)[: len(coordinates(plan)["mode"])] for sample in samples])
        values["density_mode_real"], values["density_mode_imag"] = modes.real, modes.imag
        values["outside_window"] = sum(s.outside for s in samples) / (len(samples) * scene.particles.count)
        values["collisions"] = float(simulation.collisions)
        values["candidates"] = float(simulation.candidates)
        frame = {
            group: {name: values[name] for name in table}
            for group, table in VARIABLES_OF_PARTICLES.items()
            if _due(scene, group, float(time))
        }
        recorder.record(float(time), frame)
        if progress is not None and time > 0:
            progress(float(time), scene.run.end_time)
    return simulation


def frame_times(scene: Scene) -> Array:
    """All times at which any group is written."""
    times = [scene.times(getattr(scene.output, group)) for group in VARIABLES_OF_PARTICLES]
    return np.unique(np.round(np.concatenate(times), 12))


def _due(scene: Scene, group: str, time: float) -> bool:
    times = scene.times(getattr(scene.output, group))
    return bool(times.size) and bool(np.abs(times - time).min() <= 1e-9 * scene.output_every)


def report(plan: ParticlePlan) -> dict[str, str]:
    """Attributes: cells, step, and a warning where cells are wider than the mean free path."""
    said = {
        "cells": f"{plan.cells}, of {plan.cell_width:.4g}; mean free path 1/(Sρ) = {plan.mean_free_path:.4g}",
        "time_step": "none: one exact step from frame to frame"
        if math.isinf(plan.time_step)
        else f"{plan.time_step:.6g} at most",
        "weight": f"{plan.scene.initial.density * plan.scene.pipe.length / plan.scene.particles.count:.6g} real particles each",
    }
    if plan.cell_width > plan.mean_free_path:
        said["warning"] = "cells are wider than the mean free path: raise particles.cells, and particles.count with them"
    return said


def coordinates(plan: ParticlePlan) -> dict[str, np.ndarray]:
    return {
        "mode": np.arange(1, min(8, (plan.grid.nx - 1) // 2) + 1, dtype=np.int32),
        "replica": np.arange(plan.scene.particles.replicas, dtype=np.int32),
    }


def _with_errors(group: str, names: tuple[str, ...]) -> dict[str, tuple[tuple[str, ...], str, str]]:
    table = {}
    for name in names:
        dimensions, units, text = VARIABLES[group][name]
        table[name] = (dimensions, units, text)
        table[f"{name}_stderr"] = (dimensions, units, f"standard error over replicas of {text}")
    return table


VARIABLES_OF_PARTICLES: Variables = {
    "f": _with_errors("f", ("f",)),
    "moments": {
        **_with_errors("moments", ("density", "mean_velocity", "temperature", "velocity_distribution")),
        "heat_flux": VARIABLES["moments"]["heat_flux"],
    },
    "scalars": {
        **_with_errors("scalars", ("mass", "momentum", "energy")),
        "density_mode_real": (("replica", "mode"), "1", "real part of (1/L)∫ρ exp(-ikx) dx over the mean density"),
        "density_mode_imag": (("replica", "mode"), "1", "imaginary part of it"),
        "outside_window": ((), "1", "share of the particles outside the velocity window, missing in f"),
        "candidates": ((), "1", "candidate pairs since time 0, of all replicas"),
        "collisions": ((), "1", "collisions since time 0, of all replicas"),
    },
}
