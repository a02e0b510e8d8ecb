"""Runs of ten thousand relaxation times: what drifts, what becomes negative, what grows in memory.

`python -m benchmarks.long_runs [--end N] [--only TEXT]` runs each case to t = N/γ (10 000) into a file of 200 frames, in its own
process, and prints a markdown table: steps, seconds, the largest change of mass over all frames, the least f over max f (of
hydrodynamics the least temperature over the mean), the distance to the known state at the end, and the most memory that the
process has had by 1, 10 and 100 % of the run. The state that (6) and (12) relax to is known: f_h of
stability.homogeneous_distribution, uniform in x. The distance is that of f, over its maximum; of hydrodynamics that of density,
mean velocity and temperature, over ρ̄, √θ and θ. Fails where mass drifts by more than 1e-10, f is below -rtol of its maximum, the
distance is beyond rtol, or memory grows by more than `GROWTH` in the last nine tenths; not that of the closed form, whose
integrals for one frame reach as far as particles have diffused by then (as √t).
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver import Scene, run_to_file
from kinetic_solver.dataset import open_run
from kinetic_solver.laws import Inelastic
from kinetic_solver.methods.interruption import Keeper
from kinetic_solver.stability.closure import closure_temperature
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stability.spectrum import homogeneous_distribution

RTOL = 1e-4
FRAMES, WITH_F = 200, 20
"""Of them so many with f; the closed form, whose frames are dear, has these alone."""
SHARES = (0.01, 0.1, 1.0)
"""Of the run, at which memory is looked at."""
GROWTH = 3.0
"""MiB: what the allocator may add."""
FRICTION, NOISE, DENSITY = 0.7, 0.5, 0.8
CASES: dict[str, tuple[str, float, dict[str, Any]]] = {
    "follow-the-leader, R* = 0.5, grid": ("grid", 0.5, {}),
    "follow-the-leader, R* = 2, grid": ("grid", 2.0, {}),
    "follow-the-leader, R* = 0.5, exact": ("exact", 0.5, {}),
    "follow-the-leader, R* = 2, exact": ("exact", 2.0, {}),
    "follow-the-leader, R* = 0.5, closure": ("hydrodynamics", 0.5, {"grid": {"nx": 64}, "accuracy": {"rtol": 1e-3}}),
    "inelastic, R* = 1, ε = 0.4, closure": (
        "hydrodynamics",
        1.0,
        {"collisions": {"operator": "inelastic", "restitution": 0.4}, "grid": {"nx": 64}, "accuracy": {"rtol": 1e-3}},
    ),
    "follow-the-leader, R* = 0.5, 8 moments": ("hydrodynamics", 0.5, {"hydrodynamics": {"moments": 8}}),
    "inelastic, R* = 1, ε = 0.4, grid": ("grid", 1.0, {"collisions": {"operator": "inelastic", "restitution": 0.4}}),
}


def scene_of(case: str, end: float) -> Scene:
    """To t = `end`/γ."""
    method, number, changes = CASES[case]
    strength = number * FRICTION / NOISE**0.5 / DENSITY
    return Scene.model_validate(
        {
            "model": {"gravity": 1.3, "friction": FRICTION, "noise": NOISE},
            "pipe": {"length": 9.0},
            "initial": {"density": DENSITY, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
            "run": {"end_time": end / FRICTION, "output_every": end / FRICTION / (WITH_F if method == "exact" else FRAMES)},
            "output": {"f": end / FRICTION / WITH_F, "budgets": False},
            "accuracy": {"rtol": RTOL},
            **changes,
            "collisions": {"operator": "follow-the-leader", "cross_section": strength, **changes.get("collisions", {})},
        }
    )


def measured(case: str, end: float, path: Path) -> dict[str, Any]:
    """Of one run, in this process."""
    method, scene = CASES[case][0], scene_of(case, end)
    steps, memory, began = 0, {}, time.monotonic()
    look = Keeper.look

    def counted(*arguments: Any) -> None:
        nonlocal steps
        steps += 1
        look(*arguments)

    def watch(now: float, whole: float) -> None:
        for share in SHARES:
            if now >= share * whole * (1 - 1e-9):
                memory.setdefault(share, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)

    Keeper.look = counted  # type: ignore[method-assign]
    try:
        run_to_file(scene, path, method, progress=watch)
    finally:
        Keeper.look = look  # type: ignore[method-assign]
    with open_run(path) as run:
        mass = run["mass"].values
        return {
            "steps": steps,
            "seconds": time.monotonic() - began,
            "drift": float(np.abs(mass / mass[0] - 1).max()),
            "least": least(run),
            "distance": distance(run, scene, method),
            "memory": [memory[share] for share in SHARES],
        }


def least(run: xr.Dataset) -> float:
    """The least f over its maximum, or where there is no f the least temperature over its mean."""
    if "f" in run:
        f = run["f"].values
        return float((f.min(axis=(1, 2)) / f.max(axis=(1, 2))).min())
    theta = run["temperature"].values
    return float(theta.min() / theta.mean())


def distance(run: xr.Dataset, scene: Scene, method: str) -> float:
    state = homogeneous_state(scene)
    assert state is not None
    last = run.isel(time=-1)
    if method == "hydrodynamics":
        theta = state.temperature  # with (12) that of the closure, whose distribution is a Gaussian
        if isinstance(scene.law, Inelastic):
            cooling = scene.cross_section * DENSITY * (1 - scene.restitution**2) / np.sqrt(np.pi)
            theta = closure_temperature(FRICTION, NOISE, cooling)
        return max(
            float(np.abs(last["density"] / DENSITY - 1).max()),
            float(np.abs(last["mean_velocity"] - state.mean_velocity).max()) / theta**0.5,
            float(np.abs(last["temperature"] / theta - 1).max()),
        )
    f = run["f"].values[-1]
    known = homogeneous_distribution(scene, last["v"].values)
    known = known * DENSITY / (known.sum() * float(last["v"][1] - last["v"][0]))
    return float(np.abs(f - known).max() / known.max())


def problems(case: str, found: dict[str, Any]) -> list[str]:
    grows = CASES[case][0] != "exact" and found["memory"][-1] - found["memory"][1] > GROWTH
    return [
        text
        for text, wrong in (
            (f"mass drifts by {found['drift']:.2g}", not found["drift"] < 1e-10),
            (f"f falls to {found['least']:.2g} of its maximum", not found["least"] > -RTOL),
            (f"the state is {found['distance']:.2g} away", not found["distance"] < RTOL),
            (f"memory grows: {found['memory']} MiB", grows),
        )
        if wrong
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--end", type=float, default=1e4, help="of the runs, in units of 1/γ")
    parser.add_argument("--only", default="", help="cases whose name has this text")
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.alone:
            print(json.dumps(measured(given.alone, given.end, Path(folder) / "run.nc")))
            return 0
    print(f"\nTo t = {given.end:g}/γ\n\n| case | steps | s | mass drift | least f/max f | distance | MiB at 1, 10, 100 % |")
    print("|---|---|---|---|---|---|---|")
    failed = False
    for case in (name for name in CASES if given.only in name):
        command = [sys.executable, "-m", "benchmarks.long_runs", "--alone", case, "--end", str(given.end)]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            failed = True
            continue
        found = json.loads(done.stdout)
        memory = ", ".join(f"{size:.0f}" for size in found["memory"])
        print(
            f"| {case} | {found['steps']} | {found['seconds']:.0f} | {found['drift']:.1e} | {found['least']:.1e} | "
            f"{found['distance']:.1e} | {memory} |",
            flush=True,
        )
        for problem in problems(case, found):
            failed = True
            print(f"{case}: {problem}", file=sys.stderr)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
