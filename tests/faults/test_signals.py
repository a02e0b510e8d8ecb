"""Signals and the clock stop a run with a checkpoint, in one line and with the right exit code."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from kinetic_solver import RunUnfinished, Scene, compiling, run_to_file
from kinetic_solver.cli.signals import listening
from kinetic_solver.dataset import open_run
from kinetic_solver.methods import METHODS, Interruption

SMALL: dict[str, Any] = {
    "run": {"end_time": 1.5, "output_every": 0.5},
    "grid": {"nx": 9, "nv": 32},
    "particles": {"count": 200, "replicas": 2},
    "accuracy": {"rtol": 1e-2},
}
SCENE = """
[collisions]
operator = "inelastic"
cross_section = 0.9
restitution = 0.6
[pipe]
length = 9.0
[initial]
modes = [{ mode = 1, cos = 0.4 }]
[run]
end_time = 1.0e4
output_every = 0.01
[output]
budgets = false
f = 1.0e4
[grid]
nx = 9
nv = 32
[particles]
count = 500
[accuracy]
rtol = 1e-2
"""
"""Without an end: every run is stopped."""
SECONDS = 120


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """Tests that were started in the background of a shell ignore SIGINT, and so would the runs that they start."""
    ignored = [n for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU) if signal.getsignal(n) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """(exit code, what was said), lines of progress left out."""
    _, said = process.communicate(timeout=SECONDS)
    return process.returncode, "\n".join(line for line in said.splitlines() if not of_progress(line))


def of_progress(line: str) -> bool:
    return " s left" in line or line.strip() in ("starting", compiling.LINE)


@pytest.mark.parametrize(
    ("method", "name", "code"),
    [("grid", "SIGTERM", 3), ("grid", "SIGINT", 130), ("hydrodynamics", "SIGHUP", 3), ("hydrodynamics", "SIGINT", 130)],
)
def test_a_signal_stops_a_run(tmp_path: Path, method: str, name: str, code: int) -> None:
    """After SIGUSR1, at which it wrote a checkpoint, said so, and went on."""
    (tmp_path / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "kinetic_solver", "run", "scene.toml", "-o", "out.nc", "--method", method]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            late = time.monotonic() + SECONDS
            while not (tmp_path / "out.nc.checkpoint").exists() and process.poll() is None and time.monotonic() < late:
                time.sleep(0.02)
            os.kill(process.pid, signal.SIGUSR1)
            said = next(line for line in process.stderr if not of_progress(line))
            assert said.startswith("checkpoint written at t = ")
            assert process.poll() is None
            os.kill(process.pid, getattr(signal, name))
            found, said = end(process)
        finally:
            process.kill()
    assert (found, said.count("\n")) == (code, 0), said
    assert said.startswith("stopped at t = ")
    assert said.endswith(f" by {name}; resume it to go on (--resume)")
    with xr.open_dataset(tmp_path / "out.nc") as run:
        assert int(run["status"]) == 2
        assert run.attrs["stopped"] == said.removesuffix(" (--resume)")
        assert run.sizes["time"] > 0
    assert not (tmp_path / "out.nc.lock").exists()


def test_a_signal_before_the_first_step(tmp_path: Path) -> None:
    """There is nothing to keep yet: the run stops at once, and leaves nothing."""
    (tmp_path / "scene.toml").write_text(SCENE)
    code = (
        "import os, signal, sys\n"
        "import kinetic_solver.methods.to_file as to_file\n"
        "to_file.METHODS['grid'] = to_file.Method(lambda job: os.kill(os.getpid(), signal.SIGTERM))\n"
        "sys.argv = ['kinetic-solver', 'run', 'scene.toml', '-o', 'out.nc']\n"
        "from kinetic_solver.cli import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 3
    assert done.stderr == "stopped by SIGTERM at once, without a new checkpoint; run it again\n"
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU"])
def test_what_a_signal_asks_of_a_run(name: str) -> None:
    asked, number = Interruption(heeded=True), getattr(signal, name)
    before = signal.getsignal(number)
    with listening(asked):
        os.kill(os.getpid(), signal.SIGUSR1)
        assert (asked.keep, asked.stop) == (True, None)
        os.kill(os.getpid(), number)
        assert asked.stop == name
        if name == "SIGINT":
            with pytest.raises(RunUnfinished, match="stopped by SIGINT at once, without a new checkpoint"):
                os.kill(os.getpid(), number)
        else:
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) == before


def test_what_is_ignored_stays_ignored() -> None:
    """As nohup has it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        asked = Interruption(heeded=True)
        with listening(asked):
            os.kill(os.getpid(), signal.SIGHUP)
        assert asked.stop is None
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_is_asked_from_outside(make_scene: Callable[..., Scene], tmp_path: Path, method: str) -> None:
    """For a checkpoint, and to stop: from wherever its progress is watched, here."""
    answers: list[str] = []
    asked = Interruption(keep=True, answer=answers.append)
    scene = make_scene(**SMALL)

    def ask(time: float, end: float) -> None:
        if time >= 0.5:
            asked.stop = "a friend"

    with pytest.raises(RunUnfinished, match=r"stopped at t = \S+ by a friend; resume it to go on") as caught:
        run_to_file(scene, tmp_path / "a.nc", method, progress=ask, interruption=asked)
    assert caught.value.by == "a friend"
    assert answers == ["checkpoint written at t = 0"]
    run_to_file(scene, tmp_path / "a.nc", method, resume=True)
    run_to_file(scene, tmp_path / "b.nc", method)
    with open_run(tmp_path / "a.nc") as found, open_run(tmp_path / "b.nc") as expected:
        assert found.drop_attrs().identical(expected.drop_attrs())


@pytest.mark.parametrize("method", ["grid", "particles", "hydrodynamics", "hierarchy"])
def test_the_clock_stops_a_run_within_an_interval(make_scene: Callable[..., Scene], tmp_path: Path, method: str) -> None:
    """One interval between two frames: only a look after every step can stop it."""
    changes = {"collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}, "run": {"end_time": 1.5}}
    if method == "hierarchy":
        method, changes = (
            "hydrodynamics",
            {"hydrodynamics": {"moments": 6}, "run": {"end_time": 1.5}, "grid": {"nx": 9, "time_step": 0.2}},
        )
    scene, path = make_scene(**{**SMALL, **changes}), tmp_path / "a.nc"
    for resume in (False, True, True):
        with pytest.raises(RunUnfinished, match=r"stopped at t = .* after 0 s") as caught:
            run_to_file(scene, path, method, max_walltime=0, resume=resume)
    with open_run(path) as left:
        assert left["time"].values.tolist() == [0]
    assert 0 < float(str(caught.value).split("t = ")[1].split(" ")[0]) < 1.5
    run_to_file(scene, path, method, resume=True)
    run_to_file(scene, tmp_path / "b.nc", method)
    with open_run(path) as found, open_run(tmp_path / "b.nc") as expected:
        assert found.drop_attrs().identical(expected.drop_attrs())
