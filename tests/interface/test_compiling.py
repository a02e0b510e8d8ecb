"""Compilation is said while it happens, once, and only where it happens; it is not a run's time."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from kinetic_solver import compiling

SCENE = """
[model]
gravity = 0.3
friction = 1.2
noise = 0.8
[collisions]
operator = "inelastic"
cross_section = 0.7
restitution = 0.6
[pipe]
length = 5.0
[run]
end_time = 0.2
[initial]
density = 0.9
temperature = 0.6
[grid]
nx = 1
nv = 24
[accuracy]
rtol = 1e-2
"""


def square(x: float) -> float:
    return x * x


def test_it_is_said_once_and_the_clock_stands_still(capsys: pytest.CaptureFixture[str]) -> None:
    compiling.watch()
    with compiling.announcing():
        began, ours = time.monotonic(), compiling.monotonic()
        assert numba.njit(square)(3.0) == 9.0
        assert capsys.readouterr().err == f"{compiling.LINE}\n"
        took, taken_for_a_runs = time.monotonic() - began, compiling.monotonic() - ours
        assert numba.njit(square)(4.0) == 16.0
    assert capsys.readouterr().err == ""
    assert 0 <= taken_for_a_runs < took


def test_nobody_who_does_not_ask_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    compiling.watch()
    assert numba.njit(square)(3.0) == 9.0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("entrance", ["solve(scene, progress=True)", "sweep(scene, {'model.noise': [0.7, 0.9]}, say=print)"])
def test_every_entrance_says_it_once(tmp_path: Path, entrance: str) -> None:
    """A sweep's points compile in several processes at a time; one of them says it."""
    (tmp_path / "scene.toml").write_text(SCENE)
    lines = ("from kinetic_solver import Scene, solve, sweep", "scene = Scene.from_toml('scene.toml')", entrance)
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines().count(compiling.LINE) == 1


def test_the_command_says_it_where_its_loops_are_not_kept_yet(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def said() -> list[str]:
        command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "-o", "out.nc", "--overwrite"]
        done = subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, text=True, check=True)
        return [line for line in done.stderr.splitlines() if line != "starting"]  # as a busy machine makes it say

    first, second = said(), said()
    assert [line for line in first if line != compiling.LINE] == second
    assert first.count(compiling.LINE) == 1
