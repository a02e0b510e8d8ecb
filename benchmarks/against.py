"""What runs cost beside an earlier commit: both timed in turn on this machine, and their answers laid over each other.

    python -m benchmarks.against COMMIT [--rounds N] [--frames N] [--inelastic]

COMMIT is checked out into a temporary folder. Whole processes and warm calls of `solve` are timed by turns, this checkout first:
`run` of shipped scenes (a second run, for the first of each keeps its bytecode) and a first run of (12), whose loops are not
compiled yet. A figure is the median of the rounds. The answers of both must agree within rtol. With `--inelastic` only the rows
of operator (12) are timed, ε = 0.5 and one wave of 50 %: a first `solve` of the scene in a process that has everything compiled,
all its tables included, and the least of those that follow it. With `--frames` one long run of pipe.toml with as many frames goes
to a file, and one with a tenth of them: seconds, and the peak of memory. The exit code is 1 where a floor below is missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import open_run, scene_of
from kinetic_solver.solver.regrid import resize

HERE = Path(__file__).parents[1]
SCENES = ("pipe", "small", "kramers")
SHARES = (2, 5)
"""R* of the warm calls: ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx, L = 8π, g = γ = σ = 1, t = 2, rtol = 1e-6, budgets on."""
FIRST = "inelastic"
"""The scene of first runs: numba's cache is empty, on one thread and on two."""
FLOORS = {
    **{f"run {name}.toml": 2.5 for name in SCENES},
    "solve, R* = 2": 2.7,
    "solve, R* = 5": 4.5,
    "first run of inelastic.toml, 1 thread": 2.0,
    "first run of inelastic.toml, 2 threads": 3.0,
}
"""By how many times the processor's time must be less than at commit 7427e74: measured, less what a busy machine blurs."""
LONGEST, GROWTH = 60.0, 1.1
"""Seconds of the processor that the long run may take, and how its peak of memory may exceed that of a tenth of its frames."""
WARM = """
import sys, time
from kinetic_solver import Scene, solve
from kinetic_solver.dataset import write_dataset
scene = Scene.model_validate({
    "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
    "collisions": {"operator": "follow-the-leader", "cross_section": float(sys.argv[1])},
    "pipe": {"length": 25.132741228718345},
    "initial": {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
    "run": {"end_time": 2.0}, "accuracy": {"rtol": 1e-6},
})
write_dataset(solve(scene), sys.argv[2], overwrite=True)
taken = []
for _ in range(9):
    start = time.process_time()
    solve(scene)
    taken.append(time.process_time() - start)
print(min(taken))
"""


INELASTIC = ((2, 2, 1e-4), (10, 2, 1e-4), (50, 2, 1e-3), (10, 20, 1e-4), (2, 200, 1e-3))
"""(S, t, rtol) of the rows of (12): g = γ = σ = 1, L = 8π, budgets on, from the homogeneous state's velocity and temperature."""
INELASTIC_FLOORS = ((1.0, 1.5), (2.2, 6.0), (7.0, 15.0), (15.0, 20.0), (8.0, 8.0))
"""By how many times less a first and a later `solve` of each row must take than at commit 91efe40: measured, less a third."""
OF_PAIRS = """
import sys, time
from kinetic_solver import Scene, solve
from kinetic_solver.dataset import write_dataset
def scene(number, end, rtol):
    return Scene.model_validate({
        "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
        "collisions": {"operator": "inelastic", "cross_section": number, "restitution": 0.5},
        "pipe": {"length": 25.132741228718345},
        "initial": {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}]},
        "run": {"end_time": end}, "accuracy": {"rtol": rtol},
    })
solve(scene(1.5, 0.5, 1e-3))
taken = []
for _ in range(4):
    start = time.process_time()
    run = solve(scene(*map(float, sys.argv[1:4])))
    taken.append(time.process_time() - start)
write_dataset(run, sys.argv[4], overwrite=True)
print(taken[0], min(taken[1:]))
"""


