"""Particles against the closed form, restarts, threads, the dataset, and what is refused."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact
from kinetic_solver.dataset import Frame
from kinetic_solver.scene import Schedule
from particles.random import key
from particles.records import GROUPS
from particles.simulation import Simulation, make_plan, simulate
from particles.simulation import run as run_plan

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
INELASTIC = {"operator": "inelastic", "cross_section": 1.5, "restitution": 0.5}
START = {"mean_velocity": 0.9, "temperature": 0.4}
GRID = {"nx": 17, "nv": 48}


@pytest.mark.parametrize("collisions", [None, FOLLOW], ids=["none", "(6)"])
def test_against_the_closed_form(make_scene: MakeScene, collisions: dict[str, Any] | None) -> None:
    """Fields in standard errors of 8 replicas: z² has the mean 7/5 of Student's t, over 4 seeds and 17 points."""
    squares = []
    for seed in range(4):
        particles = {"count": 20_000, "replicas": 8, "seed": seed}
        scene = make_scene(collisions=collisions, initial=START, grid=GRID, particles=particles)
        run = simulate(scene)
        truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
        for name in ("density", "mean_velocity", "temperature"):
            squares.append(((run[name] - truth[name]) / run[f"{name}_stderr"]).values[-1] ** 2)
    assert 0.9 < np.mean(squares) < 2.1


def test_one_exact_step_without_collisions(make_scene: MakeScene) -> None:
    plan = make_plan(make_scene(particles={"count": 1000}))
    simulation = Simulation(plan)
    simulation.advance_to(1.5)
    assert simulation.number == 1
    assert simulation.time == 1.5


@pytest.mark.parametrize("collisions", [None, FOLLOW, INELASTIC], ids=["none", "(6)", "(12)"])
def test_the_same_bits_on_threads_and_from_a_state(make_scene: MakeScene, collisions: dict[str, Any] | None) -> None:
    plan = make_plan(make_scene(collisions=collisions, particles={"count": 5000, "replicas": 2, "seed": 7}))

    def finish(simulation: Simulation) -> list[np.ndarray]:
        simulation.advance_to(1.5)
        return [simulation.state()[name] for name in ("x", "v", "number", "collisions")]

    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        straight = Simulation(plan)
        straight.advance_to(0.6)
        kept = straight.state()
        expected = finish(straight)
        numba.set_num_threads(2)
        resumed = Simulation(plan, kept)
        again = Simulation(plan)
        again.advance_to(0.6)
        for found in (finish(resumed), finish(again)):
            for a, b in zip(expected, found, strict=True):
                assert np.array_equal(a, b)
    finally:
        numba.set_num_threads(threads)


def test_replicas_are_independent(make_scene: MakeScene) -> None:
    state = Simulation(make_plan(make_scene(particles={"count": 4000, "replicas": 2}))).state()
    x, v = state["x"], state["v"]
    assert abs(np.corrcoef(v[0], v[1])[0, 1]) < 4 / np.sqrt(4000)
    assert not np.isin(x[0], x[1]).any()


@pytest.mark.parametrize(("collisions", "theta"), [(INELASTIC, None), (FOLLOW, 0.5)], ids=["(12)", "(6)"])
def test_homogeneous_states(make_scene: MakeScene, collisions: dict[str, Any], theta: float | None) -> None:
    """θ and u stay those of the homogeneous state, within 4 standard errors over replicas."""
    from kinetic_solver.stability.homogeneous import homogeneous_state

    scene = make_scene(
        collisions=collisions, initial={"modes": []}, run={"end_time": 4.0}, particles={"count": 20_000, "replicas": 8}, grid=GRID
    )
    run = simulate(scene)
    state = homogeneous_state(scene)
    assert state is not None
    assert theta is None or state.temperature == pytest.approx(theta)
    mass, momentum, energy = (run[name].values[-1] for name in ("mass", "momentum", "energy"))
    u = momentum / mass
    assert abs(u - state.mean_velocity) < 4 * run["momentum_stderr"].values[-1] / mass
    spread = run["energy_stderr"].values[-1] / mass + abs(u) * run["momentum_stderr"].values[-1] / mass
    assert abs(2 * energy / mass - u**2 - state.temperature) < 8 * spread


