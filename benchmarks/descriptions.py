"""Which description of the paper's system clusters, at which density; and what each costs for the same scene and error.

    python -m benchmarks.descriptions [limits] [cost]

Limits 2 s, cost a minute, on one core. Prints the tables of docs/hydrodynamics_details.md, asserts what is said of them, and
draws docs/descriptions.png. Units γ = σ = ρ̄ = 1, g = R*, pipe of L* = 8π."""

from __future__ import annotations

import math
import multiprocessing
import resource
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.hydrodynamics import row, scene_of, table
from benchmarks.sections import run_sections
from kinetic_solver import Scene, exact, hydrodynamics, solve, stability
from kinetic_solver.analysis.drawing import BLUE, GREY, ORANGE, plain_logs
from kinetic_solver.scene import INELASTIC
from kinetic_solver.stability.closure import critical_collision_number
from particles import simulate

MOMENTS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
COUNTS = (1000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000)
SEEN, MACROSCOPIC = 0.01, 1.0
"""S(k)/N at which waves are 20 % (rms), and at which linear theory ends."""
LONGEST = 0.25
"""k* of the pipe's longest wave."""

WAVES = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
END, TARGETS = 2.0, (1e-2, 1e-4)
"""γt at which errors are taken; of the density, root mean square over x, over ρ̄."""
POINTS = 64
"""Of the particles' density, of which waves up to 31 are kept."""


def limits() -> None:
    print("\nM moments: R* above which waves grow")
    table("M", "short waves", "k* = 1", f"k* = {LONGEST:g}")
    short, long = [], []
    for m in MOMENTS:
        cells = [critical_collision_number(k, m) for k in (math.inf, 1.0, LONGEST)]
        short.append(cells[0])
        long.append(cells[2])
        row(str(m), *(f"{value:.3f}" for value in cells))
    # The shortest waves of many moments are no longer resolved beside the longest in double precision, so those end earlier
    assert np.all(np.diff(short) > 0)
    print("\nN particles: R* above which S(k)/N at the longest wave is")
    table("N", f"{SEEN:g} (waves of 20 %)", f"{MACROSCOPIC:g} (end of linear theory)")
    scene = scene_of(1.0)
    noise = [[stability.apparent_critical_density(scene, n, 1, level) for n in COUNTS] for level in (SEEN, MACROSCOPIC)]
    for n, *levels in zip(COUNTS, *noise, strict=True):
        row(f"{n:.0e}", *(f"{level:.3f}" for level in levels))
    assert np.all(np.diff(noise, axis=1) > 0)

    print("\nThe kinetic equation and the closure with (12): largest Re s over R* = 0.1 … 100 and modes 1 … 32")
    rates = [stability.kinetic_rates(scene_of(r), n)[0][0].real for r in (0.1, 1, 2, 10, 100) for n in (1, 8, 32)]
    print(f"(2) with (6): {max(rates):.4f} (-k*², at every density)")
    inelastic = [stability.closure_rates(scene_of(r, INELASTIC), n)[0].real for r in (0.1, 1, 2, 10, 100) for n in (1, 8, 32)]
    print(f"closure with (12), ε = 0.5: {max(inelastic):.1e}")
    assert max(rates) < 0
    assert max(inelastic) < 0
    save_figure(short, long, noise)


def save_figure(short: list[float], long: list[float], noise: list[list[float]]) -> None:
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(MOMENTS, short, "o-", color=ORANGE, label="short waves")
    left.plot(MOMENTS, long, "s-", color=BLUE, label="the longest wave, k* = 1/4")
    left.annotate("the paper's closure", (3, short[0]), (4.3, 1.08), color=GREY, arrowprops={"arrowstyle": "-", "color": GREY})
    left.set(xscale="log", yscale="log", xlabel="moments M", ylabel="clusters above this collision number R*", ylim=(1, 60))
    left.set_title("Moments: linearly unstable above the line", fontsize=11)
    right.plot(COUNTS, noise[1], "o-", color="black", label="as large as the mean: S(k)/N = 1")
    right.plot(COUNTS, noise[0], "s-", color="0.55", label="20 % of the mean: S(k)/N = 0.01")
    right.set(xscale="log", xlabel="particles N")
    right.set_title("Particles: amplified noise above the line, no instability", fontsize=11)
    for axes in (left, right):
        axes.legend(frameon=False, loc="upper left")
        plain_logs(axes.yaxis, 1.5)
        axes.grid(alpha=0.25)
    left.set_xticks([3, 4, 6, 8, 16, 32, 64], ["3", "4", "6", "8", "16", "32", "64"])
    left.minorticks_off()
    plain_logs(right.xaxis, 5)
    figure.suptitle(
        "With more moments or particles the line rises without end: the kinetic equation, their limit, has none", fontsize=12
    )
    figure.savefig("docs/descriptions.png", dpi=150)


