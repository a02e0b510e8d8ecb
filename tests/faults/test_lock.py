"""One writer: the second process is refused, and the lock of one that was killed is free."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from kinetic_solver import Scene, SceneError, run_to_file
from kinetic_solver.dataset import one_writer

HOLD = """
import sys, time
from pathlib import Path
from kinetic_solver.dataset import one_writer
with one_writer(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def holder(path: Path) -> subprocess.Popen[bytes]:
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    return process


def test_the_second_writer_is_refused(make_scene: Callable[..., Scene], tmp_path: Path) -> None:
    path, lock = tmp_path / "a.nc", tmp_path / "a.nc.lock"
    scene = make_scene(run={"end_time": 0.5}, grid={"nx": 9, "nv": 32}, accuracy={"rtol": 1e-2})
    process = holder(path)
    try:
        message = rf"a\.nc: is being written by process {process.pid}; allowed: another name, or to wait for its end$"
        for arguments in ({}, {"overwrite": True}, {"resume": True}):
            with pytest.raises(SceneError, match=message):
                run_to_file(scene, path, **arguments)
        run_to_file(scene, tmp_path / "b.nc")
        os.kill(process.pid, signal.SIGKILL)
    finally:
        process.kill()
        process.communicate()
    assert lock.exists()
    run_to_file(scene, path)
    assert not lock.exists()


def test_a_lock_is_given_back(tmp_path: Path) -> None:
    for _ in range(2):
        with (
            one_writer(tmp_path / "a.nc"),
            pytest.raises(SceneError, match=f"by process {os.getpid()}"),
            one_writer(tmp_path / "a.nc"),
        ):
            pass
    with pytest.raises(ZeroDivisionError), one_writer(tmp_path / "a.nc"):
        _ = 1 / 0
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with (
        pytest.raises(SceneError, match=r"a\.nc: cannot be created \(its folder does not exist\)"),
        one_writer(tmp_path / "b" / "a.nc"),
    ):
        pass
