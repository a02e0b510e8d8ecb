"""Workers of a sweep that are killed: nothing is lost, and the answer has the bits of one that was left alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import KineticError, Scene, sweep
from kinetic_solver.dataset import open_netcdf
from kinetic_solver.sweeps import execution
from kinetic_solver.sweeps.points import Point, run_point

Command = Callable[..., subprocess.CompletedProcess[str]]

SCENE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.3}]},
    "run": {"end_time": 3.0},
    "accuracy": {"rtol": 1e-2},
    "output": {"nx": 9, "nv": 24, "velocity_window": [-3.0, 6.0]},
}
VALUES = {"collisions.restitution": [0.1, 0.3, 0.6, 0.7, 0.8, 0.9]}


@pytest.fixture(scope="module")
def alone() -> xr.Dataset:
    """One point after the other, in this process."""
    with ThreadPoolExecutor(1) as pool:
        return sweep(Scene.model_validate(SCENE), VALUES, executor=pool)


def _killed_once(point: Point) -> None:
    """The process that is the first to come to the third point is killed there; whoever runs that point again finishes it."""
    mark = point.folder.parent / "killed"
    if dict(point.keys)["collisions.restitution"] == VALUES["collisions.restitution"][2] and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    run_point(point)


def test_a_killed_process_of_the_pool(tmp_path: Path, alone: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "run_point", _killed_once)
    said: list[str] = []
    found = sweep(Scene.model_validate(SCENE), VALUES, tmp_path, say=said.append)
    assert said.count("a process was killed; its point is run again") == 1
    assert (found["status"] == 1).all()
    for name in ("f", "energy", "temperature"):
        np.testing.assert_array_equal(found[name], alone[name])
    assert sorted(path.suffix for path in (tmp_path / "points").iterdir()) == [".nc"] * 6


def test_a_killed_worker_of_a_cluster(tmp_path: Path, alone: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of real processes, through its executor: the scheduler gives the point to another one."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(execution, "run_point", _killed_once)
    cluster = distributed.LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        said: list[str] = []
        found = sweep(Scene.model_validate(SCENE), VALUES, tmp_path, executor=client.get_executor(), say=said.append)
    assert (len(said), (tmp_path / "killed").exists()) == (6, True)
    for name in ("f", "energy", "temperature"):
        np.testing.assert_array_equal(found[name], alone[name])


def _dies(point: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_processes_that_die_again_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "run_point", _dies)
    with pytest.raises(KineticError, match="3 times processes died before any point was finished"):
        sweep(Scene.model_validate(SCENE), VALUES, tmp_path)


def test_the_scheduler_of_a_cluster(command: Command, tmp_path: Path, alone: xr.Dataset) -> None:
    distributed = pytest.importorskip("distributed")
    (tmp_path / "scene.toml").write_text(Scene.model_validate(SCENE).to_toml(), encoding="utf-8")
    values = ",".join(map(str, VALUES["collisions.restitution"][:2]))
    arguments = ("sweep", "scene.toml", "--set", f"collisions.restitution={values}", "-o", "out")
    with distributed.LocalCluster(1, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        done = command(*arguments, "--scheduler", cluster.scheduler_address, folder=tmp_path)
    assert done.returncode == 0
    with open_netcdf(tmp_path / "out" / "sweep.nc") as found:
        np.testing.assert_array_equal(found["f"], alone["f"][:2])


def test_a_scheduler_without_the_package(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "scene.toml").write_text(Scene.model_validate(SCENE).to_toml(), encoding="utf-8")
    arguments = ("sweep", "scene.toml", "--set", "model.gravity=1,2", "-o", "out", "--scheduler", "tcp://127.0.0.1:1")
    done = command(*arguments, folder=tmp_path)
    assert (done.returncode, "install kinetic-solver[distributed]" in done.stderr) == (2, True)
