"""Does rtol deliver? Sweeps scenes with everything chosen from rtol and prints error/rtol, for f and for the moments.

Operator (6) is held against the closed form; operator (12), which has none, against a refined run. The constants marked
"measured" in plan.py come from here. Fails where a ratio exceeds 1.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver import Scene, exact, solve
from kinetic_solver.plan import make_plan


def scene(operator: dict[str, Any], rtol: float, length: float, temperature: float | None, end: float) -> Scene:
    start: dict[str, Any] = {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
    if temperature is not None:
        start["temperature"] = temperature
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
            "collisions": operator,
            "pipe": {"length": length},
            "initial": start,
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
    """The refined run has three times the points in x and v, so that its points include the run's, and a quarter of the step."""
    plan = make_plan(subject)
    assert plan.time_step is not None
    rtol = subject.accuracy.rtol
    window = (plan.grid.low, plan.grid.high)
    finer = {"nx": 3 * plan.grid.nx, "nv": 3 * plan.grid.nv, "velocity_window": window, "time_step": plan.time_step / 4}
    finer["deposit"] = "quintic" if rtol < 1e-3 else "cubic"
    reference = Scene.model_validate({**subject.model_dump(exclude_none=True), "grid": finer})
    truth = solve(reference).isel(time=-1, x=slice(None, None, 3))
    return ratios(solve(subject).isel(time=-1), truth.isel(v=slice(1, None, 3)).assign_coords(v=plan.grid.v, x=plan.grid.x), rtol)


def main() -> int:
    worst = 0.0
    print("operator                rtol   L    θ0    t   |  nx × nv × steps       s  |  error/rtol of f, ρ, u, θ")
    cases: list[tuple[dict[str, Any], float, float, float | None, float]] = []
    for number, rtol in itertools.product((0.3, 1.0, 2.0, 3.0, 5.0), (1e-2, 1e-4, 1e-6)):
        if rtol == 1e-6 and number > 2:
            continue  # minutes each: Strang's step is too small
        for length, temperature, end in ((8 * math.pi, None, 2.0), (3.0, 0.2, 0.5), (60.0, 3.0, 1.0), (8 * math.pi, None, 10.0)):
            if (number, rtol) == (2.0, 1e-6) and end > 0.5:
                continue
            if (number, rtol, end) in ((5.0, 1e-4, 1.0), (5.0, 1e-4, 10.0)):
                continue
            cases.append(({"operator": "follow-the-leader", "cross_section": number}, rtol, length, temperature, end))
    for restitution, number, rtol in itertools.product((0.0, 0.5, 0.9), (0.5, 2.0), (1e-2, 1e-4)):
        for length, temperature, end in ((8 * math.pi, None, 2.0), (3.0, 0.2, 0.5), (60.0, 3.0, 1.0)):
            if rtol == 1e-4 and length > 8:
                continue  # the refined run would take minutes
            table = {"operator": "inelastic", "cross_section": number, "restitution": restitution}
            cases.append((table, rtol, length, temperature, end))
    for operator, rtol, length, temperature, end in cases:
        subject = scene(operator, rtol, length, temperature, end)
        plan = make_plan(subject)
        began = time.perf_counter()
        solve(subject)
        seconds = time.perf_counter() - began
        found = (against_exact if operator["operator"] == "follow-the-leader" else against_refined)(subject)
        worst = max(worst, *found.values())
        name = f"(6) R = {operator['cross_section']:g}" if "restitution" not in operator else (
            f"(12) R = {operator['cross_section']:g}, ε = {operator['restitution']:g}"
        )  # fmt: skip
        size = f"{plan.grid.nx} × {plan.grid.nv} × {plan.total_steps}"
        shown = "  ".join(f"{found[key]:.2g}" for key in ("f", "density", "mean_velocity", "temperature"))
        theta = "hom" if temperature is None else f"{temperature:g}"
        print(f"{name:<20}  {rtol:5.0e}  {length:4.3g}  {theta:<4} {end:4g}   {size:<18} {seconds:6.2f}   {shown}", flush=True)
    print(f"worst error/rtol {np.format_float_positional(worst, 3, fractional=False)}")
    return int(worst > 1)


if __name__ == "__main__":
    sys.exit(main())
