"""Runs that are killed (SIGKILL, or a signal as sudden), and what is lost: nothing that was synced, and never the file.

    python -m benchmarks.kills [--count N] [--folder DIR] [--method NAME]

Every trial kills a run once or more: at random moments, or within a place drawn at random (at the start, in a step, a frame's
write, a checkpoint, a rename, when the file is closed, when it is opened again). After every kill the file must be readable, by
xarray and by `info`, and hold every frame that was synced before, bit for bit that of a run that was never stopped; the run is
resumed, and at the end the whole file must have that run's bits. What each trial found is kept in DIR, and a second call with a
larger N goes on from there. Trials are numbered, and each draws its own random numbers from its number.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import xarray as xr

from kinetic_solver.analysis.info import summary
from kinetic_solver.dataset import Checkpoint, NetCDFRecorder, open_run
from kinetic_solver.hydrodynamics import FrameStore
from kinetic_solver.methods import run_to_file
from kinetic_solver.methods.interruption import Keeper
from kinetic_solver.scene import Scene

SCENE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "collisions": {"operator": "follow-the-leader", "cross_section": 0.9},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
    "run": {"end_time": 2.0, "output_every": 0.1},
    "output": {"f": 0.3},
    "accuracy": {"rtol": 1e-3},
    "particles": {"count": 1000, "replicas": 2, "seed": 3},
}
SCENES: dict[str, dict[str, Any]] = {
    "exact": SCENE,
    # On a grid that shrinks, with steps between judgements
    "grid": {
        **SCENE,
        "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6},
        "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.1}], "mean_velocity": -0.4, "temperature": 8.0},
        "grid": {"nx": 9},
    },
    "particles": SCENE,
    # Three passes
    "hydrodynamics": {**SCENE, "accuracy": {"rtol": 1e-7}},
    "hierarchy": {**SCENE, "hydrodynamics": {"moments": 40}, "accuracy": {"rtol": 1e-10}},
}
"""By method; the Hermite hierarchy of method hydrodynamics stands beside its closure."""
PLACES: dict[str, tuple[type, str]] = {
    "a step": (Keeper, "look"),
    "a write": (NetCDFRecorder, "sync"),
    "keeping a frame": (FrameStore, "append"),
    "a checkpoint": (Checkpoint, "save"),
    "a rename": (Path, "replace"),
    "closing": (NetCDFRecorder, "close"),
    "opening again": (NetCDFRecorder, "_reopen"),
    "the end": (Keeper, "finish"),
}
"""Where a run is killed, if it comes there: at a random moment of a random call, or shortly after."""
RANDOM = "a random moment"
MOST_KILLS = 3
"""Of one trial."""


class Reference:
    """A run that was never stopped: its file, how long it took, and how often and how long it was in each place."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.path = name, folder / f"{name}.nc"
        code, said = in_a_child(lambda tell: self._measure(tell))
        assert code == 0, said
        self.seconds, self.calls = json.loads(said)
        with xr.open_dataset(self.path) as run:
            self.data = run.load()

    def _measure(self, tell: Callable[[str], None]) -> None:
        calls: dict[str, list[float]] = {place: [] for place in PLACES}
        for place, (owner, name) in PLACES.items():
            setattr(owner, name, _timed(getattr(owner, name), calls[place]))
        began = time.monotonic()
        run_to_file(scene_of(self.name), self.path, method_of(self.name), overwrite=True)
        tell(json.dumps([time.monotonic() - began, calls]))


def _timed(function: Callable[..., Any], durations: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any, **options: Any) -> Any:
        began = time.monotonic()
        try:
            return function(*arguments, **options)
        finally:
            durations.append(time.monotonic() - began)

    return timed


def scene_of(name: str) -> Scene:
    return Scene.model_validate(SCENES[name])


def method_of(name: str) -> str:
    return "hydrodynamics" if name == "hierarchy" else name


