"""Shared scenes. Parameters differ from one another and from one, so that an error of convention shows."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
# Two threads to compare with one, even where there is one core; but the tests themselves run in parallel.
os.environ.setdefault("NUMBA_NUM_THREADS", "2")

import copy
import math
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from kinetic_solver.scene import Scene

# The same examples in every run, so that a failure belongs to the change at hand: `pytest --hypothesis-profile=others` draws
# others. No deadline: the machine may be busy.
settings.register_profile("same", deadline=None, derandomize=True)
settings.register_profile("others", deadline=None, derandomize=False)
settings.load_profile("same")

BASE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
    "run": {"end_time": 1.5},
}


def merge(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    result = copy.deepcopy(base)
    for key, value in changes.items():
        result[key] = {**result.get(key, {}), **value} if isinstance(value, dict) else value
    return result


@pytest.fixture(autouse=True, scope="session")
def _one_numba_thread() -> None:
    import numba

    numba.set_num_threads(1)


@pytest.fixture
def make_scene() -> Callable[..., Scene]:
    """make_scene(table={...}, ...): the base scene with keys replaced; without collisions unless given."""
    return lambda **changes: Scene.model_validate(merge(BASE, changes))


@pytest.fixture
def standing_scene() -> Callable[..., Scene]:
    """ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx on L = 8π, g = γ = σ = 1, t = 2: the scene that schemes are compared on."""
    base = {
        "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
        "pipe": {"length": 8 * math.pi},
        "initial": {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
        "run": {"end_time": 2.0},
        "output": {"moments": False, "budgets": False},
    }

    def make(collision_number: float, **changes: Any) -> Scene:
        table = {"operator": "follow-the-leader", "cross_section": collision_number}
        return Scene.model_validate(merge({**base, "collisions": table}, changes))

    return make


Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Command:
    """command("run", "scene.toml", folder=path): a command in this process, which has everything imported and compiled.

    What is wrong with the command line itself (a missing argument, an unknown option) is said by `main` alone: for that, and for
    signals, start a process.
    """
    from typer.testing import CliRunner

    from kinetic_solver.cli.app import app, show_warning

    def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
        monkeypatch.chdir(folder)
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            warnings.showwarning = show_warning  # as `main` has it
            done = CliRunner().invoke(app, arguments)
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)

    return run


@pytest.fixture
def draw(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Any]:
    """draw(save, …): the figure that a save function wrote; the file is a PNG with more than empty axes in it."""
    from matplotlib.figure import Figure

    written: list[Figure] = []
    write = Figure.savefig

    def record(figure: Figure, *arguments: Any, **options: Any) -> None:
        written.append(figure)
        write(figure, *arguments, **options)

    def draw(save: Callable[..., None], *arguments: Any) -> Figure:
        path = tmp_path / "picture.png"
        save(*arguments, path)
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 20_000
        return written[-1]

    monkeypatch.setattr(Figure, "savefig", record)
    return draw