class Cost(NamedTuple):
    """Of a process."""

    processor: float
    """Seconds, user and system."""
    wall: float


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "checkout"
        worktree = ["git", "-C", str(HERE), "worktree"]
        subprocess.run([*worktree, "add", "--detach", str(root), commit], check=True, capture_output=True)
        try:
            yield root
        finally:
            subprocess.run([*worktree, "remove", "--force", str(root)], check=True)


def process(root: Path, folder: Path, *arguments: str, **more: str) -> tuple[Cost, str]:
    """Runs Python in the folder, on the checkout at `root`, with one BLAS thread and bytecode that is kept, and `more` set."""
    settings = more | {
        "PYTHONPATH": str(root),
        "PYTHONPYCACHEPREFIX": str(folder / f"bytecode of {root == HERE}"),
        "OMP_NUM_THREADS": "1",
    }
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"} | settings
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen(
        [sys.executable, *arguments], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        said, complaints = child.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert child.returncode == 0, complaints
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(spent, time.monotonic() - start), said


def peak(folder: Path, *arguments: str) -> tuple[Cost, float]:
    """What a run of this checkout costs, and the MiB that it takes at most, by Linux: getrusage counts the parent's too."""
    code = (
        "from kinetic_solver.cli.app import main\n"
        "try: main()\nexcept SystemExit as end: assert not end.code\n"
        "print(next(int(line.split()[1]) / 1024 for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    cost, said = process(HERE, folder, "-c", code, *arguments)
    return cost, float(said.splitlines()[-1])


def agree(ours: Path, theirs: Path) -> None:
    """Raises AssertionError where ∫v^n f dv, n = 0, 1, 2, or f differ by more than both runs' rtol together, over their maxima
    (∫v f dv over that of ρ√θ, if that is more). The points hold all waves in x of these, whatever their number. f only where both
    have the same points: what lies between those of a run is not its promise."""
    with open_run(ours) as a, open_run(theirs) as b:
        rtol = scene_of(a).accuracy.rtol
        pairs = [("f", a["f"].values, b["f"].values)] if a["f"].shape == b["f"].shape and np.array_equal(a["v"], b["v"]) else []
        for n, (here, there) in enumerate(zip(raw(a), raw(b), strict=True)):
            pairs.append((f"moment {n}", here, resize(there, a.sizes["x"], axis=1)))
        speed = float((a["density"] * np.sqrt(a["temperature"])).max())
        for name, here, there in pairs:
            size = max(float(np.abs(here).max()), speed if name == "moment 1" else 0.0)
            worst = float(np.abs(here - there).max()) / size
            assert worst <= 2 * rtol, f"{name}: differs by {worst:.2g}, more than twice rtol = {rtol:g}"


def raw(run: xr.Dataset) -> list[Array]:
    """∫v^n f dv, n = 0, 1, 2, (time, x) each."""
    rho, u, theta = (run[name].values for name in ("density", "mean_velocity", "temperature"))
    return [rho, rho * u, rho * (u**2 + theta)]


def rows(other: Path, folder: Path, rounds: int) -> Iterator[tuple[str, list[Cost], list[Cost]]]:
    """(name, here, there), one cost for each round."""
    both = ((HERE, "here.nc"), (other, "there.nc"))
    for name in SCENES:
        scene = str(HERE / "scenes" / f"{name}.toml")
        command = ["-m", "kinetic_solver", "run", scene, "--overwrite", "-o"]
        for root, file in both:
            process(root, folder, *command, file)
        agree(folder / "here.nc", folder / "there.nc")
        turns = [[process(root, folder, *command, "timed.nc")[0] for root in (HERE, other)] for _ in range(rounds)]
        yield f"run {name}.toml", [turn[0] for turn in turns], [turn[1] for turn in turns]
    for share in SHARES:
        turns = []
        for _ in range(rounds):
            said = [process(root, folder, "-c", WARM, str(share), file)[1] for root, file in both]
            turns.append([Cost(float(text), float(text)) for text in said])
        agree(folder / "here.nc", folder / "there.nc")
        yield f"solve, R* = {share}", [turn[0] for turn in turns], [turn[1] for turn in turns]
    command = ["-m", "kinetic_solver", "run", str(HERE / "scenes" / f"{FIRST}.toml"), "--overwrite", "-o"]
    for threads in (1, 2):
        turns = [[first_run(root, folder, threads, *command, file) for root, file in both] for _ in range(max(2, rounds // 3))]
        agree(folder / "here.nc", folder / "there.nc")
        plural = "s" if threads > 1 else ""
        yield f"first run of {FIRST}.toml, {threads} thread{plural}", [turn[0] for turn in turns], [turn[1] for turn in turns]


def first_run(root: Path, folder: Path, threads: int, *arguments: str) -> Cost:
    with tempfile.TemporaryDirectory() as empty:
        return process(root, folder, *arguments, NUMBA_CACHE_DIR=empty, NUMBA_NUM_THREADS=str(threads))[0]


def of_pairs(other: Path, folder: Path, rounds: int) -> list[str]:
    """Prints the rows of (12); returns those that miss their floors."""
    print("| S, t, rtol | first here | there | ratio | later here | there | ratio |\n|---|---|---|---|---|---|---|")
    missed = []
    for scene, floors in zip(INELASTIC, INELASTIC_FLOORS, strict=True):
        both, costs = ((HERE, "here.nc"), (other, "there.nc")), []
        for _ in range(rounds):
            said = [process(root, folder, "-c", OF_PAIRS, *map(str, scene), file)[1] for root, file in both]
            costs.append([[float(number) for number in text.split()] for text in said])
        agree(folder / "here.nc", folder / "there.nc")
        ours, theirs = np.median(np.array(costs), axis=0)
        ratios = theirs / ours
        cells = " | ".join(f"{1e3 * a:.0f} ms | {1e3 * b:.0f} ms | {b / a:.1f}" for a, b in zip(ours, theirs, strict=True))
        print(f"| {scene[0]}, {scene[1]}, {scene[2]:g} | {cells} |", flush=True)
        if np.any(ratios < floors):
            missed.append(f"S = {scene[0]}, t = {scene[1]}: {ratios[0]:.1f} and {ratios[1]:.1f} times, below {floors}")
    return missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--frames", type=int, help="of a long run into a file; 10000 takes a minute at most")
    parser.add_argument("--inelastic", action="store_true", help="only the rows of operator (12)")
    given = parser.parse_args()
    missed = []
    with checked_out(given.commit) as other, tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if given.inelastic:
            missed = of_pairs(other, folder, given.rounds)
            print("\n".join(missed))
            return int(bool(missed))
        print("| | processor time here | there | ratio | wall clock here | there | ratio |\n|---|---|---|---|---|---|---|")
        for name, here, there in rows(other, folder, given.rounds):
            ours, theirs = (Cost(*map(median, zip(*costs, strict=True))) for costs in (here, there))
            ratio = theirs.processor / ours.processor
            print(
                f"| {name} | {1e3 * ours.processor:.0f} ms | {1e3 * theirs.processor:.0f} ms | {ratio:.1f} | "
                f"{1e3 * ours.wall:.0f} ms | {1e3 * theirs.wall:.0f} ms | {theirs.wall / ours.wall:.1f} |",
                flush=True,
            )
            if ratio < FLOORS.get(name, 0.0):
                missed.append(f"{name}: {ratio:.2f} times, below {FLOORS[name]}")
        if given.frames:
            command = ["run", str(HERE / "scenes" / "pipe.toml"), "--overwrite", "-o", "long.nc", "--set"]
            few, many = (
                peak(folder, *command, f"run.output_every={20 / frames}") for frames in (given.frames // 10, given.frames)
            )
            print()
            for frames, (cost, memory) in ((given.frames // 10, few), (given.frames, many)):
                print(
                    f"{frames} frames of pipe.toml: {cost.processor:.1f} s of the processor, {cost.wall:.1f} s, {memory:.0f} MiB"
                )
            if many[0].processor > LONGEST or many[1] > GROWTH * few[1]:
                missed.append(f"{given.frames} frames: more than {LONGEST:g} s, or memory grows")
    print("\n".join(missed))
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
