"""Does rtol deliver? Sweeps scenes with everything chosen from rtol and prints error/rtol, for f and for the moments.

Operator (6) is held against the closed form; operator (12), which has none, against a refined run. The constants in
plan/measured.py come from here. Fails where a ratio exceeds 1.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver import Scene, SolverStopped, exact, solve
from kinetic_solver.plan import make_plan


def scene(operator: dict[str, Any], rtol: float, length: float, start: dict[str, Any], end: float) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
            "collisions": operator,
            "pipe": {"length": length},
            "initial": {"density": 1.0, **start},
            "run": {"end_time": end},
            "accuracy": {"rtol": rtol},
            "output": {"budgets": False, "scalars": False},
        }
    )


def ratios(run: xr.Dataset, truth: xr.Dataset, rtol: float) -> dict[str, float]:
    """Error over what rtol allows: f, density and temperature of their maxima, mean velocity of max(|u|, √θ)."""
    top = {name: float(abs(truth[name]).max()) for name in ("f", "density", "temperature")}
    top["mean_velocity"] = max(float(abs(truth["mean_velocity"]).max()), math.sqrt(top["temperature"]))
    return {name: float(abs(run[name] - truth[name]).max()) / (scale * rtol) for name, scale in top.items()}


def against_exact(subject: Scene) -> dict[str, float]:
    run = solve(subject).isel(time=-1)
    return ratios(run, exact.solve(subject, x=run["x"], v=run["v"]).isel(time=-1), subject.accuracy.rtol)


def against_refined(subject: Scene) -> dict[str, float]:
    """The refined run has three times the points in x and v, so that its points include the run's, and a tenth of rtol."""
    plan = make_plan(subject)
    rtol = subject.accuracy.rtol
    finer = {"nx": 3 * plan.grid.nx, "nv": 3 * plan.grid.nv, "velocity_window": (plan.grid.low, plan.grid.high)}
    finer["deposit"] = "quintic" if rtol < 1e-3 else "cubic"
    table = {**subject.model_dump(exclude_none=True, by_alias=True), "grid": finer, "accuracy": {"rtol": rtol / 10}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run's own window, at a tenth of its rtol
        truth = solve(Scene.model_validate(table)).isel(time=-1, x=slice(None, None, 3))
    return ratios(solve(subject).isel(time=-1), truth.isel(v=slice(1, None, 3)).assign_coords(v=plan.grid.v, x=plan.grid.x), rtol)


MODES = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
STEP = {"step": {"from": 0.2, "to": 0.5, "ratio": 3.0}}


def cases() -> Iterator[tuple[str, Scene]]:
    for number, rtol in itertools.product((0.3, 1.0, 2.0, 3.0, 5.0), (1e-2, 1e-4, 1e-6, 1e-8)):
        operator = {"operator": "follow-the-leader", "cross_section": number}
        for length, temperature, end in ((8 * math.pi, None, 2.0), (3.0, 0.2, 0.5), (60.0, 3.0, 1.0), (8 * math.pi, None, 10.0)):
            start = MODES if temperature is None else {**MODES, "temperature": temperature}
            theta = "hom" if temperature is None else f"{temperature:g}"
            yield f"(6) R = {number:g}, θ0 {theta}", scene(operator, rtol, length, start, end)
    for number, rtol in itertools.product((0.3, 2.0), (1e-2, 1e-4)):
        operator = {"operator": "follow-the-leader", "cross_section": number}
        yield f"(6) R = {number:g}, a step", scene(operator, rtol, 8 * math.pi, STEP, 2.0)
    for restitution, number, rtol in itertools.product((0.0, 0.5, 0.9), (0.5, 2.0), (1e-2, 1e-4)):
        operator = {"operator": "inelastic", "cross_section": number, "restitution": restitution}
        for length, temperature, end in ((8 * math.pi, None, 1.0), (3.0, 0.2, 0.5)):
            start = MODES if temperature is None else {**MODES, "temperature": temperature}
            theta = "hom" if temperature is None else f"{temperature:g}"
            yield f"(12) R = {number:g}, ε = {restitution:g}, θ0 {theta}", scene(operator, rtol, length, start, end)


def main() -> int:
    worst, refused = 0.0, 0
    print(f"{'scene':<34} rtol    L     t   nx × nv × steps          s   error/rtol of f, ρ, u, θ")
    for name, subject in cases():
        plan = make_plan(subject)
        began = time.perf_counter()
        try:
            solve(subject)
        except SolverStopped as stop:
            refused += 1
            print(f"{name:<32} {subject.accuracy.rtol:5.0e}   refused: {stop}", flush=True)
            continue
        seconds = time.perf_counter() - began
        found = (against_exact if "(6)" in name else against_refined)(subject)
        worst = max(worst, *found.values())
        size = f"{plan.grid.nx} × {plan.grid.nv} × {'~' * plan.controlled}{plan.expected_steps}"
        shown = "  ".join(f"{found[key]:.1e}" for key in ("f", "density", "mean_velocity", "temperature"))
        rtol, length, end = subject.accuracy.rtol, subject.pipe.length, subject.run.end_time
        print(f"{name:<32} {rtol:5.0e} {length:5.3g} {end:4g}   {size:<20} {seconds:6.2f}   {shown}", flush=True)
    print(f"worst error/rtol {np.format_float_positional(worst, 3, fractional=False)}, {refused} refused")
    return int(worst > 1)


if __name__ == "__main__":
    sys.exit(main())
