"""Starts from positions and velocities, raw output, and what is refused about them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError
from particles.plan import make_plan
from particles.simulation import Simulation, simulate

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
NO_START: dict[str, Any] = {"modes": []}


@pytest.fixture
def cloud(tmp_path: Path) -> tuple[Path, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    x, v = rng.uniform(0, 9, (2, 500)), rng.normal(2.0, 0.7, (2, 500))
    path = tmp_path / "cloud.nc"
    xr.Dataset({"x": (("replica", "particle"), x), "v": (("replica", "particle"), v)}).to_netcdf(path)
    return path, x, v


def from_file(make_scene: MakeScene, path: Path, **changes: Any) -> Scene:
    data = make_scene(**changes).model_dump(exclude_none=True, exclude_unset=True)
    data["initial"] = {"density": 0.8, "file": str(path)}
    return Scene.model_validate(data)


def test_a_start_from_a_file(make_scene: MakeScene, cloud: tuple[Path, np.ndarray, np.ndarray]) -> None:
    path, x, v = cloud
    plan = make_plan(from_file(make_scene, path))
    assert (plan.scene.particles.count, plan.scene.particles.replicas) == (500, 2)
    state = Simulation(plan).state()
    assert np.array_equal(state["x"], x)
    assert np.array_equal(state["v"], v)
    assert plan.grid.low < v.mean() - 3 < v.mean() + 3 < plan.grid.high


def test_positions_outside_the_pipe_are_wrapped_and_that_is_said(make_scene: MakeScene, tmp_path: Path) -> None:
    x, v = np.array([-0.5, 3.0, 9.0, 20.0]), np.array([0.3, -0.2, 0.1, 0.4])
    xr.Dataset({"x": ("n", x), "v": ("n", v)}).to_netcdf(tmp_path / "far.nc")
    with pytest.warns(UserWarning, match=r"far.nc': 3 of its 4 positions lie outside \[0, pipe.length = 9\): taken modulo"):
        plan = make_plan(from_file(make_scene, tmp_path / "far.nc"))
    assert Simulation(plan).state()["x"].tolist() == [[8.5, 3.0, 0.0, 2.0]]


def test_one_replica_starts_them_all(make_scene: MakeScene, cloud: tuple[Path, np.ndarray, np.ndarray]) -> None:
    path, x, v = cloud
    one = path.with_name("one.nc")
    names = {"position": ("n", x[0]), "velocity": ("n", v[0])}
    xr.Dataset(names).to_netcdf(one)
    simulation = Simulation(make_plan(from_file(make_scene, one, particles={"replicas": 3})))
    simulation.advance_to(0.1)
    state = simulation.state()
    assert state["v"].shape == (3, 500)
    assert not np.isin(state["v"][0], state["v"][1]).any()


def test_raw_particles_are_written_and_start_another_run(make_scene: MakeScene, tmp_path: Path) -> None:
    """Positions and velocities of the last frame are the next run's first, and the fields made of them are the same."""
    particles = {"count": 2000, "replicas": 2}
    scene = make_scene(collisions=FOLLOW, particles=particles, output={"particles": 1.5}, grid={"nx": 9, "nv": 32})
    first = simulate(scene)
    assert first["position"].dims == ("time", "replica", "particle")
    first.to_netcdf(tmp_path / "first.nc")
    window = (float(first["v_bounds"][0, 0]), float(first["v_bounds"][-1, 1]))
    grid = {"nx": 9, "nv": 32, "velocity_window": window}
    second = simulate(from_file(make_scene, tmp_path / "first.nc", collisions=FOLLOW, grid=grid))
    for name in ("density", "mean_velocity", "temperature", "velocity_distribution", "f"):
        assert np.array_equal(second[name].values[0], first[name].values[-1]), name


@pytest.mark.parametrize(
    ("particles", "message"),
    [
        ({"count": 501}, "particles.count = 501: allowed: 500, as in initial.file"),
        ({"replicas": 3}, "particles.replicas = 3: allowed: 2, as in initial.file"),
    ],
)
def test_another_number_is_refused(
    make_scene: MakeScene, cloud: tuple[Path, np.ndarray, np.ndarray], particles: dict[str, int], message: str
) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(from_file(make_scene, cloud[0], particles=particles))


