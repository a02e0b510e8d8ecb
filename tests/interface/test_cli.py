"""The command line: exit codes, one-line errors, no files left behind."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

from kinetic_solver import Scene
from kinetic_solver.analysis.describe import describe

MakeScene = Callable[..., Scene]

Command = Callable[..., subprocess.CompletedProcess[str]]
SCENE = """
[pipe]
length = 9.0
[initial]
modes = [{ mode = 1, cos = 0.4 }]
[run]
end_time = 0.5
output_every = 0.25
"""


def cli(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "kinetic_solver", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


BAD = {
    "an unknown key": ("[modle]\n", "modle"),
    "negative friction": ("[model]\nfriction = -1.0\n", "model.friction = -1.0"),
    "NaN": ("[model]\ngravity = nan\n", "model.gravity = nan"),
    "text for a number": ('[model]\nnoise = "one"\n', "model.noise = 'one'"),
    "restitution above 1": (
        '[collisions]\noperator = "inelastic"\ncross_section = 1.0\nrestitution = 1.5\n',
        "collisions.restitution = 1.5",
    ),
    "an unknown operator": ('[collisions]\noperator = "hard"\ncross_section = 1.0\n', "collisions.operator = 'hard'"),
    "broken TOML": ("[model\n", "not valid TOML"),
    "a grid larger than memory": ("[grid]\nnx = 3000001\nnv = 3000\n", "GiB"),
    "a reversed window": ("[grid]\nvelocity_window = [3.0, -3.0]\n", "velocity_window = [3.0, -3.0]"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_scenes_exit_with_2_and_one_line(folder: Path, kind: str) -> None:
    text, message = BAD[kind]
    (folder / "scene.toml").write_text(SCENE + text)
    _refused(folder, message)


def test_modes_that_make_the_density_negative(folder: Path) -> None:
    (folder / "scene.toml").write_text(SCENE.replace("cos = 0.4", "cos = -1.4"))
    _refused(folder, "modes make the density negative")


def test_a_pipe_without_length(folder: Path) -> None:
    (folder / "scene.toml").write_text(SCENE.replace("length = 9.0", "length = 0.0"))
    _refused(folder, "pipe.length = 0.0")


def _refused(folder: Path, message: str) -> None:
    before = set(folder.iterdir())
    result = cli("run", "scene.toml", "-o", "out.nc", folder=folder)
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    assert set(folder.iterdir()) == before


def test_run_info_plot_and_overwriting(folder: Path) -> None:
    first = cli("run", "scene.toml", folder=folder)
    assert first.returncode == 0
    assert re.fullmatch(r"estimated error \S+ of max f \(accuracy.rtol = 0.0001\); limited by .*\nwrote scene.nc\n", first.stdout)
    assert "t = 0.5 of 0.5" in first.stderr
    again = cli("run", "scene.toml", folder=folder)
    assert again.returncode == 2
    assert "exists already" in again.stderr
    assert cli("run", "scene.toml", "--overwrite", "--set", "run.end_time=0.25", folder=folder).returncode == 0
    with xr.open_dataset(folder / "scene.nc") as dataset:
        assert float(dataset["time"][-1]) == 0.25
    said = cli("info", "scene.nc", folder=folder).stdout
    assert "finished" in said
    assert max(map(len, said.splitlines())) < 130
    assert "{" not in said  # the scene's keys are for programs: --json
    assert cli("plot", "scene.nc", folder=folder).stdout == "wrote scene.png\n"
    assert (folder / "scene.png").stat().st_size > 10_000
    assert cli("plot", "scene.nc", "--times", "a,b", folder=folder).returncode == 2


def test_certify(folder: Path) -> None:
    result = cli("run", "scene.toml", "-o", "sure.nc", "--certify", folder=folder)
    assert result.returncode == 0
    assert re.search(r"certified: error \S+ ± \S+, within rtol = 0.0001\nwrote sure.nc\n", result.stdout)
    with xr.open_dataset(folder / "sure.nc") as dataset:
        assert dataset["f_error"].dims == ("time", "x", "v")
        assert float(dataset["certified_error"].max()) < 1e-4
        assert dataset.attrs["certified_fields"].split() == ["f", "density", "mean_velocity", "temperature"]
    assert "certified" in cli("info", "sure.nc", folder=folder).stdout
    refused = cli("run", "scene.toml", "-o", "other.nc", "--certify", "--method", "exact", folder=folder)
    assert (refused.returncode, "--certify" in refused.stderr) == (2, True)


def test_the_exact_method(folder: Path) -> None:
    assert cli("run", "scene.toml", "--method", "exact", "-o", "exact.nc", folder=folder).returncode == 0
    with xr.open_dataset(folder / "exact.nc") as dataset:
        assert dataset.attrs["method"] == "exact"
        assert dataset["f"].dims == ("time", "x", "v")
    unknown = cli("run", "scene.toml", "--method", "guess", folder=folder)
    assert unknown.returncode == 2
    assert "'grid', 'exact'" in unknown.stderr


def test_init_writes_a_scene_that_runs_and_is_described(folder: Path) -> None:
    assert cli("init", "new.toml", folder=folder).returncode == 0
    assert cli("init", "new.toml", folder=folder).returncode == 2
    described = cli("describe", "new.toml", folder=folder)
    assert described.returncode == 0
    for text in ("R* = S ρ √σ/γ", "temperature θ_h", "ρ_c of mode 1", "velocity window", "steps", "memory"):
        assert text in described.stdout
    assert cli("run", "new.toml", "--set", "run.end_time=0.5", folder=folder).returncode == 0


def test_a_run_that_cannot_go_on_exits_with_1_and_keeps_its_frames(folder: Path) -> None:
    cooling = """