# -- cost


def scene_with(number: float, **changes: Any) -> Scene:
    output = {"f": False, "budgets": False, "scalars": False}
    return scene_of(number, initial=WAVES, run={"end_time": END}, output=output, **changes)


def by_closure(number: float, knob: float) -> tuple[np.ndarray, np.ndarray]:
    run = hydrodynamics.solve(scene_with(number, accuracy={"rtol": knob}))
    return run["x"].values, run["density"].values[-1]


def by_moments(number: float, knob: float) -> tuple[np.ndarray, np.ndarray]:
    run = hydrodynamics.solve(scene_with(number, hydrodynamics={"moments": int(knob)}, accuracy={"rtol": 1e-5}))
    return run["x"].values, run["density"].values[-1]


def by_grid(number: float, knob: float) -> tuple[np.ndarray, np.ndarray]:
    run = solve(scene_with(number, accuracy={"rtol": knob}))
    return run["x"].values, run["density"].values[-1]


def by_closed_form(number: float, knob: float) -> tuple[np.ndarray, np.ndarray]:
    run = exact.solve(scene_with(number))
    return run["x"].values, run["density"].values[-1]


def by_particles(number: float, knob: float) -> tuple[np.ndarray, np.ndarray]:
    run = simulate(scene_with(number, particles={"count": int(knob), "replicas": 1}, grid={"nx": POINTS}))
    return run["x"].values, run["density"].values[-1]


Method = Callable[[float, float], tuple[np.ndarray, np.ndarray]]
METHODS: dict[str, tuple[Method, str, tuple[float, ...]]] = {
    "closure (3)-(5)": (by_closure, "rtol", (1e-1, 1e-2, 1e-3, 1e-4)),
    "M moments": (by_moments, "M", (3, 4, 6, 8, 10, 12, 16)),
    "grid": (by_grid, "rtol", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)),
    "closed form": (by_closed_form, "", (0,)),
    "particles": (by_particles, "N", (1e4, 1e5, 1e6)),
}


def error(number: float, x: np.ndarray, density: np.ndarray) -> float:
    truth = exact.Solution(scene_with(number), END).moments(x)[0]
    return float(np.sqrt(np.mean((density - truth) ** 2)))


def memory() -> float:
    """Largest so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measured(work: tuple[str, float, float]) -> tuple[float, float, float]:
    """(error, seconds: the best of three, MB above what the first small run took) in a process of its own."""
    warnings.simplefilter("ignore")
    name, number, knob = work
    method, _, knobs = METHODS[name]
    method(number, knobs[0])
    began_with = memory()
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        x, density = method(number, knob)
        seconds.append(time.perf_counter() - began)
    return error(number, x, density), min(seconds), memory() - began_with


def cost() -> None:
    for number in (0.5, 2.0):
        print(f"\nR* = {number:g}, waves of 50 % and 20 %, γt = {END:g}: least work for an error of the density (rms over ρ̄)")
        table("", *(f"{target:g}: with; error; seconds; MB more" for target in TARGETS))
        for name, (_, word, knobs) in METHODS.items():
            cells, found = [], []
            with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
                for knob in knobs:
                    found.append((knob, *pool.apply(measured, ((name, number, knob),))))
                    if found[-1][1] <= min(TARGETS):
                        break
            for target in TARGETS:
                good = [f for f in found if f[1] <= target]
                if good:
                    knob, wrong, seconds, more = good[0]
                    with_ = f"{word} = {knob:g}; {wrong:.1e}" if word else "–; –"
                    cells.append(f"{with_}; {seconds:.3f}; {more:.0f}")
                elif name == "particles":
                    needed = found[-1][0] * (found[-1][1] / target) ** 2
                    last = f"N = {found[-1][0]:.0e}: {found[-1][1]:.1e}; {found[-1][2]:.2f}; {found[-1][3]:.0f}"
                    cells.append(f"N = {needed:.0e}, from {last}")
                else:
                    cells.append(f"never: {found[-1][1]:.1e}")
            row(name, *cells)


SECTIONS = {"limits": limits, "cost": cost}


def main() -> None:
    run_sections(SECTIONS)


if __name__ == "__main__":
    main()
