"""Runs that are stopped and resumed: the same file as one that ran through."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import RunUnfinished, Scene, SceneError, run_to_file
from kinetic_solver.dataset import FINISHED, open_run

SCENE = """
[model]
gravity = 1.0
[collisions]
operator = "follow-the-leader"
cross_section = 1.2
[pipe]
length = 9.0
[initial]
modes = [{ mode = 1, cos = 0.4 }]
[run]
end_time = 2.0
output_every = 0.25
[output]
f = 0.5
[particles]
count = 3000
replicas = 2
seed = 5
"""


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "--method", "particles", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def test_stopped_and_resumed(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    assert run(tmp_path, "-o", "straight.nc").returncode == 0
    stopped = run(tmp_path, "-o", "out.nc", "--max-walltime", "0")
    assert stopped.returncode == 3, stopped.stderr
    assert "stopped at t = 0 after 0 s; resume it to go on (--resume)" in stopped.stderr
    with xr.open_dataset(tmp_path / "out.nc") as part:
        assert int(part["status"]) == 2
        assert part.sizes["time"] == 1
    assert (tmp_path / "out.nc.checkpoint").exists()
    again = run(tmp_path, "-o", "out.nc", "--resume", "--max-walltime", "0")
    assert 0 < float(again.stderr.split("t = ")[1].split(" ")[0]) < 0.02, again.stderr  # one step of one replica later
    changed = run(tmp_path, "-o", "out.nc", "--resume", "--set", "particles.seed=6")
    assert changed.returncode == 2
    assert "is of another scene (particles.seed differ)" in changed.stderr
    done = run(tmp_path, "-o", "out.nc", "--resume")
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "out.nc.checkpoint").exists()
    with xr.open_dataset(tmp_path / "straight.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert "stopped" not in found.attrs
        assert set(found.variables) == set(expected.variables)
        for name in expected.variables:
            assert np.array_equal(expected[name].values, found[name].values, equal_nan=True), name
    finished = run(tmp_path, "-o", "out.nc", "--resume")
    assert (finished.returncode, finished.stdout) == (0, "it has finished already\nout.nc is complete\n")


@pytest.fixture
def stopped(tmp_path: Path) -> Path:
    """The file of a run that was stopped at its first frame, its checkpoint beside it."""
    path = tmp_path / "out.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene(tmp_path), path, "particles", max_walltime=0)
    return path


def scene(folder: Path, **overrides: Any) -> Scene:
    (folder / "scene.toml").write_text(SCENE)
    return Scene.from_toml(folder / "scene.toml", overrides)


def refusal(path: Path) -> str:
    """Why the run into this file is not resumed."""
    with pytest.raises(SceneError) as caught:
        run_to_file(scene(path.parent), path, "particles", resume=True)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_resume_without_a_checkpoint_starts_afresh(tmp_path: Path) -> None:
    short = scene(tmp_path, **{"run.end_time": 0.25})
    for _ in range(2):
        run_to_file(short, tmp_path / "out.nc", "particles", resume=True)
        with open_run(tmp_path / "out.nc") as found:
            assert found["time"].values.tolist() == [0, 0.25]
            assert int(found["status"]) == FINISHED


def test_a_broken_checkpoint_is_said(stopped: Path) -> None:
    checkpoint = stopped.with_name("out.nc.checkpoint")
    whole = checkpoint.read_bytes()
    for broken in (b"", b"nonsense", whole[:1000], whole[:-100]):
        checkpoint.write_bytes(broken)
        assert "is not a readable checkpoint; remove it to start afresh" in refusal(stopped)


def test_a_damaged_scene_is_said(stopped: Path) -> None:
    """In the checkpoint, and in the run's file."""
    checkpoint = stopped.with_name("out.nc.checkpoint")
    with np.load(checkpoint) as whole:
        state = dict(whole)
    with checkpoint.open("wb") as file:
        np.savez(file, **{**state, "scene": '{"pipe": {}}'})
    assert "is not a readable checkpoint; remove it to start afresh" in refusal(stopped)
    with netCDF4.Dataset(stopped, "a") as run_of:
        run_of.scene = '{"pipe": {}}'
    assert "out.nc: its scene cannot be read" in refusal(stopped)


def test_a_file_that_lost_its_end_is_not_continued(stopped: Path) -> None:
    whole = stopped.read_bytes()
    stopped.write_bytes(whole[: len(whole) // 2])
    assert "out.nc: is cut short: it has " in refusal(stopped)


def test_a_file_of_another_method_is_not_continued(tmp_path: Path) -> None:
    run_to_file(scene(tmp_path), tmp_path / "out.nc", "exact")
    assert "out.nc: is a run of method 'exact'; allowed: another name" in refusal(tmp_path / "out.nc")
