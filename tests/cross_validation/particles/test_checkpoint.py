"""Runs that are stopped and resumed: the same file as one that ran through."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
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


ARGUMENTS = ("run", "scene.toml", "--method", "particles", "-o", "out.nc")
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run(command: Command, tmp_path: Path) -> Command:
    """run(…): particles of the scene, into out.nc in `tmp_path`."""
    (tmp_path / "scene.toml").write_text(SCENE)
    return functools.partial(command, *ARGUMENTS, folder=tmp_path)


def test_stopped_and_resumed(run: Command, tmp_path: Path) -> None:
    """The last part in a process of its own: what it goes on from is in the files alone."""
    assert run("-o", "straight.nc").returncode == 0
    stopped = run("--max-walltime", "0")
    assert stopped.returncode == 3, stopped.stderr
    assert "stopped at t = 0 after 0 s; go on with --resume" in stopped.stderr
    with xr.open_dataset(tmp_path / "out.nc") as part:
        assert int(part["status"]) == 2
        assert part.sizes["time"] == 1
    assert (tmp_path / "out.nc.checkpoint").exists()
    again = run("--resume", "--max-walltime", "0")
    assert "stopped at t = 0.25" in again.stderr
    changed = run("--resume", "--set", "particles.seed=6")
    assert changed.returncode == 2
    assert "is of another scene (particles.seed differ)" in changed.stderr
    resume = [sys.executable, "-m", "kinetic_solver", *ARGUMENTS, "--resume"]
    done = subprocess.run(resume, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "out.nc.checkpoint").exists()
    with xr.open_dataset(tmp_path / "straight.nc") as expected, xr.open_dataset(tmp_path / "out.nc") as found:
        assert "stopped" not in found.attrs
        assert set(found.variables) == set(expected.variables)
        for name in expected.variables:
            assert np.array_equal(expected[name].values, found[name].values, equal_nan=True), name
    finished = run("--resume")
    assert (finished.returncode, finished.stdout) == (0, "it has finished already\nout.nc is complete\n")


def test_resume_without_a_checkpoint_starts_afresh(run: Command) -> None:
    done = run("--resume", "--set", "run.end_time=0.25")
    assert done.returncode == 0, done.stderr
    assert "out.nc is complete" in done.stdout


def test_a_broken_checkpoint_is_said(run: Command, tmp_path: Path) -> None:
    assert run("--max-walltime", "0").returncode == 3
    whole = (tmp_path / "out.nc.checkpoint").read_bytes()
    for broken in (b"", b"nonsense", whole[:1000], whole[:-100]):
        (tmp_path / "out.nc.checkpoint").write_bytes(broken)
        done = run("--resume")
        assert done.returncode == 2
        assert "is not a readable checkpoint; remove it to start afresh" in done.stderr


def test_a_file_that_lost_its_end_is_not_continued(run: Command, tmp_path: Path) -> None:
    assert run("--max-walltime", "0").returncode == 3
    whole = (tmp_path / "out.nc").read_bytes()
    (tmp_path / "out.nc").write_bytes(whole[: len(whole) // 2])
    done = run("--resume")
    assert done.returncode == 2
    assert "has lost what was written before the checkpoint" in done.stderr


def test_a_file_of_another_method_is_not_continued(run: Command) -> None:
    assert run("--method", "exact").returncode == 0
    done = run("--resume")
    assert done.returncode == 2
    assert "out.nc: is a run of method 'exact'; name another file with -o" in done.stderr


def test_resume_is_for_particles(run: Command) -> None:
    done = run("--method", "grid", "--resume")
    assert done.returncode == 2
    assert "--resume, --max-walltime: are for --method particles" in done.stderr
