"""`run_to_file`: every method into a file, what is refused, what a run that fails or is interrupted leaves, and progress."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from kinetic_solver import (
    OutputExistsError,
    RunUnfinished,
    Scene,
    SceneError,
    SolverStopped,
    exact,
    hydrodynamics,
    run_to_file,
    solve,
)
from kinetic_solver import progress as progress_module
from kinetic_solver.cli import app
from kinetic_solver.dataset import VARIABLES, MemoryRecorder, open_netcdf, open_run, recording, refuse_existing, scene_of
from kinetic_solver.methods import METHODS, Interruption
from kinetic_solver.progress import telling
from kinetic_solver.scene import Schedule
from particles import simulate

MakeScene = Callable[..., Scene]
SMALL: dict[str, Any] = {
    "run": {"end_time": 1.5, "output_every": 0.5},
    "grid": {"nx": 9, "nv": 32},
    "particles": {"count": 200, "replicas": 2},
    "accuracy": {"rtol": 1e-2},
}
IN_MEMORY: dict[str, Callable[[Scene], xr.Dataset]] = {
    "grid": solve,
    "exact": exact.solve,
    "hydrodynamics": hydrodynamics.solve,
    "particles": simulate,
}
OF_V = {"v", "v_bounds"}
"""A file of the hydrodynamics, which have no velocities, keeps one; the Dataset in memory has none."""
EVERY_METHOD = pytest.mark.parametrize("method", METHODS)


def test_every_method_is_tested() -> None:
    assert IN_MEMORY.keys() == METHODS.keys()


@EVERY_METHOD
def test_a_file_holds_what_the_method_returns(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    scene = make_scene(**SMALL)
    told: list[tuple[float, float]] = []
    done = run_to_file(scene, tmp_path / "a.nc", method, progress=lambda time, end: told.append((time, end)))
    assert done.path == tmp_path / "a.nc"
    assert told[-1] == (1.5, 1.5)
    if method != "hydrodynamics":  # whose frames come once they are refined
        assert told == [(0.5, 1.5), (1.0, 1.5), (1.5, 1.5)]
    expected = IN_MEMORY[method](scene)
    with open_run(done.path) as found:
        assert found.attrs["method"] == method
        assert scene_of(found) == scene
        assert set(found.variables) - OF_V == set(expected.variables) - OF_V
        for name in expected.variables:
            assert np.array_equal(found[name].values, expected[name].values, equal_nan=True), name
            assert found[name].dims == expected[name].dims
        assert int(found["status"]) == 1


def test_what_is_said_of_a_run(make_scene: MakeScene, tmp_path: Path) -> None:
    said = {method: run_to_file(make_scene(**SMALL), tmp_path / f"{method}.nc", method).lines for method in METHODS}
    assert said["grid"][0].startswith("estimated error ")
    assert said["exact"] == ()
    assert said["particles"][0].startswith("400 particles, ")


@pytest.mark.parametrize("method", [name for name in METHODS if name != "particles"])
def test_a_run_of_which_nothing_is_wanted_comes_to_its_end(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """Stopped and resumed, too: its file has no frames, and says that it has finished. (The particles refuse it.)"""
    scene = make_scene(**SMALL, output=dict.fromkeys(("f", "moments", "scalars", "budgets"), False))
    with pytest.raises(RunUnfinished):
        run_to_file(scene, tmp_path / "a.nc", method, max_walltime=0)
    run_to_file(scene, tmp_path / "a.nc", method, resume=True)
    with open_run(tmp_path / "a.nc") as found:
        assert int(found["status"]) == 1
        assert "time" not in found.sizes


# -- refusals: SceneErrors of one line, which leave what is there


@EVERY_METHOD
def test_an_existing_file_is_kept_unless_it_may_be_replaced(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(b"mine")
    with pytest.raises(OutputExistsError, match=r"a\.nc: exists already; allowed: another name, or to overwrite it$") as caught:
        run_to_file(make_scene(**SMALL), path, method)
    assert caught.value.path == path
    assert path.read_bytes() == b"mine"
    run_to_file(make_scene(**SMALL), path, method, overwrite=True)
    with open_run(path) as found:
        assert found.sizes["time"] == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "guess"}, "method = 'guess': unknown; allowed: 'grid', 'exact', 'hydrodynamics', 'particles'"),
        ({"method": "particles", "max_walltime": -2.5}, "max_walltime = -2.5: allowed: 0 or more seconds"),
        ({"method": "particles", "max_walltime": float("nan")}, "max_walltime = nan: allowed: 0 or more seconds"),
        ({"method": "particles", "resume": True, "overwrite": True}, "resume, overwrite: both are given"),
    ],
)
def test_wrong_arguments(make_scene: MakeScene, tmp_path: Path, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        run_to_file(make_scene(**SMALL), tmp_path / "a.nc", **arguments)
    text = str(caught.value)
    assert text.startswith(message)
    assert "\n" not in text
    assert "--" not in text
    assert list(tmp_path.iterdir()) == []


@EVERY_METHOD
def test_the_file_that_a_run_starts_from_is_not_written(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    path = tmp_path / "start.nc"
    path.write_bytes(b"mine")
    scene = make_scene(**{**SMALL, "initial": {"file": str(path), "density": 1.0, "modes": []}})
    with pytest.raises(SceneError, match="is the file that the run starts from; allowed: another name"):
        run_to_file(scene, tmp_path / "." / "start.nc", method, overwrite=True)
    assert path.read_bytes() == b"mine"


@EVERY_METHOD
def test_a_folder_that_does_not_exist(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    with pytest.raises(SceneError, match="cannot be created"):
        run_to_file(make_scene(**SMALL), tmp_path / "none" / "a.nc", method)


def test_the_command_line_says_which_flags(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments in (["init"], ["init"]):
        done = CliRunner().invoke(app, arguments)
    assert (done.exit_code, done.stderr) == (
        2,
        "error: scene.toml: exists already; use --overwrite to replace it, or give another name\n",
    )
    Path("scene.nc").write_bytes(b"mine")
    done = CliRunner().invoke(app, ["run", "scene.toml"])
    assert (done.exit_code, done.stderr) == (
        2,
        "error: scene.nc: exists already; use --overwrite to replace it, or name another file with -o\n",
    )
    for command in (["stability", "--figure"], ["stability", "scene.toml"], ["figure", "2"], ["compare", "a.nc", "b.nc"]):
        done = CliRunner().invoke(app, [*command, "-o", "a.png"])
        assert done.exit_code == 2
        assert done.stderr.startswith("error: -o a.png: is for the dataset; allowed: a name that does not end in .png")


# -- runs that do not come to their end


@pytest.mark.parametrize("method", ["grid", "exact", "particles"])  # frames of the hydrodynamics come at the end
@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (KeyboardInterrupt(), "interrupted by KeyboardInterrupt"),
        (OSError("disk full"), "interrupted by OSError disk full"),
        (SolverStopped("t = 1: all is NaN; lower it"), "t = 1: all is NaN; lower it"),
    ],
)
def test_the_file_says_why_a_run_stopped(
    make_scene: MakeScene, tmp_path: Path, method: str, error: BaseException, reason: str
) -> None:
    def stop(time: float, end: float) -> None:
        if time > 0.7:
            raise error

    with pytest.raises(type(error)):
        run_to_file(make_scene(**SMALL), tmp_path / "a.nc", method, progress=stop)
    with open_run(tmp_path / "a.nc") as left:
        assert int(left["status"]) == 2
        assert left.attrs["stopped"] == reason
        assert np.isfinite(left["f"].values).all()
        assert left["time"].values[-1] < 1.5


def test_particles_that_cannot_go_on_keep_their_frames(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    from particles import simulation

    advance = simulation.Simulation.advance_to

    def fails(self: simulation.Simulation, time: float, after_step: simulation.AfterStep) -> None:
        if time > 0.7:
            raise SolverStopped("lost")
        advance(self, time, after_step)

    monkeypatch.setattr(simulation.Simulation, "advance_to", fails)
    with pytest.raises(SolverStopped) as caught:
        simulate(make_scene(**SMALL))
    assert caught.value.dataset["time"].values.tolist() == [0, 0.5]
    assert caught.value.dataset.attrs["stopped"] == "lost"


@pytest.mark.parametrize("method", METHODS)
def test_a_run_that_is_stopped_early_is_resumed(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    scene, path = make_scene(**SMALL), tmp_path / "a.nc"
    with pytest.raises(RunUnfinished, match="stopped at t = 0 after 0 s; resume it to go on"):
        run_to_file(scene, path, method, max_walltime=0)
    with open_run(path) as left:
        assert left.attrs["stopped"] == "stopped at t = 0 after 0 s; resume it to go on"
    run_to_file(scene, path, method, resume=True)
    assert run_to_file(scene, path, method, resume=True).lines == ("it has finished already",)
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]
    expected = IN_MEMORY[method](scene)
    with open_run(path) as found:
        for name in expected.variables:
            assert np.array_equal(found[name].values, expected[name].values, equal_nan=True), name


@EVERY_METHOD
def test_a_resumed_run_without_a_checkpoint_says_so(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    answers: list[str] = []
    asked = Interruption(answer=answers.append)
    for _ in range(2):
        run_to_file(make_scene(**SMALL), tmp_path / "a.nc", method, resume=True, interruption=asked)
    assert answers == [f"{tmp_path / 'a.nc'}: there is no checkpoint to go on from; the run starts at t = 0"]


def test_recording_closes_with_the_reason(make_scene: MakeScene) -> None:
    scene = make_scene(**SMALL)
    recorder = MemoryRecorder(exact.points(scene), scene, Schedule.of(scene, VARIABLES), "exact")
    with pytest.raises(ZeroDivisionError), recording(recorder):
        raise ZeroDivisionError("by zero")
    found = recorder.dataset()
    assert found.attrs["stopped"] == "interrupted by ZeroDivisionError by zero"
    assert int(found["status"]) == 2


# -- progress


def test_progress_in_lines(
    make_scene: MakeScene, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([100.0, 103.0, 112.0, 112.5])  # at the start, and at three frames
    monkeypatch.setattr(progress_module, "monotonic", lambda: next(clock))
    run_to_file(make_scene(**SMALL), tmp_path / "a.nc", "exact", progress=True)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == ["t = 1 of 1.5, 6 s left", "t = 1.5 of 1.5, 0 s left"]
    run_to_file(make_scene(**SMALL), tmp_path / "b.nc", "exact")
    assert capsys.readouterr() == ("", "")


def test_progress_before_anything_is_done(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Something is said of a run that is long in coming; nothing of one that is refused at once."""
    said = threading.Event()
    monkeypatch.setattr(progress_module, "SECONDS_IN_SILENCE", 0.0)
    monkeypatch.setattr(progress_module.log, "info", lambda *text: said.set())
    with telling(True):
        assert said.wait(60)
    monkeypatch.undo()
    with pytest.raises(SceneError), telling(True):
        raise SceneError("no")
    assert capsys.readouterr() == ("", "")


