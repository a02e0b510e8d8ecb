"""Error of f against time of the whole solve, one core, for the scene that schemes are compared on; draws the curves.

ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx, L = 8π, g = γ = σ = 1, t = 2, operator (6). Errors are max|Δf|/max f against the closed form.
Checks that the observed order is 2 where it should be. Writes output/error_against_time.png.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import math
import sys
import warnings
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.timing import best
from kinetic_solver import Scene, exact, solve

SIZES: dict[float, tuple[int, tuple[float, float]]] = {0.3: (63, (-7.5, 7.5)), 2.0: (105, (-12.0, 8.0))}


def scene(number: float, grid: dict[str, Any], rtol: float = 1e-1) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
            "collisions": {"operator": "follow-the-leader", "cross_section": number},
            "pipe": {"length": 8 * math.pi},
            "initial": {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
            "run": {"end_time": 2.0},
            "accuracy": {"rtol": rtol},
            "output": {"moments": False, "budgets": False, "scalars": False},
            "grid": grid,
        }
    )


def measure(subject: Scene) -> tuple[float, float]:
    """(seconds, error)."""
    run = solve(subject).isel(time=-1)
    truth = exact.solve(subject, x=run["x"], v=run["v"]).isel(time=-1)
    return best(lambda: solve(subject), 5), float(abs(run["f"] - truth["f"]).max() / truth["f"].max())


def main() -> int:
    warnings.simplefilter("ignore")
    failed = False
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    for axes, (number, (nx, window)) in zip(figure.subplots(1, 2, sharey=True), SIZES.items(), strict=True):
        print(f"\nR* = {number:g}")
        series = {
            "exact kernel, nv = 256, steps vary": [
                {"nx": nx, "nv": 256, "velocity_window": window, "time_step": 2 / n, "drift_diffusion": "kernel"}
                for n in (20, 40, 80, 160)
            ],
            "finite volumes, 160 steps, nv varies": [
                {"nx": nx, "nv": nv, "velocity_window": window, "time_step": 2 / 160, "drift_diffusion": "finite-volume"}
                for nv in (64, 128, 256, 512)
            ],
        }
        for name, grids in series.items():
            points = [measure(scene(number, grid)) for grid in grids]
            _show(axes, name, points)
            order = math.log2(points[-2][1] / points[-1][1])
            failed |= "kernel" in name and not 1.9 < order < 2.1
        _show(axes, "everything from rtol", [measure(scene(number, {}, rtol)) for rtol in (1e-2, 1e-3, 1e-4, 1e-5)])
        axes.set(xscale="log", yscale="log", xlabel="seconds, one core", title=f"R* = {number:g}")
        axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    figure.axes[0].set_ylabel("max|Δf|/max f at t = 2")
    Path("output").mkdir(exist_ok=True)
    figure.savefig("output/error_against_time.png", dpi=120)
    print("\nwrote output/error_against_time.png")
    return int(failed)


def _show(axes: Any, name: str, points: list[tuple[float, float]]) -> None:
    seconds, errors = zip(*points, strict=True)
    axes.plot(seconds, errors, "o-", label=name)
    print(f"  {name:<38}" + "   ".join(f"{error:.2e} in {time:.4f} s" for time, error in points))


if __name__ == "__main__":
    sys.exit(main())
