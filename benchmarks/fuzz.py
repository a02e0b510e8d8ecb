"""Thousands of scenes and commands that are nearly right: each runs to its end, or is refused in one line with exit code 2.

    python -m benchmarks.fuzz [--count N] [--commands M] [--first K]

N cases (benchmarks/fuzz_cases.py) in this process, M of them as commands of their own as well, whose answers must be the same.
Each must: end within `LONGEST` seconds; have an exit code that the command line knows; print no traceback and no warning of
NumPy's; say what is wrong in one line that begins with "error:" and is no longer than `LONGEST_LINE`; and leave no file where it
was refused. Only a run may fail (exit code 1) in what it does.
Prints what did not, and the counts; fails where anything did not.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import argparse
import collections
import contextlib
import io
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz_cases import BASE, Case, case
from kinetic_solver.scene import Scene

LONGEST = 60
"""Seconds: a hang, where nothing is heard. Chosen; the longest case takes a few."""
LONGEST_LINE = 1000
"""Characters of an error: one that repeats what it was given at length hides what is wrong."""
CODES = (0, 1, 2, 3, 4, -1)


@dataclass(frozen=True)
class Answer:
    """What a command said and left."""

    code: int
    out: str
    err: str
    files: frozenset[str]
    seconds: float = 0.0


class _Hangs(BaseException):
    """Longer than `LONGEST`; no Exception, so that nothing catches it on the way."""


def prepare(folder: Path) -> None:
    """The files that cases name: a run, particles in netCDF and in CSV, and what is no run."""
    from kinetic_solver import run_to_file
    from particles import simulate

    scene = Scene.model_validate(BASE)
    run_to_file(scene, folder / "state.nc")
    simulate(Scene.model_validate({**BASE, "output": {"particles": True}})).to_netcdf(folder / "particles.nc")
    draw = np.random.default_rng(2)
    rows = np.stack([draw.uniform(0, 9, 200), draw.normal(1.8, 0.7, 200)], axis=1)
    np.savetxt(folder / "particles.csv", rows, delimiter=",", header="x,v", comments="")
    (folder / "bad.nc").write_bytes(b"CDF\x05" + bytes(range(200)))
    (folder / "empty.nc").write_bytes(b"")
    import xarray as xr

    xr.Dataset({"temperature": ("place", [1.0, 2.0])}).to_netcdf(folder / "other.nc")


@contextlib.contextmanager
def place(files: Path, given: Case) -> Iterator[Path]:
    """A folder with these files and the case's scene, gone afterwards."""
    with tempfile.TemporaryDirectory() as name:
        for path in files.iterdir():
            shutil.copy(path, name)
        (Path(name) / "scene.toml").write_bytes(given.scene)
        yield Path(name)


def here(given: Case, folder: Path) -> Answer:
    """The case in this process, by the entry point of the command line."""
    from kinetic_solver.cli import main

    def late(*_: Any) -> None:
        raise _Hangs

    before = {path.name for path in folder.iterdir()}
    out, err = io.StringIO(), io.StringIO()
    old_folder, old_arguments, old_handler = Path.cwd(), sys.argv, signal.signal(signal.SIGALRM, late)
    began = time.perf_counter()
    os.chdir(folder)
    sys.argv = ["kinetic-solver", *given.arguments]
    signal.alarm(LONGEST)
    code = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("default")
            main()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
    except _Hangs:
        err.write("hangs")
        code = -1
    except BaseException:
        err.write(traceback.format_exc())
        code = -2
    finally:
        signal.alarm(0)
        os.chdir(old_folder)
        sys.argv = old_arguments
        signal.signal(signal.SIGALRM, old_handler)
    left = frozenset({path.name for path in folder.iterdir()} - before)
    return Answer(code, out.getvalue(), err.getvalue(), left, time.perf_counter() - began)


def as_command(given: Case, folder: Path) -> Answer:
    """The same in a process of its own."""
    before = {path.name for path in folder.iterdir()}
    command = [sys.executable, "-m", "kinetic_solver", *given.arguments]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, timeout=2 * LONGEST, text=True, errors="replace")
        code, out, err = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        code, out, err = -1, "", "hangs"
    return Answer(code, out, err, frozenset({path.name for path in folder.iterdir()} - before))


def wrong(answer: Answer, command: str) -> str | None:
    """What an answer to a command should not be, in words; None where it is as it should."""
    if answer.code == -1:  # a long run of method hydrodynamics, which takes no limit, says how far it is
        return None if "t = " in answer.err else "hangs"
    if answer.code not in CODES or "Traceback" in answer.err:
        return "a traceback" if "Traceback" in answer.err else f"exit code {answer.code}"
    if "encountered" in answer.err:
        return "a warning of NumPy's"
    said = [line for line in answer.err.splitlines() if not line.startswith(("warning: ", "t = "))]
    if any(len(line) > LONGEST_LINE for line in answer.err.splitlines()):
        return "a line that is too long"
    if answer.code in (1, 2) and not any("Usage:" in line for line in said):
        if len(said) != 1 or not said[0].startswith("error: "):
            return "no error in one line"
        if not said[0].removeprefix("error: ").strip():
            return "an error without a word"
    if answer.code == 1 and command != "run":
        return "fails"
    if answer.code == 2 and answer.files:
        return f"left {', '.join(sorted(answer.files))}"
    if any(name.endswith((".part", ".lock")) for name in answer.files):
        return f"left {', '.join(sorted(answer.files))}"
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description="Scenes and commands that are nearly right.")
    parser.add_argument("--count", type=int, default=10_000, help="cases in this process")
    parser.add_argument("--commands", type=int, default=200, help="of them as commands as well")
    parser.add_argument("--first", type=int, default=0, help="the first case's number")
    asked = parser.parse_args()
    codes: collections.Counter[str] = collections.Counter()
    failed, longest = 0, 0.0
    with tempfile.TemporaryDirectory() as name:
        files = Path(name)
        prepare(files)
        for number in range(asked.first, asked.first + asked.count):
            given = case(number)
            with place(files, given) as folder:
                answer = here(given, folder)
            problem = wrong(answer, given.arguments[0])
            longest = max(longest, answer.seconds)
            codes[f"{given.arguments[0]} {answer.code}"] += 1
            if problem is None and number - asked.first < asked.commands:
                with place(files, given) as folder:
                    other = as_command(given, folder)
                problem = wrong(other, given.arguments[0])
                if (
                    problem is None
                    and (other.code, other.files) != (answer.code, answer.files)
                    and 3 not in (other.code, answer.code)
                ):
                    problem = f"exit code {other.code} as a command, {answer.code} in this process"
            if problem is not None:
                failed += 1
                print(f"case {number}: {problem}: {given.arguments!r:.300}\n    {answer.err[-600:]!r}", flush=True)
    print(f"{asked.count} cases, {min(asked.commands, asked.count)} of them as commands as well: {failed} not as they should be")
    print(f"the longest took {longest:.1f} s; " + ", ".join(f"{key}: {count}" for key, count in sorted(codes.items())))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