def test_progress_of_what_is_kept_in_memory(
    make_scene: MakeScene, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Lines on stderr; where logging is set up at INFO, in the log and nowhere else; a callable is called."""
    scene = make_scene(**SMALL)
    for run in (solve, hydrodynamics.solve, simulate, exact.solve):
        run(scene, progress=True)
        assert capsys.readouterr().err.splitlines()[-1].startswith("t = 1.5 of 1.5")
    with caplog.at_level(logging.INFO, "kinetic_solver"):
        solve(scene, progress=True)
    assert capsys.readouterr().err == ""
    assert caplog.records[-1].name == "kinetic_solver.progress"
    assert caplog.records[-1].getMessage() == "t = 1.5 of 1.5, 0 s left"
    told: list[float] = []
    solve(scene, progress=lambda time, end: told.append(time))
    assert told == [0.5, 1.0, 1.5]


def test_a_bar_before_the_first_step(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar, which is there before the first step."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with telling(True) as bar:
        assert bar is not None
        bar(0.3, 1.5)
        bar(1.5, 1.5)
    said = capsys.readouterr().err
    assert "starting" in said
    assert "t = 1.5" in said
    assert "100 %" in said


def test_progress_of_a_run_that_goes_back(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """To be refined: what is left is reckoned from there on."""
    clock = iter([100.0, 115.0, 116.0, 126.0, 127.0])
    monkeypatch.setattr(progress_module, "monotonic", lambda: next(clock))
    with telling(True) as line:
        assert line is not None
        for time in (0.9, 0.1, 0.6, 2.1):
            line(time, 2.1)
    assert capsys.readouterr().err.splitlines() == [
        "t = 0.9 of 2.1, 20 s left",
        "t = 0.6 of 2.1 again, 30 s left",
        "t = 2.1 of 2.1 again, 0 s left",
    ]


def test_the_closure_tells_its_end_once(make_scene: MakeScene, tmp_path: Path) -> None:
    told: list[float] = []
    scene = make_scene(**{**SMALL, "grid": {}, "accuracy": {"rtol": 1e-6}})
    run_to_file(scene, tmp_path / "a.nc", "hydrodynamics", progress=lambda time, end: told.append(time))
    passes = int((np.diff(told) < 0).sum()) + 1
    assert passes > 1
    assert told.count(1.5) == 1
    assert told[-1] == 1.5


def test_progress_on_a_terminal(
    make_scene: MakeScene, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    run_to_file(make_scene(**SMALL), tmp_path / "a.nc", "exact", progress=True)
    said = capsys.readouterr()
    assert "t = 1.5" in said.err
    assert "100 %" in said.err


# -- what files and scenes of datasets are read by


def test_scenes_of_datasets(make_scene: MakeScene, tmp_path: Path) -> None:
    scene = make_scene(**SMALL)
    dataset = exact.solve(scene)
    assert scene_of(dataset) == scene
    with pytest.raises(SceneError, match=r"^old\.nc: was not written by kinetic-solver"):
        scene_of(xr.Dataset(), "old.nc")
    with pytest.raises(SceneError, match=r"^old\.nc: its scene cannot be read \(.*pipe: is missing"):
        scene_of(dataset.assign_attrs(scene='{"run": {"end_time": 1.0}}'), "old.nc")
    with pytest.raises(SceneError, match=r"^dataset: its scene cannot be read"):
        scene_of(dataset.assign_attrs(scene="{"))
    (tmp_path / "text.nc").write_text("nonsense")
    for name, problem in (("text.nc", "is not a readable netCDF file"), ("none.nc", "there is no such file")):
        with pytest.raises(SceneError, match=rf"^start: {problem}$"):
            open_netcdf(tmp_path / name, "start")
    refuse_existing(tmp_path / "none.nc")
    refuse_existing(tmp_path / "text.nc", overwrite=True)