def in_a_child(work: Callable[[Callable[[str], None]], None], delay: float | None = None) -> tuple[int, str]:
    """(how it ended, as by os.waitstatus_to_exitcode; what it told). Killed after `delay` seconds.

    Forked, since a new interpreter takes seconds; nothing here has started a thread."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(reading)
            numba.set_num_threads(1)  # two would wait for each other where the machine is busy
            work(lambda text: os.write(writing, text.encode()) and None)
            code = 0
        except BaseException:
            os.write(writing, traceback.format_exc().encode())
        finally:
            os._exit(code)
    os.close(writing)
    if delay is not None:
        time.sleep(delay)
        os.kill(pid, signal.SIGKILL)
    told = b""
    while part := os.read(reading, 65536):
        told += part
    os.close(reading)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), told.decode()


def run(name: str, path: Path, place: str, call: int, after: float, tell: Callable[[str], None]) -> None:
    """Go on, say "." after each frame that was synced, and be killed so many seconds into this call of the place."""
    if place in PLACES:
        owner, attribute = PLACES[place]
        function, count = getattr(owner, attribute), [0]

        def trapped(*arguments: Any, **options: Any) -> Any:
            count[0] += 1
            if count[0] == call:
                signal.setitimer(signal.ITIMER_REAL, max(after, 1e-6))  # SIGALRM, which nobody handles, is as sudden as SIGKILL
            return function(*arguments, **options)

        setattr(owner, attribute, trapped)
    sync = NetCDFRecorder.sync

    def told(recorder: NetCDFRecorder) -> None:
        before = recorder._count["time"]
        sync(recorder)
        tell("." * (recorder._count["time"] - before))

    NetCDFRecorder.sync = told  # type: ignore[method-assign]
    run_to_file(scene_of(name), path, method_of(name), resume=True)


def whole_frames(path: Path, reference: Reference) -> int:
    """How many frames of the file are whole. Raises AssertionError where one has other bits than the reference's."""
    with open_run(path) as found:
        assert summary(found)
        data = found.load()
    expected = reference.data
    count = data.sizes["time"]
    for name, variable in data.variables.items():
        wanted = expected[name].values
        if variable.dims[:1] == ("time",):
            whole = [np.array_equal(variable.values[n], wanted[n], equal_nan=True) for n in range(count)]
            # The last may be in the making: its time is then not there yet.
            assert all(whole), f"{name}: frame {whole.index(False)} of {count} is broken"
        elif variable.dims[:1] == ("time_f",) and name != "time_f":
            for time_f, values, want in zip(expected["time_f"].values, variable.values, wanted, strict=True):
                if count and time_f <= expected["time"].values[count - 1]:
                    assert np.array_equal(values, want), f"{name}: the frame at t = {time_f:g} is broken"
        elif name != "status":
            assert np.array_equal(variable.values, wanted), name
    assert int(data["status"]) in (0, 1, 2)
    return count


def trial(number: int, reference: Reference, folder: Path) -> dict[str, Any]:
    """What the trial of this number found. Two of three are at random moments, the third in a place."""
    drawn = random.Random(f"{reference.name} {number}")
    path = folder / f"{reference.name}-{number}.nc"
    kills: list[str] = []
    synced = 0
    for _ in range(drawn.randint(1, MOST_KILLS)):
        place = RANDOM if number % 3 else drawn.choice(list(PLACES))
        before, delay, call, after = synced, None, 0, 0.0
        if place == RANDOM:
            delay = drawn.uniform(0, reference.seconds)
        else:
            calls = reference.calls[place] or [0.005]
            call, after = drawn.randint(1, 1 + len(calls) // MOST_KILLS), drawn.uniform(0, 1.5 * max(calls))
        code, told = in_a_child(lambda tell, p=place, c=call, a=after: run(reference.name, path, p, c, a, tell), delay)  # type: ignore[misc]
        assert code in (0, -signal.SIGKILL, -signal.SIGALRM), told
        if code:
            kills.append(place)
        if path.exists():
            synced = whole_frames(path, reference)
        assert synced >= max(before, told.count(".")), f"{synced} frames, {before} and then {told.count('.')} were synced"
    code, told = in_a_child(lambda tell: run(reference.name, path, "", 0, 0.0, tell))
    assert code == 0, told
    assert whole_frames(path, reference) == reference.data.sizes["time"]
    left = sorted(other.name for other in folder.glob(f"{path.name}*"))
    assert left == [path.name], left
    path.unlink()
    return {"kills": kills}


def trials(name: str, count: int, folder: Path) -> list[dict[str, Any]]:
    """Those that were done before, and the others up to `count`."""
    log = folder / f"{name}.jsonl"
    known = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    if len(known) >= count:
        return known
    reference = Reference(name, folder)
    for number in range(len(known), count):
        try:
            found = trial(number, reference, folder)
        except Exception as error:
            found = {"kills": [], "failed": f"{type(error).__name__}: {error}"}
        known.append({"number": number, **found})
        with log.open("a") as out:
            out.write(json.dumps(known[-1]) + "\n")
    return known


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=150, help="trials of each method")
    parser.add_argument("--folder", type=Path, help="where what was found is kept; default: a temporary one")
    parser.add_argument("--method", choices=SCENES, action="append", help="default: all")
    given = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in given.method or SCENES:
            found = trials(name, given.count, folder)
            counts = collections.Counter(place for one in found for place in one["kills"])
            bad = [one for one in found if "failed" in one]
            failed += len(bad)
            print(f"{name:<13} {len(found)} trials, {counts.total()} kills, {len(bad)} failed", flush=True)
            for place, n in sorted(counts.items()):
                print(f"           {n:4d} in {place}")
            for one in bad:
                print(f"           trial {one['number']}: {one['failed']}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
