"""What an accuracy costs: error and seconds over rtol from 1e-2 to 1e-10, beside grids chosen by hand.

Standing scenes: ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx on L = 8π, g = γ = σ = 1, t = 2, from the homogeneous state's (u, θ): with
operator (6) at R* = 0.3, 2, 5; with operator (12) at ε = 0.5, R* = 1 (to rtol = 1e-8); without collisions; and a homogeneous flow
that relaxes under (12) from u0 = 2, θ0 = 2. Beside them the usual way: n × n points for n = 32, 64, 128, 256, n/2 steps of
Strang's splitting, finite volumes of order 2 in v, a linear deposit for (12), on the window that rtol = 1e-6 would choose.
The error is the largest of those that rtol is about (docs/accuracy.md), of f, density, mean velocity and temperature at the end,
against the closed form; with (12) against one run on a finer grid than that of the least rtol, at a thirtieth of it.
Seconds are the processor time of `solve` after compilation, one core, the best of three. Prints a markdown table, writes
output/accuracy_cost.csv and from it docs/accuracy.png, and fails where an error exceeds its rtol.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import csv
import math
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from benchmarks.random_scenes import LEAST_RTOL, against_exact, at_points_of, finer_grid, worst_frame
from kinetic_solver import Scene, SolverStopped, solve
from kinetic_solver.analysis.drawing import BLUE, GREY, ORANGE
from kinetic_solver.errors import SceneError
from kinetic_solver.plan import make_plan

TOLERANCES = tuple(10.0**-n for n in range(2, 11))
SIZES = (32, 64, 128, 256)
PATIENCE = 10.0
"""Seconds after which a run is not repeated for its time's sake."""
TABLE, PICTURE = Path("output/accuracy_cost.csv"), Path("docs/accuracy.png")


@dataclass(frozen=True)
class Problem:
    """A scene for every rtol and [grid]."""

    name: str
    collisions: dict[str, Any] | None
    finest: float = 1e-10
    """The least rtol that is tried."""
    homogeneous: bool = False

    def scene(self, rtol: float, grid: dict[str, Any] | None = None) -> Scene:
        start: dict[str, Any] = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
        if self.homogeneous:
            start = {"mean_velocity": 2.0, "temperature": 2.0}
        return Scene.model_validate(
            {
                "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
                "collisions": self.collisions,
                "pipe": {"length": 8 * math.pi},
                "initial": start,
                "run": {"end_time": 2.0},
                "accuracy": {"rtol": rtol},
                "output": {"budgets": False, "scalars": False},
                "grid": grid or {},
            }
        )

    def by_hand(self, n: int) -> Scene:
        """n × n points and n/2 steps."""
        plan = make_plan(self.scene(1e-6))
        grid: dict[str, Any] = {
            "nx": 1 if self.homogeneous else n,
            "nv": n,
            "velocity_window": (plan.grid.low, plan.grid.high),
            "drift_diffusion": "finite-volume",
        }
        if self.collisions is not None:
            grid |= {"stepping": "strang", "time_step": 4.0 / n}
        if self.inelastic:
            grid["deposit"] = "linear"
        return self.scene(1e-4, grid)

    @property
    def inelastic(self) -> bool:
        return self.collisions is not None and self.collisions["operator"] == "inelastic"

    def error(self) -> Callable[[Scene, xr.Dataset], float]:
        """(scene, run) → the largest of the errors."""
        if not self.inelastic:
            return lambda scene, run: max(against_exact(scene, run).values()) * scene.accuracy.rtol
        if self.homogeneous:
            # Pairs of cells share nothing with waves in velocities that follow the gas.
            grid = make_plan(self.scene(self.finest)).grid
            where = {"output.nv": 3 * grid.nv, "output.velocity_window": (grid.low, grid.high)}
            truth = solve(self.scene(LEAST_RTOL, {"deposit": "quintic"}).replace(**where))
        else:
            truth = solve(self.scene(max(LEAST_RTOL, self.finest / 30), finer_grid(solve(self.scene(self.finest)))))

        def against_truth(scene: Scene, run: xr.Dataset) -> float:
            return max(worst_frame(run, at_points_of(run, truth, scene.pipe.length), 1.0).values())

        return against_truth