def test_what_is_no_file_of_particles(make_scene: MakeScene, tmp_path: Path) -> None:
    bad = tmp_path / "bad.nc"
    with pytest.raises(SceneError, match="there is no such file"):
        make_plan(from_file(make_scene, bad))
    bad.write_text("nonsense")
    with pytest.raises(SceneError, match="is not a readable netCDF file"):
        make_plan(from_file(make_scene, bad))
    xr.Dataset({"f": (("time", "x", "v"), np.ones((1, 3, 4)))}, {"x": np.arange(3.0), "v": np.arange(4.0)}).to_netcdf(
        grid := tmp_path / "grid.nc"
    )
    with pytest.raises(SceneError, match="has no positions and velocities"):
        make_plan(from_file(make_scene, grid))
    xr.Dataset({"x": ("n", [0.1, np.nan]), "v": ("n", [0.0, 1.0])}).to_netcdf(lost := tmp_path / "lost.nc")
    with pytest.raises(SceneError, match="its positions or velocities are not finite for 1 of 2 particles"):
        make_plan(from_file(make_scene, lost))
    xr.Dataset({"place": ("n", [0.1, 0.2]), "speed": ("n", [0.0, 1.0])}).to_netcdf(misspelt := tmp_path / "misspelt.nc")
    with pytest.raises(SceneError, match=r"read are position and velocity, or x and v, both .*: place, speed"):
        make_plan(from_file(make_scene, misspelt))


def test_the_replicas_may_come_last(make_scene: MakeScene, cloud: tuple[Path, np.ndarray, np.ndarray]) -> None:
    path, _, v = cloud
    turned = path.with_name("turned.nc")
    with xr.open_dataset(path) as dataset:
        dataset.transpose("particle", "replica").to_netcdf(turned)
    assert np.array_equal(Simulation(make_plan(from_file(make_scene, turned))).state()["v"], v)


def test_another_period_is_refused(make_scene: MakeScene, tmp_path: Path) -> None:
    simulate(make_scene(particles={"count": 100}, output={"particles": True})).to_netcdf(tmp_path / "run.nc")
    with pytest.raises(SceneError, match=r"its period is 9, the scene's 8"):
        make_plan(from_file(make_scene, tmp_path / "run.nc", pipe={"length": 8.0}))


def test_the_last_frame_that_a_stopped_run_reached(make_scene: MakeScene, tmp_path: Path) -> None:
    x = np.array([[0.1, 0.2], [0.3, 0.4], [np.nan, np.nan]])
    names = dict.fromkeys(("position", "velocity"), (("time_particles", "replica", "particle"), x[:, None]))
    xr.Dataset(names).to_netcdf(tmp_path / "stopped.nc")
    assert Simulation(make_plan(from_file(make_scene, tmp_path / "stopped.nc"))).state()["x"].tolist() == [[0.3, 0.4]]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((("n",), np.empty(0)), "allowed: .time,. .replica,. particle, with these two names, and at least one particle"),
        ((("a", "b", "c"), np.ones((2, 2, 2))), "has dimensions a = 2, b = 2, c = 2"),
        ((("time",), np.ones(3)), "allowed: .time,. .replica,. particle"),
        ((("sample", "n"), np.ones((2, 3))), "has dimensions sample = 2, n = 3; allowed: .time,. .replica,. particle"),
        ((("n",), np.array(["one", "two"])), "allowed: numbers"),
    ],
)
def test_shapes_that_are_no_particles(make_scene: MakeScene, tmp_path: Path, values: Any, message: str) -> None:
    xr.Dataset({"position": values, "velocity": values}).to_netcdf(tmp_path / "odd.nc")
    with pytest.raises(SceneError, match=message):
        make_plan(from_file(make_scene, tmp_path / "odd.nc"))