def test_the_dataset(make_scene: MakeScene) -> None:
    run = simulate(make_scene(collisions=FOLLOW, run={"output_every": 0.5}, particles={"count": 5000, "replicas": 3}, grid=GRID))
    assert run.attrs["method"] == "particles"
    assert run["f"].dims == run["f_stderr"].dims == ("time", "x", "v")
    assert run["density_mode_real"].dims == ("time", "replica", "mode")
    assert run.sizes["time"] == 4
    assert (np.diff(run["collisions"].values) > 0).all()
    assert run["density"].mean("x").values == pytest.approx(0.8, rel=1e-12)
    assert run["mass"].values == pytest.approx(0.8 * 9.0, rel=1e-12)
    assert float(run["mass_stderr"].max()) < 1e-12


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"collisions": FOLLOW, "particles": {"collisions": "single-file", "count": 8}},
            "particles.count = 8: an overtaking would be a collision with the probability S_C·w = 1.08; allowed: up to 1; raise "
            "particles.count to 9 or more",
        ),
        ({"initial": {"modes": [], "eigenmodes": [{"mode": 1, "cos": 0.01}]}}, "initial.eigenmodes: the particles start"),
    ],
)
def test_refusals(make_scene: MakeScene, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(make_scene(**changes))


def test_the_command_line(command: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        '[pipe]\nlength = 9.0\n[collisions]\noperator = "follow-the-leader"\ncross_section = 1.2\n'
        "[run]\nend_time = 0.5\n[particles]\ncount = 5000\nreplicas = 2\n"
    )
    done = command("run", "scene.toml", "--method", "particles", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "million particle-steps a second" in done.stdout
    with xr.open_dataset(tmp_path / "scene.nc") as run:
        assert run.attrs["method"] == "particles"
        assert int(run["status"]) == 1
        assert np.isfinite(run["density_stderr"].values).all()


def test_frames_of_two_cadences(make_scene: MakeScene) -> None:
    """Each group is handed over when the schedule says, and no other."""
    output = {"f": 0.2, "moments": 0.3, "particles": 0.5}
    scene = make_scene(run={"end_time": 1.0}, output=output, particles={"count": 50}, grid={"nx": 5, "nv": 16})

    class Handed:
        def __init__(self) -> None:
            self.frames: list[tuple[float, set[str]]] = []

        def record(self, time: float, frame: Frame) -> None:
            self.frames.append((time, set(frame)))

        def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None: ...

    plan, recorder = make_plan(scene), Handed()
    run_plan(plan, recorder)
    schedule = Schedule.of(scene, GROUPS)
    assert recorder.frames == list(zip(schedule.times.tolist(), map(set, schedule.due), strict=True))
    assert [time for time, _ in recorder.frames] == pytest.approx([0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 0.9, 1])
    assert recorder.frames[1][1] == {"f"}


def test_the_default_step_and_cells_see_the_flow_and_the_densest_place(make_scene: MakeScene) -> None:
    """Streams that cross, and a thin dense layer, against a run of half the steps and cells, which has a
    quarter of the errors: energies and momenta to 4 standard errors."""
    streams = make_scene(
        model={"gravity": 0.0, "friction": 0.1, "noise": 0.0025},
        collisions={"operator": "follow-the-leader", "cross_section": 1.0},
        initial={"density": 1.0, "modes": [], "velocity_modes": [{"mode": 1, "sin": 5.0}], "mean_velocity": 0.0},
        run={"end_time": 1.0},
        grid=GRID,
        particles={"count": 20_000, "replicas": 8},
    )
    layer = make_scene(
        model={"gravity": 1.0, "friction": 1.0, "noise": 1.0},
        collisions={"operator": "follow-the-leader", "cross_section": 1.0},
        pipe={"length": 25.0},
        initial={"density": 1.0, "modes": [], "step": {"from": 0.2, "to": 0.25, "ratio": 30.0}},
        run={"end_time": 1.0},
        grid=GRID,
        particles={"count": 40_000, "replicas": 8},
    )
    for scene in (streams, layer):
        run = simulate(scene)
        fine = scene.particles.model_copy(
            update={"cells": 2 * make_plan(scene).cells, "time_step": make_plan(scene).time_step / 2, "seed": 2}
        )
        again = simulate(scene.model_copy(update={"particles": fine}))
        for name in ("energy", "momentum"):
            error = np.hypot(run[f"{name}_stderr"].values[-1], again[f"{name}_stderr"].values[-1])
            assert abs(run[name].values[-1] - again[name].values[-1]) < 4 * error, name


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"output": {"f": False, "moments": False, "scalars": False}}, "nothing would be written"),
        ({"collisions": FOLLOW, "particles": {"time_step": 1e-90}}, "allowed: fewer than 2³² steps"),
        ({"pipe": {"length": 1e-90}, "initial": {"modes": []}}, "so that places have no digits left"),
        ({"model": {"gravity": 1e30}}, "all velocities are 1.42857e.30 to within rounding"),
        (
            {"model": {"noise": 0.0}, "initial": {"temperature": 1e-90, "modes": []}},
            "grid.velocity_window: all velocities are 1",
        ),
        ({"particles": {"cells": 10**21}, "collisions": FOLLOW}, "reduce them"),
    ],
)
def test_what_cannot_be_resolved_is_refused(make_scene: MakeScene, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(make_scene(**changes))


def test_the_window_follows_what_friction_reaches(make_scene: MakeScene) -> None:
    slow, free = (
        make_plan(make_scene(model={"friction": friction, "gravity": 1.0, "noise": 0.5}, initial={"mean_velocity": 0.0}))
        for friction in (1e-9, 0.0)
    )
    assert (slow.grid.low, slow.grid.high) == pytest.approx((free.grid.low, free.grid.high), rel=1e-6)
    assert slow.grid.high - slow.grid.low < 20


def test_seeds_and_replicas_do_not_meet() -> None:
    assert not np.array_equal(key(1, 2), key(1 + 2 * 2**32, 0))


def test_particles_outside_the_window_are_warned_of(command: Command, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        "[pipe]\nlength = 9.0\n[run]\nend_time = 0.5\n[particles]\ncount = 500\n[grid]\nvelocity_window = [100.0, 101.0]\n"
    )
    done = command("run", "scene.toml", "--method", "particles", folder=tmp_path)
    assert done.returncode == 0
    assert "warning: up to 1 of the particles are outside the velocity window and missing in f and w(v)" in done.stderr
