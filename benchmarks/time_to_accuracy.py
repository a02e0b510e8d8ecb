"""The density's error against processor time, for particles and for the grid solver, on one core.

    python -m benchmarks.time_to_accuracy [docs/time_to_accuracy.png]

Large waves (40 % and 20 %) at R* = 1 until t = 2/γ, (6) and (12) with ε = 0.5. The error is the largest of the density's over
its mean, on 17 points; of particles the root mean square of it over seeds. Times are those of whole runs after compilation, the
best of three for the grid. Truth is the closed form for (6), the grid solver at rtol = 1e-9 for (12). Prints the table of
docs/compare_measured.md, asserts the particles' order 1/2 in time and that the grid keeps its rtol, and draws the picture.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np

from kinetic_solver import Scene, exact, solve
from particles import simulate

NX = 17
LENGTH = 9.0
RTOL = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
COUNTS = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
OPERATORS: dict[str, dict[str, Any]] = {
    "follow-the-leader": {"operator": "follow-the-leader", "cross_section": 1.0},
    "inelastic, ε = 0.5": {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5},
}


def scene(name: str, **changes: Any) -> Scene:
    data: dict[str, Any] = {
        "model": {"gravity": 1.0},
        "collisions": OPERATORS[name],
        "pipe": {"length": LENGTH},
        "initial": {"mean_velocity": 0.5, "temperature": 0.8, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
        "run": {"end_time": 2.0},
        "output": {"f": False, "scalars": False, "budgets": False},
    }
    return Scene.model_validate({**data, **changes})


def density(run: Any) -> np.ndarray:
    """At the end, on NX points: the waves that these hold."""
    values = run["density"].values[-1]
    return np.fft.irfft(np.fft.rfft(values, norm="forward")[: NX // 2 + 1], n=NX, norm="forward")


def truth(name: str) -> np.ndarray:
    if name == "follow-the-leader":
        return density(exact.solve(scene(name, grid={"nx": 129})))
    return density(solve(scene(name, accuracy={"rtol": 1e-9})))


def timed(run: Any) -> tuple[float, Any]:
    began = time.process_time()
    result = run()
    return time.process_time() - began, result


def measure(name: str) -> dict[str, list[tuple[float, float, float]]]:
    """Method → (parameter, seconds, error)."""
    expected = truth(name)
    found: dict[str, list[tuple[float, float, float]]] = {"grid": [], "particles": []}
    print(f"\n| {name} | | seconds | error of the density |\n|---|---|---|---|")
    for rtol in RTOL:
        chosen = scene(name, accuracy={"rtol": rtol})
        solve(chosen)
        seconds, run = min((timed(lambda chosen=chosen: solve(chosen)) for _ in range(3)), key=lambda pair: pair[0])
        error = float(np.abs(density(run) - expected).max())
        print(f"| grid | rtol = {rtol:g} | {seconds:.3g} | {error:.1e} |", flush=True)
        assert error < rtol * expected.max()
        found["grid"].append((rtol, seconds, error))
    simulate(scene(name, particles={"count": 1000, "replicas": 1}, grid={"nx": NX, "nv": 32}))
    for count in COUNTS:
        seeds = max(2, min(16, 2_000_000 // count))
        times, errors = [], []
        for seed in range(1, seeds + 1):
            chosen = scene(name, particles={"count": count, "seed": seed, "replicas": 1}, grid={"nx": NX, "nv": 32})
            seconds, run = timed(lambda chosen=chosen: simulate(chosen))
            times.append(seconds)
            errors.append(np.abs(density(run) - expected).max())
        error = float(np.sqrt(np.mean(np.square(errors))))
        print(f"| particles | N = {count:g}, {seeds} seeds | {min(times):.3g} | {error:.1e} |", flush=True)
        found["particles"].append((count, min(times), error))
    many = [(s, e) for n, s, e in found["particles"] if n >= 10_000]
    slope = np.polyfit(np.log([n for n, _, _ in found["particles"]]), np.log([e for _, _, e in found["particles"]]), 1)[0]
    print(f"\nparticles: error ∝ N^{slope:.2f}; an error of 1e-4 would take {many[-1][0] * (many[-1][1] / 1e-4) ** 2:.2g} s")
    assert -0.6 < slope < -0.4
    return found


Measured = list[tuple[str, str, float, float, float]]
"""Operator, method, parameter, seconds, error."""


def draw(rows: Measured, path: Path) -> None:
    from matplotlib.figure import Figure

    from kinetic_solver.analysis.drawing import BLUE, ORANGE

    figure = Figure(figsize=(7, 5.4), layout="constrained")
    axes = figure.subplots()
    for name, line in (("follow-the-leader", "-"), ("inelastic, ε = 0.5", "--")):
        for method, colour, mark in (("grid", BLUE, "o"), ("particles", ORANGE, "^")):
            seconds, errors = np.array([row[3:] for row in rows if row[:2] == (name, method)]).T
            fill = colour if name == "follow-the-leader" else "w"
            label = f"{method}, {name}"
            axes.loglog(seconds, errors, line, marker=mark, ms=6, mfc=fill, color=colour, label=label)
    axes.set_xlabel("seconds of processor time, one core")
    axes.set_ylabel("largest error of the density over its mean")
    axes.set_title("grid: rtol from 1e-2 to 1e-8;  particles: N from 10³ to 10⁷", fontsize=11)
    figure.legend(loc="outside lower center", ncols=2, fontsize=9, frameon=False)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    print(f"wrote {path}")


def main() -> None:
    numba.set_num_threads(1)
    results = {name: measure(name) for name in OPERATORS}
    rows = [(name, method, *point) for name, found in results.items() for method, points in found.items() for point in points]
    draw(rows, Path(sys.argv[1] if len(sys.argv) > 1 else "time_to_accuracy.png"))
    for methods in results.values():
        best_particles = min(e for _, _, e in methods["particles"])
        grid = min(s for _, s, e in methods["grid"] if e <= best_particles)
        longest = max(s for _, s, _ in methods["particles"])
        ratio = longest / grid
        print(f"error {best_particles:.1e}: grid {grid:.3g} s, particles {longest:.3g} s, {ratio:.3g} times as long")
        assert math.isfinite(ratio)


if __name__ == "__main__":
    main()
