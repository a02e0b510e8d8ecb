"""`kinetic-solver compare`: exit codes, one line for what is wrong, the dataset and the picture."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, exact, sweep
from kinetic_solver.dataset import open_run, write_dataset
from particles.simulation import simulate

Command = Callable[..., subprocess.CompletedProcess[str]]
SCENE = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.4}]},
    "run": {"end_time": 0.5},
    "grid": {"nx": 17, "nv": 48},
    "particles": {"count": 2000, "replicas": 8},
}
RIGHT, WRONG, RAW = "right.nc", "wrong.nc", "raw.nc"


def process(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "kinetic_solver", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """particles.nc; right.nc and wrong.nc, exact, of its scene and of twice the noise; raw.nc, particles alone."""
    path = tmp_path_factory.mktemp("runs")
    scene = Scene.model_validate(SCENE)
    write_dataset(simulate(scene), path / "particles.nc")
    write_dataset(exact.solve(scene), path / RIGHT)
    write_dataset(exact.solve(Scene.model_validate({**SCENE, "model": {**SCENE["model"], "noise": 1.0}})), path / WRONG)
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 9, (8, 1000))
    v = rng.normal(1.3 / 0.7, math.sqrt(0.5), x.shape)
    xr.Dataset({"x": (("replica", "n"), x), "v": (("replica", "n"), v)}).to_netcdf(path / RAW)
    (path / "text.nc").write_text("nonsense")
    return path


def test_no_difference_is_0(folder: Path) -> None:
    """As a process: the exit code is its own."""
    done = process("compare", "particles.nc", RIGHT, folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0].startswith("particles.nc: particles, 2000 particles in each of 8 replicas")
    assert lines[1].startswith("right.nc: exact, 17 × 48 points; systematic part at most closed form 1.0e-09")
    assert lines[3].split()[:4] == ["field", "time", "difference", "systematic"]
    assert lines[-1].startswith("no difference found: p = ")


def test_a_difference_is_4_and_is_written_and_drawn(command: Command, folder: Path, tmp_path: Path) -> None:
    """The dataset says what the table says, and is one of this solver's; an existing one is kept."""
    target = tmp_path / "out.nc"
    arguments = ("compare", "particles.nc", WRONG, "-o", str(target), "--figure", "--level", "0.001")
    done = command(*arguments, folder=folder)
    assert done.returncode == 4
    assert done.stderr == ""
    assert "they differ: p = " in done.stdout
    assert "the scenes differ: model.noise is 0.5 and 1.0" in done.stdout
    assert done.stdout.splitlines()[-2:] == [f"wrote {target}", f"wrote {target.with_suffix('.png')}"]
    with open_run(target) as found:
        assert found.attrs["method"] == "comparison"
        assert Scene.model_validate_json(found.attrs["scene"]).model.noise == 0.5
        assert found.attrs["differ"] == 1
        assert found.attrs["level"] == 0.001
        assert found.attrs["p"] < 0.001
        assert found.attrs["verdict"] in done.stdout
        assert found.attrs["first"].startswith("particles.nc: particles")
        assert found["temperature_difference"].dims == ("time", "x")
        assert float(found["temperature_difference"].mean("x")[-1]) < -0.1
        assert np.isfinite(found["temperature_z"].values).all()
    picture = matplotlib.image.imread(target.with_suffix(".png"))
    assert picture.shape[0] > 500
    assert picture.std() > 0.05

    again = command(*arguments, folder=folder)
    assert again.returncode == 2
    assert again.stderr == f"error: {target}: exists already; use --overwrite to replace it, or name another file with -o\n"
    assert command(*arguments, "--overwrite", folder=folder).returncode == 4


def test_the_picture_has_a_name_of_its_own(command: Command, folder: Path, tmp_path: Path) -> None:
    done = command("compare", str(folder / RIGHT), str(folder / RIGHT), "--figure", folder=tmp_path)
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == "wrote right-right.png"
    assert [path.name for path in tmp_path.iterdir()] == ["right-right.png"]


