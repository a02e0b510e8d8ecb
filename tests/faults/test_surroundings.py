"""Terminals that cannot show what is said, readers that have had enough, names that are none, folders that are closed."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import pytest

from kinetic_solver import Scene, SceneError, exact, machine, run_to_file
from kinetic_solver.dataset import open_run, refuse_existing

MakeScene = Callable[..., Scene]
SCENE = """
[pipe]
length = 9.0
[collisions]
operator = "follow-the-leader"
cross_section = 0.9
[initial]
modes = [{ mode = 1, cos = 0.1 }]
[run]
end_time = 0.2
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def cli(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "kinetic_solver", *arguments]
    return subprocess.run(command, cwd=folder, env={**os.environ, **environment}, capture_output=True, timeout=120)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_what_a_terminal_cannot_show_is_replaced(folder: Path, encoding: str) -> None:
    done = cli("describe", "scene.toml", folder=folder, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"?" in done.stdout
    assert b"velocity window" in done.stdout


@pytest.mark.parametrize("lines", [0, 1])
def test_a_reader_that_has_had_enough(folder: Path, lines: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "kinetic_solver", "describe", "scene.toml"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    for _ in range(lines):
        process.stdout.readline()
    process.stdout.close()
    said = process.stderr.read()
    process.stderr.close()
    assert (process.wait(timeout=120), said) == (0, b"")


def test_nonsense_in_the_environment(folder: Path, make_scene: MakeScene) -> None:
    run_to_file(make_scene(run={"end_time": 0.2}), folder / "a.nc")
    done = cli("plot", "a.nc", folder=folder, MPLBACKEND="nonsense")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"wrote a.png\n", b"")


@pytest.mark.parametrize("method", ["grid", "exact", "particles"])
def test_a_name_that_is_not_utf_8(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    path = tmp_path / os.fsdecode(b"a\xff.nc")
    with pytest.raises(SceneError, match=r"a\?\.nc: is no name of a file to write; allowed: one in UTF-8$"):
        run_to_file(make_scene(), path, method)
    assert list(tmp_path.iterdir()) == []


def test_names_of_folders_and_names_without_an_ending(make_scene: MakeScene, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="is a folder; allowed: the name of a file"):
        refuse_existing(tmp_path, overwrite=True)
    run_to_file(make_scene(run={"end_time": 0.2}), tmp_path / "no ending")
    with open_run(tmp_path / "no ending") as found:
        assert found.sizes["time"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "scene.toml", "-o", "a.png"), "error: -o a.png: is for the dataset; allowed: a name that does not end in .png"),
        (("run", "scene.toml", "-o", "a.PDF"), "error: -o a.PDF: is for the dataset; allowed: a name that does not end in .pdf"),
        (("run", "scene.toml", "-o", "./scene.toml", "--overwrite"), "error: -o scene.toml: is a file that this command reads"),
        (("stability", "a.nc", "-o", "a.nc", "--overwrite"), "error: -o a.nc: is a file that this command reads"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_outputs_that_would_replace_what_is_read(command: Any, folder: Path, arguments: tuple[str, ...], message: str) -> None:
    (folder / "a.nc").write_bytes(b"mine")
    done = command(*arguments, folder=folder)
    assert done.returncode == 2
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
    assert (folder / "a.nc").read_bytes() == b"mine"


def test_damaged_scenes(command: Any, folder: Path, make_scene: MakeScene) -> None:
    """Wherever a run's file is read, in one line with its name."""
    run_to_file(make_scene(run={"end_time": 0.2}), folder / "a.nc")
    run_to_file(make_scene(run={"end_time": 0.2}), folder / "whole.nc")
    with netCDF4.Dataset(folder / "a.nc", "a") as out:
        out.scene = '{"pipe": {}}'
        out["status"][...] = 0
    for arguments in (
        ("plot", "a.nc"),
        ("stability", "a.nc"),
        ("compare", "a.nc", "whole.nc"),
        ("run", "scene.toml", "-o", "a.nc", "--resume"),
    ):
        done = command(*arguments, folder=folder)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert done.stderr.startswith("error: a.nc: its scene cannot be read (pipe.length: is missing"), arguments


def test_a_grid_that_no_machine_can_hold(make_scene: MakeScene) -> None:
    for method in (exact.solve, exact.points):
        with pytest.raises(
            SceneError, match=r"^grid: nx = 1000001, nv = 1000000 need .* GiB, this machine has .*; reduce nx or nv$"
        ):
            method(make_scene(grid={"nx": 1000001, "nv": 1000000}))


def test_compiled_code_that_cannot_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither beside the package nor in the user's cache: numba is given a folder for the time being, with one warning."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "given")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        machine.keep_compiled_code()
    assert os.environ["NUMBA_CACHE_DIR"] == "given"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    machine.keep_compiled_code()
    assert "NUMBA_CACHE_DIR" not in os.environ
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.warns(UserWarning, match=r"^compiled code cannot be kept: .*; set NUMBA_CACHE_DIR to a folder that can$"):
        machine.keep_compiled_code()
    assert Path(os.environ["NUMBA_CACHE_DIR"]).is_dir()
    machine.keep_compiled_code()  # once
    monkeypatch.delenv("NUMBA_CACHE_DIR")
