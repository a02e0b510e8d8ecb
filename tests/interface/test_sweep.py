"""Sweeps: one dataset on one grid, whatever runs the points; files that are found again; failures as results."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, sweep
from kinetic_solver.dataset import open_netcdf
from kinetic_solver.sweeps import parse_values
from kinetic_solver.sweeps.combined import combined
from kinetic_solver.sweeps.points import points, run_point
from particles import simulate

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]
LAW = {"operator": "follow-the-leader", "cross_section": 0.9}
SMALL = {"accuracy": {"rtol": 1e-2}, "run": {"end_time": 0.4, "output_every": 0.2}, "output": {"nx": 9, "nv": 24}}


@pytest.fixture
def threads() -> Any:
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=0.2:3:15", ("a.b", np.linspace(0.2, 3, 15).tolist())),
        ("a.b = 3:-1:2", ("a.b", [3.0, -1.0])),
        ("a.b=1,2,5", ("a.b", [1, 2, 5])),
        ("a.b=dsmc, single-file", ("a.b", ["dsmc", "single-file"])),
        ("a.b=2.5", ("a.b", 2.5)),
        ("a.b=[-1.0, 2.0]", ("a.b", [-1.0, 2.0])),
    ],
)
def test_values_as_text(text: str, expected: tuple[str, Any]) -> None:
    assert parse_values(text) == expected


@pytest.mark.parametrize("text", ["a=1:2", "a=1:2:3:4", "a=1:2:2.5", "a=1:2:1", "a=x:2:3", "a=1:inf:3", "a=2:2:5", "nonsense"])
def test_text_that_is_no_values(text: str) -> None:
    with pytest.raises(SceneError, match=r"allowed: |expected a\.b=value"):
        parse_values(text)


def test_one_dataset_with_the_parameters_first(make_scene: MakeScene, threads: Any) -> None:
    """Every point is what its scene says; x and v are those of one grid that holds all."""
    base = make_scene(**{**SMALL, "collisions": LAW, "output": {}})
    values = {"collisions.cross_section": [0.3, 0.9, 2.0], "initial.temperature": np.array([0.2, 0.6])}
    found = sweep(base, values, executor=threads)
    assert found["f"].dims == ("collisions.cross_section", "initial.temperature", "time", "x", "v")
    assert found["f"].shape[:3] == (3, 2, 3)
    assert found["energy"].dims == ("collisions.cross_section", "initial.temperature", "time")
    assert (found["status"] == 1).all()
    assert (found["error"] == "").all()
    for place in ((0, 1), (2, 0)):
        point = found[{"collisions.cross_section": place[0], "initial.temperature": place[1]}]
        scene = base.replace(**{key: float(point[key]) for key in values})
        truth = exact.solve(scene, found["x"], found["v"])
        assert float(np.abs(point["density"] - truth["density"]).max()) < 1e-2
        assert float(np.abs(point["f"] - truth["f"]).max()) < 1e-2 * float(truth["f"].max())
    assert Scene.model_validate_json(found.attrs["scene"]) == base
    assert np.isfinite(found["f"].values).all()


def test_points_are_files_that_are_found_again(make_scene: MakeScene, tmp_path: Path, threads: Any) -> None:
    base = make_scene(**SMALL, collisions=LAW)
    said: list[str] = []
    first = sweep(base, {"collisions.cross_section": [0.3, 0.9]}, tmp_path / "out", executor=threads)
    files = sorted((tmp_path / "out" / "points").iterdir())
    assert [path.suffix for path in files] == [".nc", ".nc"]
    before = [path.stat().st_mtime_ns for path in files]
    more = sweep(base, {"collisions.cross_section": [0.3, 0.6, 0.9]}, tmp_path / "out", executor=threads, say=said.append)
    assert [path.stat().st_mtime_ns for path in files] == before
    assert said == ["2 of 3 points are there already, or have no scene", "1 of 1: collisions.cross_section = 0.6"]
    xr.testing.assert_equal(more.isel({"collisions.cross_section": [0, 2]})["f"], first["f"])
    written = open_netcdf(tmp_path / "out" / "sweep.nc")
    np.testing.assert_array_equal(written["f"], more["f"])
    assert written["collisions.cross_section"].values.tolist() == [0.3, 0.6, 0.9]
    written.close()


def test_a_failed_point_is_a_result(make_scene: MakeScene, tmp_path: Path, threads: Any) -> None:
    """A scene that is refused, one that the method cannot run, and one that stops while running: its frames until then stay."""
    cooling = make_scene(
        model={"friction": 0.0, "noise": 0.0, "gravity": 0.0},
        collisions={"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5},
        initial={"modes": []},
        run={"end_time": 30.0, "output_every": 0.5},
        grid={"nv": 48, "velocity_window": [-5.0, 5.0]},
    )
    values = {"collisions.restitution": [0.5, 1.5, 0.999]}
    found = sweep(cooling, values, tmp_path, executor=threads)
    assert found["status"].values.tolist() == [2, 2, 1]
    stopped, refused, fine = found["error"].values.tolist()
    assert stopped.startswith("SolverStopped: ")
    assert "raise grid.nv" in stopped
    assert refused == "SceneError: collisions.restitution = 1.5: input should be less than or equal to 1"
    assert fine == ""
    frames = np.isfinite(found["temperature"].values[..., 0]).sum(axis=1)
    assert 2 < frames[0] < 61
    assert frames[1:].tolist() == [0, 61]
    again = sweep(cooling, values, tmp_path, executor=threads)
    xr.testing.assert_equal(again, found)


def test_what_no_point_can_have_is_refused(make_scene: MakeScene, tmp_path: Path, threads: Any) -> None:
    scene = make_scene(**SMALL)
    for values, message in (
        ({"model.frictoin": [0.5, 0.7]}, "did you mean 'friction'?"),
        ({"model.friction": 0.5}, "'model.friction' = 0.5: is one value"),
        ({"model.friction": "thick"}, "is one value"),
        ({"model.friction": []}, "has no values"),
        ({"model.friction": [0.5, 0.5]}, "has a value twice"),
        ({}, "there are no keys"),
    ):
        with pytest.raises(SceneError) as caught:
            sweep(scene, values, tmp_path, executor=threads)  # type: ignore[arg-type]
        assert message in str(caught.value)
    with pytest.raises(SceneError, match="method = 'guess': unknown"):
        sweep(scene, {"model.friction": [0.5]}, method="guess")
    (tmp_path / "file").touch()
    with pytest.raises(SceneError, match="is a file"):
        sweep(scene, {"model.friction": [0.5]}, tmp_path / "file")


def test_seeds_follow_from_the_point(make_scene: MakeScene, threads: Any) -> None:
    """Independent of what other points there are; the same whenever it is run; one's own where the seed is swept."""
    scene = make_scene(**SMALL, collisions=LAW, particles={"count": 300, "replicas": 2, "seed": 7})

    def run(values: dict[str, Any]) -> xr.Dataset:
        return sweep(scene, values, method="particles", executor=threads)

    two, one = run({"model.gravity": [0.4, 0.9]}), run({"model.gravity": [0.9]})
    np.testing.assert_array_equal(two["energy"][1], one["energy"][0])
    still = run({"particles.cells": [9, 11]})
    assert not np.array_equal(still["energy"][0, 0], still["energy"][1, 0])  # other numbers drawn for the same start
    own = run({"particles.seed": [7, 8]})
    np.testing.assert_array_equal(own["energy"][0], simulate(scene)["energy"])
    other = scene.replace(**{"particles.seed": 8})
    assert not np.array_equal(sweep(other, {"model.gravity": [0.9]}, None, "particles", threads)["energy"], one["energy"])


