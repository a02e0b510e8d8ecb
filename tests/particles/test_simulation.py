"""Particles against the closed form, restarts, threads, the dataset, and what is refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact
from particles.simulation import Simulation, make_plan, simulate

MakeScene = Callable[..., Scene]
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

    straight = Simulation(plan)
    straight.advance_to(0.6)
    kept = straight.state()
    expected = finish(straight)
    resumed = Simulation(plan, kept)
    threads = numba.get_num_threads()
    numba.set_num_threads(2)
    try:
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
    from kinetic_solver.homogeneous import homogeneous_state

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


def test_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        '[pipe]\nlength = 9.0\n[collisions]\noperator = "follow-the-leader"\ncross_section = 1.2\n'
        "[run]\nend_time = 0.5\n[particles]\ncount = 5000\nreplicas = 2\n"
    )
    command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "--method", "particles"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "million particle-steps a second" in done.stdout
    with xr.open_dataset(tmp_path / "scene.nc") as run:
        assert run.attrs["method"] == "particles"
        assert int(run["status"]) == 1
        assert np.isfinite(run["density_stderr"].values).all()