[model]
friction = 0.0
noise = 0.0
[collisions]
operator = "inelastic"
cross_section = 1.0
restitution = 0.5
[pipe]
length = 1.0
[run]
end_time = 50.0
output_every = 0.5
[grid]
nv = 64
velocity_window = [-6.0, 6.0]
"""
    (folder / "cooling.toml").write_text(cooling)
    result = cli("run", "cooling.toml", "-o", "out.nc", folder=folder)
    assert result.returncode == 1
    assert "no longer resolved; raise grid.nv" in result.stderr
    with xr.open_dataset(folder / "out.nc") as dataset:
        assert int(dataset["status"]) == 2
        assert "no longer resolved" in dataset.attrs["stopped"]
        assert dataset.sizes["time"] > 2
        temperature = dataset["temperature"].values[:, 0]
        assert (temperature[1:] < temperature[:-1]).all()


def test_quiet_and_verbose(command: Command, folder: Path) -> None:
    """Errors alone, or what the run will use and why, by every method."""
    done = command("run", "scene.toml", "-q", "--set", "grid.nx=9", "--set", "grid.nv=14", folder=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")  # although its error is above rtol, which is a warning else
    done = command("run", "scene.toml", "--quiet", folder=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: scene.nc: exists already")
    said = {
        "grid": "resolves the narrowest velocity distribution",
        "exact": "closed form  at 64 places",
        "particles": "in each of 2 replicas",
        "hydrodynamics": "the paper's closure (3)-(5)",
    }
    given = ("--set", "particles.count=100", "--set", "particles.replicas=2", "--set", "accuracy.rtol=1e-2")
    for method, text in said.items():
        done = command("run", "scene.toml", "-o", f"{method}.nc", "--method", method, "-v", *given, folder=folder)
        assert (done.returncode, text in done.stdout) == (0, True), done
    done = command("run", "scene.toml", "-q", "-v", folder=folder)
    assert (done.returncode, done.stderr) == (2, "error: --quiet, --verbose: both are given; allowed: one of them\n")
    done = command("run", "scene.toml", "-o", "new.nc", "-v", "--method", "other", folder=folder)
    assert (done.returncode, done.stdout, done.stderr[:25]) == (2, "", "error: method = 'other': ")


def test_what_the_groups_mean_is_in_line(make_scene: MakeScene) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 0.7}, pipe={"length": 10.0})
    groups = dict(describe(scene))["Dimensionless groups"]
    assert len({len(text.split()[0]) for _, text in groups}) > 1
    assert len({text.rindex("  ") for _, text in groups}) == 1
