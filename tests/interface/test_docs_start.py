"""The first page, docs/start.md: its commands run in their order, and so does its Python."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from kinetic_solver import Scene, solve

Command = Callable[..., subprocess.CompletedProcess[str]]
DOCS = Path(__file__).parents[2] / "docs"


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_the_page_does_what_it_says(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [line for block in blocks("start.md", "sh") for line in block.splitlines()]
    assert len(lines) >= 10
    for line in lines:
        program, *arguments = shlex.split(line)
        assert program == "kinetic-solver"
        done = command(*arguments, folder=tmp_path)
        assert done.returncode == 0, (line, done.stderr)
    assert (tmp_path / "out.png").exists()
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for code in blocks("start.md", "python"):
        exec(compile(code, "start.md", "exec"), names)
    assert abs(names["run"]["density"] - names["truth"]["density"]).max() < 1e-6
    with xr.open_dataset(tmp_path / "out.nc") as run:
        rate = run.kinetic.growth_rate(1)
        assert (float(rate), float(rate["uncertainty"])) == (pytest.approx(-0.09, abs=0.005), pytest.approx(0.04, abs=0.005))
        assert float(rate["kinetic_growth_rate"]) == pytest.approx(-0.063, abs=5e-4)


NUMBERS = [(0, "mean_velocity", 4.0), (0, "temperature", 1.0), (1, "mean_velocity", -2.0)]


@pytest.mark.parametrize(("number", "name", "value"), NUMBERS)
def test_the_teachers_numbers(tmp_path: Path, number: int, name: str, value: float) -> None:
    (tmp_path / "scene.toml").write_text(blocks("teaching.md", "toml")[number], encoding="utf-8")
    run: xr.Dataset = solve(Scene.from_toml(tmp_path / "scene.toml"))
    assert float(run[name].isel(time=-1, x=0)) == pytest.approx(value, rel=0.02)
