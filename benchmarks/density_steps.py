"""Random density steps against the closed form: at each rtol the run meets it in f, ρ, u and θ, or one line says why not.

    python -m benchmarks.density_steps [COUNT]

Position, width, ratio of densities (1e-6 to 1e3), first frame (1e-3 to 1 of 1/γ), without collisions and with (6), with and
without friction, noise and gravity. Prints the table of docs/accuracy.md; fails where an error exceeds rtol. (12) has no closed
form, and is run for refusals and temperatures alone.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver import Scene, SceneError, SolverStopped, exact, solve

TOLERANCES = (1e-2, 1e-3, 1e-4)
COUNT = 60
PLACES = 200
"""In x, at most, at which a frame is held against the closed form."""


def random_step(seed: int, rtol: float) -> Scene:
    rng = np.random.default_rng(seed)
    start, width = rng.uniform(0, 0.6), rng.uniform(0.05, 0.4)
    kind = ("none", "none", "(6)", "(6)", "(12)")[seed % 5]
    first = float(10 ** rng.uniform(-3, 0))
    model = {"gravity": float(rng.choice([0.0, 1.3])), "friction": 1.0, "noise": float(rng.uniform(0.4, 1.5))}
    if seed % 7 == 6:
        model |= {"friction": 0.0} if seed % 2 else {"noise": 0.0}
    table: dict[str, Any] = {
        "model": model,
        "pipe": {"length": float(rng.choice([5.0, 8 * math.pi]))},
        "initial": {
            "density": 0.9,
            "step": {"from": start, "to": start + width, "ratio": float(10 ** rng.uniform(-6, 3))},
            "mean_velocity": float(rng.uniform(-0.5, 1.0)),
            "temperature": float(rng.uniform(0.5, 1.5)),
        },
        "run": {"end_time": 2 * first, "output_every": first},
        "accuracy": {"rtol": rtol},
    }
    if kind != "none":
        table["collisions"] = {"operator": "follow-the-leader", "cross_section": float(rng.uniform(0.1, 2.5))}
    if kind == "(12)":
        table["collisions"] = {"operator": "inelastic", "cross_section": float(rng.uniform(0.1, 1.0)), "restitution": 0.5}
    return Scene.model_validate(table)


def errors(scene: Scene, run: xr.Dataset) -> dict[str, float]:
    """Of f, ρ, u and θ over rtol, the worst frame after time 0, each by its own maximum; u and θ where they are given."""
    worst = dict.fromkeys(("f", "density", "mean_velocity", "temperature"), 0.0)
    every = max(1, run.sizes["x"] // PLACES)
    x, v = run["x"].values, run["v"].values
    # Places all over the pipe, and every one about the jumps, where a cut shows.
    step = scene.initial.step
    assert step is not None
    distance = np.min([np.abs(np.mod(x / scene.pipe.length - edge + 0.5, 1) - 0.5) for edge in (step.start, step.end)], axis=0)
    chosen = np.union1d(np.arange(0, x.size, every), np.argsort(distance)[:PLACES])
    for n in range(1, run.sizes["time"]):
        solution = exact.Solution(scene, float(run["time"][n]))
        truth = {"f": solution.distribution(x[chosen], v)}
        truth |= dict(zip(("density", "mean_velocity", "temperature"), solution.moments(x[chosen]), strict=False))
        for name, values in truth.items():
            scale = float(np.abs(values).max())
            if name == "mean_velocity":
                scale = max(scale, math.sqrt(float(truth["temperature"].max())))
            difference = np.abs(run[name].values[n][chosen] - values)
            if np.isfinite(difference).any():
                worst[name] = max(worst[name], float(np.nanmax(difference)) / scale / scene.accuracy.rtol)
    return worst


def measure(seed: int, rtol: float) -> tuple[str, float, bool]:
    """(a line, error/rtol, refused) of one scene."""
    scene = random_step(seed, rtol)
    begun = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            run = solve(scene)
        except (SceneError, SolverStopped) as error:
            return str(error), 0.0, True
    seconds = time.perf_counter() - begun
    coldest = float(run["temperature"].min())
    words = f"{run.sizes['x']} × {run.sizes['v']}, {seconds:.2g} s" + ("; warns" if said else "")
    if scene.operator == "inelastic":
        return words, 0.0 if coldest > 0 else math.inf, False
    found = errors(scene, run)
    name = max(found, key=lambda field: found[field])
    silent = found[name] if not said else min(found[name], 1.0)
    return f"{words}: {found[name]:.2g} ({name})", silent if coldest > 0 else math.inf, False


def main(count: int = COUNT) -> int:
    failed = 0
    for rtol in TOLERANCES:
        results = []
        for seed in range(count):
            line, error, refused = measure(seed, rtol)
            results.append((error, refused))
            failed += error > 1
            if refused or error > 1:
                print(f"rtol {rtol:g}, seed {seed}: {line}", file=sys.stderr, flush=True)
        kept = [error for error, refused in results if not refused]
        print(f"| {rtol:g} | {max(kept):.2g} | {np.median(kept):.2g} | {len(results) - len(kept)} of {count} |", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