def test_times_lengths_and_words(make_scene: MakeScene, threads: Any) -> None:
    """Points of other times have missing values; those of other lengths lie over x/L; words are a coordinate too."""
    scene = make_scene(**SMALL, collisions=LAW)
    times = sweep(scene, {"run.end_time": [0.2, 0.4]}, executor=threads)
    assert times["time"].values == pytest.approx([0.0, 0.2, 0.4])
    assert np.isnan(times["mass"].values).tolist() == [[False, False, True], [False, False, False]]
    lengths = sweep(scene, {"pipe.length": [5.0, 11.0]}, executor=threads)
    assert lengths["x"].values == pytest.approx(np.arange(9) / 9)
    assert lengths["mass"].values[:, 0] == pytest.approx([4.0, 8.8])
    words = sweep(scene, {"grid.velocity": ["points", "hermite"]}, executor=threads)
    assert words["grid.velocity"].values.tolist() == ["points", "hermite"]
    assert words["f"].sizes["grid.velocity"] == 2


def test_the_whole_takes_little_more_memory_than_itself(make_scene: MakeScene, tmp_path: Path) -> None:
    """Points are put into it one at a time."""
    output = {"nx": 65, "nv": 80, "velocity_window": [-6.0, 8.0]}
    scene = make_scene(output=output, run={"end_time": 1.5, "output_every": 0.1}, accuracy={"rtol": 1e-2})
    values = {"model.gravity": [0.1 * n for n in range(12)]}
    listed = list(points(scene, values, "grid", tmp_path))
    for point in listed:
        run_point(point)
    combined(scene, {"model.gravity": [0.0]}, listed[:1])  # what is imported and kept for once and all
    tracemalloc.start()
    found = combined(scene, values, listed)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found["f"].shape == (12, 16, 65, 80)
    assert found["time"].attrs == {"long_name": "time", "units": "time"}
    assert most < 1.6 * found.nbytes


