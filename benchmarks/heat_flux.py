"""The third moment that the paper's closure drops, measured in solutions of (2) with (6): where it is small, and where it is not.

    python -m benchmarks.heat_flux

Three seconds. Prints the tables of docs/hydrodynamics_measured.md, asserts what is said of them, and draws docs/heat_flux.png.
With the heat flux q = ∫(v - u)³ f dv kept, (5) has two more terms than the paper's: -(1/ρ)∂q/∂x, and -Sq, since (9) holds for q
= 0 only. Units γ = σ = ρ̄ = 1, and g = R*, so that the homogeneous state is at rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from benchmarks.hydrodynamics import row, scene_of, table
from kinetic_solver import solve
from kinetic_solver.analysis.drawing import ORANGE, plain_logs, shades
from kinetic_solver.scene import Scene
from kinetic_solver.stability.closure import critical_collision_number

NUMBERS = (0.2, 0.5, 1.0, 1.347, 2.0, 3.0)
WAVENUMBERS = (0.1, 0.25, 0.5, 1.0, 2.0)
AMPLITUDE = 1e-4
"""Of an eigenmode, over ρ̄: f stays positive, and what is quadratic is 1e-4 of the rest."""
BOX = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2.5}
TIMES = (0.5, 2.0, 5.0)
"""γt at which large waves are looked at."""


def expected(wavenumber: float, number: float) -> float:
    """Neglected over kept in the slowest eigenmode: k*√(k*² + R*²)/2 (docs/hydrodynamics_measured.md)."""
    return wavenumber * math.hypot(wavenumber, number) / 2


def shares(run: xr.Dataset, time: float) -> tuple[float, float, float]:
    """(heat-flux term, collision term, both) at the frame nearest to `time`, as root mean squares over x, over the larger one of
    the terms that the closure keeps: compression, and friction with noise."""
    frame = run.sel(time=time, method="nearest")

    def size(*terms: str) -> float:
        total = sum(frame[f"temperature_rate_{term}"].values for term in terms)
        return float(np.sqrt(np.mean(np.square(total))))

    kept = max(size("compression"), size("friction", "noise"))
    return size("heat_flux") / kept, size("collisions") / kept, size("heat_flux", "collisions") / kept


def wave(number: float, wavenumber: float, end: float, rtol: float, **start: Any) -> Scene:
    """One wave of the pipe's own length."""
    output = {"f": False, "budgets": False, "scalars": False, "moments": True, "moment_equations": True}
    return scene_of(
        number,
        length=2 * math.pi / wavenumber,
        initial=start,
        output=output,
        run={"end_time": end, "output_every": end if end < 1 else 0.5},
        accuracy={"rtol": rtol},
    )


def eigenmodes() -> dict[tuple[float, float], float]:
    print("\nNeglected over kept terms of (5), slowest eigenmode: measured (closed form)")
    table("R*", *(f"k* = {k:g}" for k in WAVENUMBERS))
    found = {}
    for number in NUMBERS:
        cells = []
        for k in WAVENUMBERS:
            scene = wave(number, k, 0.2, 1e-8, eigenmodes=[{"mode": 1, "cos": AMPLITUDE}])
            heat, collisions, both = shares(solve(scene), 0.2)
            found[number, k] = both
            cells.append(f"{both:.4f} ({expected(k, number):.4f})")
            for measured, theory in ((heat, k * k / 2), (collisions, k * number / 2), (both, expected(k, number))):
                assert abs(measured / theory - 1) < 2e-3, (number, k, measured, theory)
        row(f"{number:g}", *cells)
    return found


def large_waves() -> dict[tuple[float, float], float]:
    print("\nThe same from a Maxwellian with a density wave of 50 %, at γt =", ", ".join(f"{t:g}" for t in TIMES))
    table("R*", *(f"k* = {k:g}" for k in WAVENUMBERS))
    found = {}
    for number in NUMBERS:
        cells = []
        for k in WAVENUMBERS:
            run = solve(wave(number, k, TIMES[-1], 1e-5, modes=[{"mode": 1, "cos": 0.5}]))
            both = [shares(run, t)[2] for t in TIMES]
            found[number, k] = both[1]
            cells.append("; ".join(f"{value:.3f}" for value in both))
        row(f"{number:g}", *cells)
    return found


def save_figure(small: dict[tuple[float, float], float], large: dict[tuple[float, float], float], path: str) -> None:
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    k = np.geomspace(0.08, 2.5, 80)
    for number, colour in zip(NUMBERS, shades(len(NUMBERS)), strict=True):
        left.plot(k, [expected(float(q), number) for q in k], color=colour, lw=1.5, label=f"R* = {number:g}")
        left.plot(WAVENUMBERS, [small[number, q] for q in WAVENUMBERS], "o", color=colour, ms=5)
        left.plot(WAVENUMBERS, [large[number, q] for q in WAVENUMBERS], "x", color=colour, ms=6)
    left.axhline(1, color="0.6", lw=0.8)
    left.plot([], [], "o", color="0.4", label="measured, eigenmode")
    left.plot([], [], "x", color="0.4", label="measured, wave of 50 %, γt = 2")
    left.set(xscale="log", yscale="log", xlabel="wavenumber k*", ylabel="neglected over kept terms of (5)")
    left.set_title("Lines: k*√(k*² + R*²)/2", fontsize=11)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    right.set(xscale="log", yscale="log", xlabel="wavenumber k*", ylabel="collision number R*")
    k, number = np.geomspace(0.05, 10, 120), np.geomspace(0.1, 6, 120)
    ratio = k * np.hypot(k, number[:, None]) / 2
    levels = [0.01, 0.03, 0.1, 0.3, 1, 3, 10]
    right.contourf(k, number, np.log10(ratio), np.log10(levels), cmap="Blues", vmin=-2.2, vmax=2.6, extend="both")
    lines = right.contour(k, number, ratio, levels, colors="0.35", linewidths=0.8)
    right.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=9)
    critical = [critical_collision_number(float(q)) for q in k]
    right.plot(k, critical, color="w", lw=5)
    right.plot(k, critical, color=ORANGE, lw=2.5)
    right.annotate("the closure is unstable\nabove this line", (0.9, 2.1), color="k", fontsize=11, bbox=BOX)
    right.set_ylim(0.1, 6)
    right.set_title("Neglected over kept terms of (5), slowest eigenmode", fontsize=11)
    for axes in (left, right):
        plain_logs(axes.xaxis, 1.5)
        plain_logs(axes.yaxis, 1.5)
    figure.savefig(path, dpi=150)


def main() -> None:
    save_figure(eigenmodes(), large_waves(), "docs/heat_flux.png")


if __name__ == "__main__":
    main()