def test_a_time_for_particles_that_have_none(command: Command, folder: Path) -> None:
    """Independent particles without waves are not those of the scene at any time."""
    done = command("compare", RAW, RIGHT, "--time", "0", folder=folder)
    assert done.returncode == 4
    assert "raw.nc: particles that others made, 1000 particles in each of 8 replicas" in done.stdout
    assert {line.split()[1] for line in done.stdout.splitlines() if line.startswith(("density", "temperature"))} == {"0"}
    done = command("compare", RAW, RIGHT, folder=folder)
    assert "raw.nc has no time: taken as the other's last, t = 0.5; another time can be given" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((RIGHT, "none.nc"), "none.nc: there is no such file"),
        (("text.nc", RIGHT), "text.nc: is not a readable netCDF file"),
        ((RAW, RAW), "raw.nc, raw.nc: neither has a scene, so the period is not known; allowed: one run of this solver"),
        ((RIGHT, RIGHT, "--level", "1"), "--level 1: allowed: between 0 and 1"),
        ((RIGHT, RIGHT, "--level", "nan"), "--level nan: allowed: between 0 and 1"),
        ((RIGHT, RIGHT, "-o", "out.png"), "-o out.png: is for the dataset; allowed: a name that does not end in .png"),
        ((RAW, RIGHT, "--time", "0.3"), "nothing to compare: not compared: 3 times that one of them alone has"),
        ((RIGHT, RIGHT, "-o", "no/out.nc"), "no/out.nc: cannot be created"),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_what_is_wrong_is_said_in_one_line(command: Command, folder: Path, arguments: tuple[str, ...], message: str) -> None:
    done = command("compare", *arguments, folder=folder)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (folder / "out.png").exists()


def test_one_file_is_not_enough(folder: Path) -> None:
    done = process("compare", RIGHT, folder=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "Missing argument 'B.nc'" in done.stderr
    assert done.stderr.count("\n") == 1


def test_an_input_is_not_replaced(command: Command, folder: Path) -> None:
    before = (folder / RIGHT).read_bytes()
    done = command("compare", RIGHT, "particles.nc", "-o", RIGHT, "--overwrite", folder=folder)
    assert done.returncode == 2
    assert "is a file that this command reads; allowed: another name" in done.stderr
    assert (folder / RIGHT).read_bytes() == before


def test_a_sweep_is_refused(command: Command, folder: Path) -> None:
    sweep(exact_scene(), {"model.gravity": [0.5, 1.3]}, folder / "swept", method="exact")
    for names in ((RIGHT, "swept/sweep.nc"), ("swept/sweep.nc", RIGHT)):
        done = command("compare", *names, folder=folder)
        assert done.returncode == 2
        assert "swept/sweep.nc: is a sweep over model.gravity; allowed: the file of one run, as those" in done.stderr
        assert done.stderr.count("\n") == 1


def test_unknown_systematic_errors_are_said_in_words(command: Command, folder: Path) -> None:
    """As of particles that started from an f of somebody's own, of which the scene says nothing."""
    follow = {"operator": "follow-the-leader", "cross_section": 0.4}
    scene = Scene.model_validate({key: table for key, table in SCENE.items() if key != "initial"} | {"collisions": follow})
    run = simulate(scene, initial=lambda x, v: 0.8 * np.exp(-((v - 1.0) ** 2)) + 0 * x)
    write_dataset(run, folder / "own.nc", overwrite=True)
    said = command("compare", "own.nc", RIGHT, folder=folder).stdout.splitlines()
    own = [line for line in said if line.startswith("own.nc: ")]
    assert own[0].endswith("; its systematic errors are not known, and taken to be none")


def exact_scene() -> Scene:
    return Scene.model_validate({**SCENE, "grid": {"nx": 9, "nv": 24}})
