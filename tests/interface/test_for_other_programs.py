"""--json, doctor, and the verdict that nothing can be said."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from kinetic_solver import Scene, exact
from kinetic_solver.analysis import doctor
from kinetic_solver.compare import compare
from kinetic_solver.dataset import write_dataset
from particles.simulation import simulate

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def folder(make_scene: MakeScene, tmp_path: Path) -> Path:
    """scene.toml, exact.nc of it, other.nc of twice the noise, few.nc of particles whose steps are long."""
    scene = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 0.9},
        grid={"nx": 17, "nv": 48},
        particles={"count": 2000, "replicas": 8},
    )
    (tmp_path / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    write_dataset(exact.solve(scene), tmp_path / "exact.nc")
    write_dataset(exact.solve(scene.replace(**{"model.noise": 1.0})), tmp_path / "other.nc")
    write_dataset(simulate(scene.replace(**{"particles.time_step": 0.8})), tmp_path / "few.nc")
    return tmp_path


def test_a_scene_and_a_run_as_json(command: Command, folder: Path) -> None:
    described = json.loads(command("describe", "scene.toml", "--json", folder=folder).stdout)
    assert described["Equation"]["coefficients"] == "g = 1.3, γ = 0.7, σ = 0.5, L = 9"
    assert "nx" in described["Run on the grid"]
    assert described["Run on the grid"]["seconds"] > 0
    run = json.loads(command("info", "exact.nc", "--json", folder=folder).stdout)
    assert (run["method"], run["status"], run["sizes"]["v"], run["time"]) == ("exact", "finished", 48, [0.0, 1.5])
    assert run["mass"] == pytest.approx([7.2, 7.2])
    assert run["scene"]["model"]["noise"] == 0.5


def test_a_comparison_as_json(command: Command, folder: Path) -> None:
    done = command("compare", "exact.nc", "other.nc", "--json", "-o", "out.nc", folder=folder)
    assert done.returncode == 4
    found = json.loads(done.stdout)
    assert found["differ"] is True
    assert found["verdict"].startswith("they differ")
    assert {row["field"] for row in found["rows"]} >= {"density", "f", "temperature"}
    assert done.stderr == "wrote out.nc\n"


def test_what_cannot_be_judged_is_5(command: Command, folder: Path) -> None:
    """Steps so long that what they do wrong may be more than a tenth: nothing found says nothing."""
    found = compare(folder / "exact.nc", folder / "few.nc")
    assert not found.differ
    assert found.hidden > 0.1
    assert not found.conclusive
    done = command("compare", "exact.nc", "few.nc", folder=folder)
    assert done.returncode == 5
    percent = f"{100 * found.hidden:.2g}"
    assert done.stdout.splitlines()[-1].startswith(f"inconclusive: differences below {percent} % cannot be judged: p = ")
    same = compare(folder / "exact.nc", folder / "exact.nc")
    assert same.conclusive
    assert same.verdict.startswith("no difference found")


def test_doctor(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = command("doctor", folder=tmp_path)
    assert done.returncode == 0
    for text in ("numba", "BLAS", "cores", "grid, exact steps", "passed: error"):
        assert text in done.stdout
    assert "FAILED" not in done.stdout
    monkeypatch.setattr(doctor, "SIGMAS", 0.0)
    failed = command("doctor", "--json", folder=tmp_path)
    assert failed.returncode == 1
    found = json.loads(failed.stdout)
    assert found["healthy"] is False
    assert found["Self-test"]["particles"].startswith("FAILED: energy")