def follow(number: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": number}


INELASTIC = {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5}
PROBLEMS = (
    Problem("follow-the-leader, R* = 0.3", follow(0.3)),
    Problem("follow-the-leader, R* = 2", follow(2.0)),
    Problem("follow-the-leader, R* = 5", follow(5.0)),
    Problem("inelastic, ε = 0.5, R* = 1", INELASTIC, finest=1e-8),
    Problem("no collisions", None),
    Problem("inelastic, ε = 0.5, R* = 1, homogeneous", INELASTIC, homogeneous=True),
)


@dataclass(frozen=True)
class Point:
    problem: str
    rtol: float | None
    """None for a grid chosen by hand."""
    size: str
    seconds: float
    error: float


def measure(problem: Problem, scene: Scene, rtol: float | None, error: Callable[[Scene, xr.Dataset], float]) -> Point:
    """The best of three runs, of fewer where they are long. What must be compiled has been."""
    seconds, spent = math.inf, 0.0
    for _ in range(4):
        began = time.process_time()
        run = solve(scene)
        seconds = min(seconds, time.process_time() - began)
        spent += time.process_time() - began
        if spent > PATIENCE:
            break
    return Point(problem.name, rtol, f"{run.sizes['x']} × {run.sizes['v']}", seconds, error(scene, run))


def of_problem(problem: Problem) -> list[Point]:
    """Prints its rows as they come."""
    solve(problem.scene(1e-2))  # compiles
    solve(problem.by_hand(SIZES[1]))
    error = problem.error()
    points = []
    subjects: list[tuple[Scene, float | None, str]] = [
        (problem.scene(rtol), rtol, f"rtol = {rtol:.0e}") for rtol in TOLERANCES if rtol >= 0.99 * problem.finest
    ]
    subjects += [(problem.by_hand(n), None, f"by hand, {n // 2} steps") for n in SIZES]
    for scene, rtol, label in subjects:
        try:
            point = measure(problem, scene, rtol, error)
        except (SolverStopped, SceneError) as stop:
            print(f"| {problem.name} | {label} | – | – | – | {stop} |", flush=True)
            continue
        points.append(point)
        ratio = f"{point.error / rtol:.2g}" if rtol is not None else ""
        print(f"| {problem.name} | {label} | {point.size} | {point.seconds:.3g} | {point.error:.1e} | {ratio} |", flush=True)
    return points


COLOURS, MARKS = (BLUE, BLUE, BLUE, ORANGE, GREY, ORANGE), "osDo^s"
"""Of the problems: one colour to an operator, one mark to a scene of it."""


def write(points: list[Point], path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("problem", "rtol", "grid", "seconds", "error"))
        rows.writerows((p.problem, p.rtol or "", p.size, f"{p.seconds:.6g}", f"{p.error:.3g}") for p in points)


def draw(table: Path, picture: Path) -> None:
    """Left: error against seconds, rtol's points joined, grids by hand as crosses. Right: error/rtol, which should be below 1."""
    with table.open(encoding="utf-8") as file:
        points = list(csv.DictReader(file))
    figure = Figure(figsize=(12, 5.8), layout="constrained")
    cost, kept = figure.subplots(1, 2)
    for problem, colour, mark in zip(PROBLEMS, COLOURS, MARKS, strict=True):
        here = [p for p in points if p["problem"] == problem.name]
        rtol, seconds, error = (np.array([float(p[name]) for p in here if p["rtol"]]) for name in ("rtol", "seconds", "error"))
        hollow = {"mfc": "w"} if problem.homogeneous else {}
        style: dict[str, Any] = {"color": colour, "marker": mark, "ms": 5, "lw": 1.2, **hollow}
        cost.plot(seconds, error, label=f"{problem.name}, by rtol", **style)
        by_hand = [(float(p["seconds"]), float(p["error"])) for p in here if not p["rtol"]]
        cost.plot(*zip(*by_hand, strict=True), color=colour, marker=mark, mfc="w", ms=8, mew=1.4, ls=(0, (1, 3)), lw=1)
        kept.plot(rtol, error / rtol, **style)
    cost.plot([], [], "s", color="k", mfc="w", ms=8, mew=1.4, label="large and hollow: the same scene on n × n points by hand")
    title = "What an error costs: by rtol from 1e-2 to 1e-10, and by hand"
    cost.set(xscale="log", yscale="log", xlabel="seconds of processor time, one core", title=title)
    cost.set_ylabel("largest error of f, ρ, u, θ at t = 2, relative")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    kept.axhline(1, color="k", lw=1.2)
    kept.text(0.99, 1.2, "what rtol allows", transform=kept.get_yaxis_transform(), ha="right", va="bottom", fontsize=9)
    kept.set(xscale="log", yscale="log", xlabel="rtol", ylabel="error/rtol", title="Whether rtol is kept", ylim=(None, 10))
    kept.invert_xaxis()
    for axes in (cost, kept):
        axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)


def main() -> int:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    print("| scene | grid | nx × nv | s | error | error/rtol |\n|---|---|---|---|---|---|")
    points = [point for problem in PROBLEMS for point in of_problem(problem)]
    write(points, TABLE)
    draw(TABLE, PICTURE)
    exceeded = [p for p in points if p.rtol is not None and not p.error <= p.rtol]
    print(f"\nwrote {PICTURE}; {len(exceeded)} of {sum(p.rtol is not None for p in points)} errors exceed their rtol")
    return int(bool(exceeded))


if __name__ == "__main__":
    sys.exit(main())
