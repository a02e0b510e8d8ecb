"""What docs/using.md shows, runs."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
from matplotlib.animation import PillowWriter

from kinetic_solver import Scene

Command = Callable[..., subprocess.CompletedProcess[str]]
PAGE = (Path(__file__).parents[2] / "docs" / "using.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_python(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the cluster, which not every machine has."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    local = [block for block in blocks("python") if "dask" not in block]
    assert len(local) == 5
    for block in local:
        exec(block, names)
    assert "cross_section = 3" in capsys.readouterr().out
    assert names["run"].attrs["method"] == "grid"
    assert (tmp_path / "run.gif").exists()
    assert (tmp_path / "sweep.png").exists()
    names["movie"].save(tmp_path / "movie.gif", PillowWriter(5))
    plt.close("all")


def test_toml(tmp_path: Path) -> None:
    table = blocks("toml")[0]
    (tmp_path / "scene.toml").write_text(f"[pipe]\nlength = 3.0\n[run]\nend_time = 1.0\n{table}", encoding="utf-8")
    assert Scene.from_toml(tmp_path / "scene.toml").output.nx == 128


def test_commands(command: Command, tmp_path: Path) -> None:
    """Those that write a scene; the sweep's are in test_sweep.py."""
    lines = [line.partition("#")[0].split() for line in blocks("sh")[1].splitlines()]
    for _, *arguments in lines:
        assert command(*arguments, folder=tmp_path).returncode == 0, arguments


def test_from_nothing_to_a_sweep(command: Command, tmp_path: Path) -> None:
    """One after the other, of a scene that is quicker. Sweeps are in test_sweep.py, doctors in test_for_other_programs.py."""
    quick = "accuracy = { rtol = 1e-2 }\nparticles = { count = 300 }\npipe = { length = 9.0 }\nrun = { end_time = 0.5 }\n"
    lines = [line.partition("#")[0].split()[1:] for line in blocks("sh")[0].splitlines() if line.startswith("kinetic-solver")]
    assert [line[0] for line in lines] == ["doctor", "init", "describe", "run", "plot", "animate", "run", "compare", "sweep"]
    for arguments in lines[1:-1]:
        assert command(*arguments, folder=tmp_path).returncode == 0, arguments
        if arguments[0] == "init":
            (tmp_path / "scene.toml").write_text(quick, encoding="utf-8")
    assert {"scene.nc", "scene.png", "scene.gif", "particles.nc"} <= {path.name for path in tmp_path.iterdir()}