def test_replicas_as_a_key(make_scene: MakeScene, threads: Any) -> None:
    """Points of other numbers of replicas: those that one does not have are missing."""
    scene = make_scene(particles={"count": 200}, grid={"nx": 5, "nv": 16}, output={"f": False})
    found = sweep(scene, {"particles.replicas": [2, 3]}, method="particles", executor=threads)
    shares = found["density_replica"].isel(time=-1, x=0)
    assert np.isfinite(shares).sum("replica").values.tolist() == [2, 3]


def test_from_the_command_line(command: Command, make_scene: MakeScene, tmp_path: Path) -> None:
    """In processes of their own."""
    (tmp_path / "scene.toml").write_text(make_scene(**SMALL, collisions=LAW).to_toml(), encoding="utf-8")
    arguments = ("sweep", "scene.toml", "--set", "collisions.cross_section=0.3:1.5:3", "--set", "model.gravity=0.4", "-o", "out")
    done = command(*arguments, folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "wrote out/sweep.nc: 3 points\n")
    assert "3 of 3: collisions.cross_section = " in done.stderr
    with open_netcdf(tmp_path / "out" / "sweep.nc") as found:
        assert found["collisions.cross_section"].values == pytest.approx([0.3, 0.9, 1.5])
        assert Scene.model_validate_json(found.attrs["scene"]).model.gravity == 0.4
    again = command(*arguments, folder=tmp_path)
    assert "3 of 3 points are there already" in again.stderr
    wrong = command("sweep", "scene.toml", "--set", "model.gravity=0.4", "-o", "out", folder=tmp_path)
    assert (wrong.returncode, "is one value" in wrong.stderr) == (2, True)


def test_in_a_script_at_its_top_level(tmp_path: Path) -> None:
    """Spawned processes do not run it again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from kinetic_solver import Scene, sweep\n"
        "print('begun')\n"
        "scene = Scene.model_validate({'pipe': {'length': 3.0}, 'run': {'end_time': 0.1}})\n"
        "print(sweep(scene, {'model.noise': [0.5, 0.7]})['status'].values.tolist())\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "begun\n[1, 1]\n"


def test_values_are_told_in_six_digits(make_scene: MakeScene) -> None:
    said: list[str] = []
    values = {"collisions.cross_section": [0.2, 0.9466666666666665], "output.nx": [9]}
    sweep(make_scene(**{**SMALL, "collisions": LAW}), values, say=said.append)
    assert any("collisions.cross_section = 0.946667, output.nx = 9" in text for text in said)
