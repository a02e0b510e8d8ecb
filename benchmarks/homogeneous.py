"""Homogeneous runs of (12): seconds and errors over restitutions and collision numbers, at rtol 1e-7, to 30/γ.

    python -m benchmarks.homogeneous

From a Maxwellian of temperature σ at rest, under gravity: θ falls to its stationary value, by 10⁴ at the most. The truth is
the homogeneous state by Newton's method (stability/inelastic.py). Seconds are of the processor, best of three, after one run
that is not counted. Fails where a run takes a second or more up to R* = 1000, or where θ or a2 is off by 1e-6 or more.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import sys
import time

import xarray as xr

from kinetic_solver import Scene, solve
from kinetic_solver.plan import cost, make_plan
from kinetic_solver.stability.homogeneous import homogeneous_state

RESTITUTIONS = (0.0, 0.5, 0.9, 0.99)
NUMBERS = (1.0, 10.0, 100.0, 1e3, 1e4, 1e6)
"""R*."""
PROMISED = 1e3
"""R* up to which a run is to take less than a second."""
OFF = 1e-6
"""Of θ/σ and a2, at most."""
REPEATS = 3


def scene(restitution: float, number: float) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0},
            "collisions": {"operator": "inelastic", "cross_section": number, "restitution": restitution},
            "pipe": {"length": 1.0},
            "initial": {"mean_velocity": 0.0, "temperature": 1.0},
            "run": {"end_time": 30.0},
            "accuracy": {"rtol": 1e-7},
        }
    )


def kurtosis_excess(ds: xr.Dataset) -> float:
    v, w = ds["v"].values, ds["velocity_distribution"].values[-1]
    c = v - w @ v / w.sum()
    return float((w @ c**4) * w.sum() / (3 * (w @ c**2) ** 2) - 1)


def main() -> int:
    solve(scene(0.3, 2.0))
    print("| ε | R* | θ/σ | a2 | seconds | foretold/taken | θ off | a2 off |\n|---|---|---|---|---|---|---|---|")
    failed = False
    for restitution in RESTITUTIONS:
        for number in NUMBERS:
            run = scene(restitution, number)
            seconds = []
            for _ in range(REPEATS):
                began = time.process_time()
                found = solve(run)
                seconds.append(time.process_time() - began)
            state = homogeneous_state(run)
            assert state is not None
            theta, a2 = float(found["temperature"][-1, 0]), kurtosis_excess(found)
            off = abs(theta - state.temperature), abs(a2 - state.kurtosis_excess)
            foretold = cost(make_plan(run)).seconds / min(seconds)
            row = f"{restitution} | {number:g} | {theta:.6g} | {a2:.6f} | {min(seconds):.3f} | {foretold:.2g}"
            print(f"| {row} | {off[0]:.0e} | {off[1]:.0e} |", flush=True)
            failed |= number <= PROMISED and (min(seconds) >= 1 or max(off) >= OFF)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
