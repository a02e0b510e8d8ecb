"""Runs that are stopped and resumed: the same file as one that ran through."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

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
    assert "stopped at t = 0.25" in again.stderr
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


def test_resume_without_a_checkpoint_starts_afresh(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    done = run(tmp_path, "-o", "out.nc", "--resume", "--set", "run.end_time=0.25")
    assert done.returncode == 0, done.stderr
    assert "out.nc is complete" in done.stdout


def test_a_broken_checkpoint_is_said(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    assert run(tmp_path, "-o", "out.nc", "--max-walltime", "0").returncode == 3
    whole = (tmp_path / "out.nc.checkpoint").read_bytes()
    for broken in (b"", b"nonsense", whole[:1000], whole[:-100]):
        (tmp_path / "out.nc.checkpoint").write_bytes(broken)
        done = run(tmp_path, "-o", "out.nc", "--resume")
        assert done.returncode == 2
        assert "is not a readable checkpoint; remove it to start afresh" in done.stderr


def test_a_damaged_scene_is_said(tmp_path: Path) -> None:
    """In the run's file, and in the checkpoint."""
    (tmp_path / "scene.toml").write_text(SCENE)
    assert run(tmp_path, "-o", "out.nc", "--max-walltime", "0").returncode == 3
    with np.load(tmp_path / "out.nc.checkpoint") as whole:
        state = dict(whole)
    with (tmp_path / "out.nc.checkpoint").open("wb") as file:
        np.savez(file, **{**state, "scene": '{"pipe": {}}'})
    done = run(tmp_path, "-o", "out.nc", "--resume")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "is not a readable checkpoint" in done.stderr
    with netCDF4.Dataset(tmp_path / "out.nc", "a") as file:
        file.scene = '{"pipe": {}}'
    done = run(tmp_path, "-o", "out.nc", "--resume")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "out.nc: its scene cannot be read" in done.stderr


def test_a_file_that_lost_its_end_is_not_continued(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    assert run(tmp_path, "-o", "out.nc", "--max-walltime", "0").returncode == 3
    whole = (tmp_path / "out.nc").read_bytes()
    (tmp_path / "out.nc").write_bytes(whole[: len(whole) // 2])
    done = run(tmp_path, "-o", "out.nc", "--resume")
    assert done.returncode == 2
    assert "has lost what was written before the checkpoint" in done.stderr


def test_a_file_of_another_method_is_not_continued(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "-o", "out.nc", "--method", "exact"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=120).returncode == 0
    done = run(tmp_path, "-o", "out.nc", "--resume")
    assert done.returncode == 2
    assert "out.nc: is a run of method 'exact'; allowed: another name" in done.stderr


def test_resume_is_for_particles(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "--resume"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert "resume: method 'grid' keeps no checkpoints, and starts afresh; allowed: with method 'particles'" in done.stderr
