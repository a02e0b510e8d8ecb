"""Work-precision: max|Δf|/max f at t = 2 against seconds of processor time after compilation, one core, per scheme.

ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx, L = 8π, g = γ = σ = 1. Operator (6) at R* = 0.3, 2, 5, from the homogeneous state's (u, θ),
"a", and from u0 = u_h + 1, θ0 = 0.5σ, "b", against the closed form. Operator (12) with ε = 0.5, Sρ = 10, from the homogeneous
state, against a run with a collision operator of its own (`FourierInelastic`, spectrally accurate in v; another, 75 × 155
with 320 steps, differed by 3e-10), which two runs of the product, extrapolated in dv, confirm.
Timed is the stepping from a prepared state, on grids chosen by hand, and the whole `solve` with everything chosen from rtol.
Tables: building the stepper, and what its first run takes longer than later ones.
Fails where a floor is missed: an error that some scheme of a family must reach within a time. Writes
output/work_precision.csv, and from it output/work_precision.png.
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
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.collision_operator import double_loop
from benchmarks.timing import best
from kinetic_solver import Scene, exact, solve
from kinetic_solver.analysis.drawing import BLUE, GREEN, GREY, ORANGE
from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy, SceneError, SolverStopped, StepTooSmall
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import initial_state
from kinetic_solver.operators.collisions import Inelastic
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.plan import make_plan
from kinetic_solver.solver.representation import make_representation
from kinetic_solver.solver.scheme import make_stepper
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stepping import Extrapolated, Fixed, Stepper, advance, lawson
from kinetic_solver.threads import one_blas_thread

END = 2.0
INELASTIC = {"operator": "inelastic", "cross_section": 10.0, "restitution": 0.5}
Grids = Iterable[tuple[int, int, float, float, int]]
"""nx, nv, window, steps."""

LINEARISED: dict[tuple[float, str], Grids] = {
    (0.3, "a"): ((35, 20, -4.5, 5.3, 1), (45, 24, -5.4, 6.3, 1), (49, 30, -6.6, 7.4, 1), (63, 37, -7.3, 8.1, 1)),
    (0.3, "b"): ((35, 29, -4.1, 6, 1), (45, 34, -5, 7, 1), (49, 42, -6.2, 8.2, 1), (63, 52, -7, 9, 1)),
    (2.0, "a"): ((75, 29, -10, 4.2, 2), (105, 33, -11, 5, 2), (135, 36, -12, 6, 2), (175, 42, -13, 7, 2), (189, 47, -13, 7, 2)),
    (2.0, "b"): ((81, 38, -9, 4.6, 2), (105, 43, -10, 5, 2), (135, 49, -11, 6, 2), (175, 55, -12, 7, 2), (189, 60, -12, 7, 2)),
    (5.0, "a"): ((135, 66, -20, 3.5, 4), (189, 80, -22, 4, 4), (225, 96, -22.6, 4.6, 4), (315, 110, -23.5, 5.6, 4)),
    (5.0, "b"): ((135, 76, -19, 4, 4), (189, 88, -20, 4.4, 4), (225, 100, -21.4, 4.8, 4), (315, 116, -22.4, 5.7, 4)),
}
HERMITE: dict[tuple[float, str], Grids] = {
    (0.3, "a"): ((27, 12, -5, 6, 1), (35, 18, -5, 6, 1), (45, 24, -5, 6, 1), (45, 33, -5, 6, 1)),
    (0.3, "b"): ((35, 26, -5, 6, 1), (45, 40, -5, 6, 1), (45, 56, -5, 6, 1), (63, 84, -5, 6, 1)),
    (2.0, "a"): ((63, 20, -5, 4, 1), (75, 28, -5, 4, 1), (105, 36, -5, 4, 1), (125, 44, -5, 4, 1)),
    (2.0, "b"): ((63, 32, -5, 4, 1), (81, 48, -5, 4, 1), (105, 64, -5, 4, 1), (125, 88, -5, 4, 1)),
    (5.0, "a"): ((135, 48, -9, 2, 1), (175, 56, -9, 2, 1), (225, 66, -9, 2, 1)),
    (5.0, "b"): ((135, 64, -9, 2, 4), (175, 80, -9, 2, 4), (225, 120, -9, 2, 4)),
}
QUADRATURE: dict[float, Grids] = {
    0.3: ((35, 40, -4.5, 6.5, 1), (45, 52, -5.5, 7.5, 2), (45, 64, -6, 8, 3), (45, 72, -6.5, 8.5, 4), (63, 104, -7, 9, 8)),
    2.0: ((81, 64, -9.5, 4.3, 4), (105, 85, -10.5, 5, 6), (125, 105, -11, 6, 8), (125, 132, -12, 6, 10), (175, 205, -12, 6, 16)),
    5.0: ((175, 320, -22, 4, 32), (175, 320, -22, 4, 48), (225, 320, -22, 4, 64)),
}  # fmt: skip
STRANG: dict[float, Grids] = {
    0.3: ((35, 40, -4.5, 6.5, 8), (35, 48, -5, 7, 32), (45, 64, -5.5, 7.5, 128), (45, 96, -6, 8, 512)),
    2.0: ((81, 64, -9.5, 4.3, 32), (81, 80, -10, 4.6, 128), (105, 105, -10.5, 5, 512)),
    5.0: ((135, 240, -18, 4, 200), (175, 240, -18, 4, 800)),
}
FINITE_VOLUME: dict[float, Grids] = {
    0.3: ((35, 48, -4.5, 6.5, 8), (35, 128, -4.5, 6.5, 24), (35, 384, -4.5, 6.5, 80)),
    2.0: ((81, 128, -9.5, 4.3, 48), (81, 256, -9.5, 4.3, 96), (81, 768, -9.5, 4.3, 240)),
    5.0: ((135, 512, -18, 4, 200),),
}
LAWSON: dict[str, Grids] = {
    "linear": ((35, 64, -1.8, 3.8, 16), (35, 128, -2.2, 4.2, 24), (35, 256, -2.4, 4.4, 36)),
    "cubic": ((35, 56, -2, 4, 20), (35, 80, -2.4, 4.4, 32), (35, 140, -2.7, 4.7, 48)),
    "quintic": (
        (35, 48, -2, 4, 20), (35, 60, -2.4, 4.4, 32), (35, 78, -2.6, 4.6, 52), (45, 128, -3, 5, 80), (49, 220, -3.4, 5.4, 144),
    ),
}  # fmt: skip
LAWSON_HERMITE: Grids = ((35, 32, -3, 5, 96), (35, 64, -3, 5, 96), (35, 96, -3, 5, 128))
STRANG_INELASTIC: Grids = ((35, 48, -2, 4, 64), (35, 64, -2.4, 4.4, 256), (35, 72, -2.5, 4.5, 1024))
RTOL: dict[str, tuple[float, ...]] = {"(6)": tuple(10.0**-n for n in range(2, 11)), "(12)": (1e-2, 1e-3, 1e-4)}


@dataclass(frozen=True)
class Floor:
    problem: str
    schemes: tuple[str, ...]
    error: float
    seconds: float
    tables: float = math.inf


EXACT_SCHEMES = ("linearised, global gauge", "linearised, local gauge", "linearised, Hermite")
LAWSON_SCHEMES = ("Lawson, linear deposit", "Lawson, cubic deposit", "Lawson, quintic deposit", "Lawson, Hermite")
FLOORS = (
    Floor("(6) R* = 0.3, a", EXACT_SCHEMES, 1e-12, 2e-3, 0.05),
    Floor("(6) R* = 2, a", EXACT_SCHEMES, 1e-11, 2e-3, 0.1),
    Floor("(6) R* = 5, a", EXACT_SCHEMES, 1e-7, 20e-3, 1.0),
    Floor("(6) R* = 0.3, a", ("extrapolated Strang",), 1e-8, 20e-3),
    Floor("(6) R* = 2, a", ("extrapolated Strang",), 1e-6, 0.1),
    Floor("(6) R* = 5, a", ("extrapolated Strang",), 1e-6, 5.0),
    Floor("(12)", LAWSON_SCHEMES, 1e-6, 0.2),
    Floor("(12)", LAWSON_SCHEMES, 1e-8, 5.0),
)


def scene(operator: float | dict[str, Any], grid: dict[str, Any] | None = None, start: str = "a", rtol: float = 1e-6) -> Scene:
    """Operator (6) where a cross-section is given. Start "a": the homogeneous state's (u, θ); "b": another."""
    if isinstance(operator, float):
        operator = {"operator": "follow-the-leader", "cross_section": operator}
    made = Scene.model_validate(
        {
            "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
            "collisions": operator,
            "pipe": {"length": 8 * math.pi},
            "initial": {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
            "run": {"end_time": END},
            "accuracy": {"rtol": rtol},
            "output": {"moments": False, "budgets": False, "scalars": False},
            "grid": grid or {},
        }
    )
    if start == "a":
        return made
    state = homogeneous_state(made)
    assert state is not None
    return made.model_copy(
        update={"initial": made.initial.model_copy(update={"mean_velocity": state.mean_velocity + 1, "temperature": 0.5})}
    )


@dataclass(frozen=True)
class Case:
    """One scheme on one grid."""

    problem: str
    scheme: str
    scene: Scene
    gauge: float | None = None
    """The linearised step's tolerance: 0 makes its gauge local, infinity global."""
    whole: bool = False
    """Time `solve`, not the stepping."""


@dataclass(frozen=True)
class Point:
    case: Case
    size: str
    seconds: float
    tables: float
    error: float


Truth = Callable[[Scene, Array, Array], Array]


def closed_form(subject: Scene, x: Array, v: Array) -> Array:
    return exact.Solution(subject, END).distribution(x, v)


def afresh(stepper: Stepper, state: Array) -> Array:
    """The state at t = 2. Of earlier calls a stepper keeps its tables, and nothing else."""
    return advance(stepper, state, 0.0, END)


def least(call: Callable[[], Any], patience: float) -> float:
    """Seconds: the least of 1 to 20 calls that take about `patience` in all."""
    times: list[float] = []
    while not times or (len(times) < 20 and sum(times) + times[-1] < patience):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def measure(case: Case, truth: Truth, patience: float = 0.5) -> Point:
    plan = make_plan(case.scene)
    grid = plan.grid
    if case.whole:
        run = solve(case.scene)["f"].isel(time=-1)
        seconds = least(lambda: solve(case.scene), patience)
        exact_f = truth(case.scene, run["x"].values, run["v"].values)
        size = f"rtol {case.scene.accuracy.rtol:.0e}: {grid.nx} × {grid.nv}"
        return Point(case, size, seconds, 0.0, float(np.abs(run.to_numpy() - exact_f).max() / exact_f.max()))
    with one_blas_thread():
        began = time.process_time()
        representation = make_representation(plan)
        stepper = make_stepper(plan, representation)
        if case.gauge is not None:
            stepper.exact.tolerance = case.gauge  # type: ignore[attr-defined]
        build = time.process_time() - began
        start = representation.start()
        began = time.process_time()
        state = afresh(stepper, start)
        first = time.process_time() - began
        seconds = least(lambda: afresh(stepper, start), patience)
    exact_f = truth(case.scene, grid.x, grid.v)
    error = float(np.abs(representation.points(state) - exact_f).max() / exact_f.max())
    size = f"{grid.nx} × {grid.nv} × {round(END / case.scene.grid.time_step)}"  # type: ignore[operator]
    return Point(case, size, seconds, build + max(0.0, first - seconds), error)


class FourierInelastic:
    """Operator (12) by Fourier series in v, Ĉ_n = Σ_l β_ln f̂_l f̂_(n-l), from the weak form: spectrally accurate.

    Pairs up to `reach` apart collide: f must vanish outside a part of the window that is no wider than the window less that.
    """

    def __init__(self, grid: PhaseSpaceGrid, cross_section: float, restitution: float, reach: float) -> None:
        n, period = grid.nv, grid.high - grid.low
        mode = np.fft.fftfreq(n, 1 / n)
        q, partner = 2 * np.pi / period * mode, mode[None, :] - mode[:, None]
        total, alpha = q[None, :], (1 - restitution) / 2

        def moment(k: Array) -> Array:
            """∫|r| exp(ikr) dr over |r| < reach."""
            z = np.where(k == 0, 1.0, k * reach)
            return np.where(k == 0, 1.0, 2 * np.sin(z) / z - 4 * (np.sin(z / 2) / z) ** 2) * reach**2

        gain = moment(q[:, None] - alpha * total) + moment(q[:, None] - (1 - alpha) * total)
        beta = period * cross_section / 2 * (gain - moment(q[:, None] - total) - moment(q[:, None] + 0 * total))
        self._beta = np.where(np.abs(partner) <= n // 2, beta, 0.0) / (period * n)
        self._partner = np.round(partner).astype(int) % n

    def rate(self, f: Array) -> Array:
        n = f.shape[1]
        spectrum = np.ascontiguousarray(np.fft.fft(f, axis=1).T)
        out = np.empty((n // 2 + 1, f.shape[0]), dtype=complex)
        for m in range(out.shape[0]):
            out[m] = np.einsum("l,lx,lx->x", self._beta[:, m], spectrum, spectrum[self._partner[:, m]])
        return np.fft.irfft(out.T, n=n, axis=1)


def inelastic_truth() -> tuple[Truth, float]:
    """f at t = 2 for any points, and how far the product is from it: two quintic runs, extrapolated to dv = 0 by dv⁶."""
    subject = scene(INELASTIC)
    grid = PhaseSpaceGrid(63, 127, subject.pipe.length, -8.0, 10.0)
    operator = FourierInelastic(grid, 10.0, 0.5, 9.0)
    linear = LinearStep(grid, subject.model, OrnsteinUhlenbeckKernel(grid, subject.model))
    method = Extrapolated(lawson(operator.rate, linear), (1, 2))
    with one_blas_thread():
        f = afresh(Fixed(method, END / 256), initial_state(subject, grid))
    modes = np.fft.fftshift(np.fft.fft2(f)) / f.size
    m, n = (np.arange(-(count // 2), count // 2 + 1) for count in f.shape)

    def truth(scene: Scene, x: Array, v: Array) -> Array:
        along_x = np.exp(2j * np.pi / grid.length * np.outer(x, m))
        return np.asarray((along_x @ modes @ np.exp(2j * np.pi / 18.0 * np.outer(n, v - grid.v[0]))).real)

    coarse, fine = (product_run(scene(INELASTIC, inelastic_grid("quintic", 49, nv, -3.4, 5.4, 192))) for nv in (135, 225))
    points = PhaseSpaceGrid(49, 45, grid.length, -3.4, 5.4)  # centres of 45 cells are centres of 135 and of 225
    coarse, fine = coarse[:, 1::3], fine[:, 2::5]
    extrapolated = fine + (fine - coarse) / ((225 / 135) ** 6 - 1)
    reference = truth(subject, points.x, points.v)
    return truth, float(np.abs(extrapolated - reference).max() / reference.max())


def product_run(subject: Scene) -> Array:
    plan = make_plan(subject)
    representation = make_representation(plan)
    with one_blas_thread():
        return representation.points(afresh(make_stepper(plan, representation), representation.start()))


def of_size(nx: int, nv: int, low: float, high: float, steps: int) -> dict[str, Any]:
    return {"nx": nx, "nv": nv, "velocity_window": (low, high), "time_step": END / steps}


def inelastic_grid(deposit: str, *size: Any) -> dict[str, Any]:
    return {**of_size(*size), "deposit": deposit, "stepping": "extrapolated"}


def cases() -> dict[str, list[Case]]:
    """Per problem."""
    out: dict[str, list[Case]] = {}
    for (number, start), grids in LINEARISED.items():
        problem = f"(6) R* = {number:g}, {start}"
        series: list[tuple[str, dict[str, Any], Grids, float | None]] = [
            ("linearised, global gauge", {}, grids, math.inf),
            ("linearised, local gauge", {}, grids, 0.0),
            ("linearised, Hermite", {"velocity": "hermite"}, HERMITE[number, start], math.inf),
            ("extrapolated Strang", {"stepping": "extrapolated"}, QUADRATURE[number], None),
            ("Strang, exact kernel", {"stepping": "strang"}, STRANG[number], None),
            ("Strang, finite volumes 2", {"stepping": "strang", "drift_diffusion": "finite-volume"}, FINITE_VOLUME[number], None),
        ]
        out[problem] = [
            Case(problem, scheme, scene(number, {**of_size(*size), **options}, start), gauge)
            for scheme, options, sizes, gauge in series
            for size in sizes
        ]
        out[problem] += [Case(problem, "solve, from rtol", scene(number, None, start, r), whole=True) for r in RTOL["(6)"]]
    problem = "(12)"
    here = [(f"Lawson, {deposit} deposit", inelastic_grid(deposit, *size)) for deposit, sizes in LAWSON.items() for size in sizes]
    here += [("Lawson, Hermite", {**of_size(*size), "velocity": "hermite"}) for size in LAWSON_HERMITE]
    here += [("Strang, quintic deposit", {**of_size(*s), "stepping": "strang", "deposit": "quintic"}) for s in STRANG_INELASTIC]
    out[problem] = [Case(problem, scheme, scene(INELASTIC, grid)) for scheme, grid in here]
    out[problem] += [Case(problem, "solve, from rtol", scene(INELASTIC, None, rtol=r), whole=True) for r in RTOL["(12)"]]
    return out


def warm_up() -> None:
    """Compiles, and plans nothing that is timed later."""
    for deposit in ("linear", "cubic", "quintic"):
        product_run(scene(INELASTIC, inelastic_grid(deposit, 15, 24, -2, 4, 16)))
    for options in ({}, {"stepping": "strang"}, {"velocity": "hermite"}):
        product_run(scene(0.3, {**of_size(15, 24, -5, 6, 1), **options}))
    solve(scene(0.3, of_size(15, 24, -5, 6, 1)))


def met(floor: Floor, points: list[Point], truth: dict[str, Truth]) -> bool:
    """Prints; points that are exact enough and too slow are timed again, since other work disturbs the clock."""
    near = [p for p in points if p.case.problem == floor.problem and p.case.scheme in floor.schemes and p.error <= floor.error]
    wanted = f"{floor.problem:<16} {floor.error:.0e} in {floor.seconds * 1e3:6.0f} ms, {floor.schemes[0].split(',')[0]}"
    if not near:
        print(f"MISSED  {wanted}: no point is exact enough")
        return False
    for attempt in range(5):
        point = min(near, key=lambda p: (p.seconds > floor.seconds) + (p.tables > floor.tables) + p.seconds)
        if (good := point.seconds <= floor.seconds and point.tables <= floor.tables) or attempt == 4:
            break
        new = measure(point.case, truth[floor.problem], patience=3.0)
        better = replace(point, seconds=min(point.seconds, new.seconds), tables=min(point.tables, new.tables))
        near[near.index(point)] = points[points.index(point)] = better
    print(
        f"{'met   ' if good else 'MISSED'}  {wanted}: {point.error:.1e} in {point.seconds * 1e3:.2f} ms, tables "
        f"{point.tables * 1e3:.0f} ms ({point.case.scheme}, {point.size})"
    )
    if floor.problem == "(12)":
        against_numpy(point)
    return good


def against_numpy(point: Point) -> None:
    """The same stepping with a plain NumPy collision operator: a linear deposit, whose loop costs no more than the others'."""
    subject = point.case.scene
    plan = make_plan(subject)
    if plan.deposit is None:
        return
    grid, f = plan.grid, initial_state(subject, plan.grid)
    evaluations = 12 * round(END / subject.grid.time_step)  # type: ignore[operator]
    ours = best(lambda: Inelastic(grid.v, 1.0, subject.restitution, str(plan.deposit)).rate(f), 5)
    columns = np.ascontiguousarray(f.T)
    loop = best(lambda: double_loop(columns, grid.v), 3)
    total = point.seconds + evaluations * (loop - ours)
    print(
        f"        with a NumPy double loop over velocities {total:.1f} s: {total / point.seconds:.0f} times as long "
        f"({evaluations} evaluations of {loop * 1e3:.2f} ms, ours {ours * 1e3:.3f} ms)"
    )


def main() -> int:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    began = time.perf_counter()
    warm_up()
    inelastic, agreement = inelastic_truth()
    print(f"(12): reference 63 × 127 Fourier modes, 256 steps; two quintic runs extrapolated to dv = 0 differ by {agreement:.1e}")
    failed = agreement > 5e-9
    truth: dict[str, Truth] = {}
    points: list[Point] = []
    for problem, group in cases().items():
        truth[problem] = inelastic if problem == "(12)" else closed_form
        print(f"\n{problem:<26} nx × nv × steps          stepping, ms   tables, ms     error", flush=True)
        for case in group:
            try:
                point = measure(case, truth[problem])
            except (SolverStopped, StepTooSmall, LostAccuracy, SceneError) as error:
                print(f"  {case.scheme:<24} rtol {case.scene.accuracy.rtol:.0e}: {error}")
                continue
            points.append(point)
            tables = f"{point.tables * 1e3:12.1f}" if not case.whole else f"{'':12}"
            print(f"  {case.scheme:<24} {point.size:<22} {point.seconds * 1e3:13.2f} {tables}   {point.error:.1e}", flush=True)
    print()
    for floor in FLOORS:
        failed |= not met(floor, points, truth)
    table = Path("output/work_precision.csv")
    write(points, table)
    draw(table, table.with_suffix(".png"))
    print(f"wrote {table} and {table.with_suffix('.png')}; {time.perf_counter() - began:.0f} s")
    return int(failed)


ASKED = "a floor: some scheme of this colour\nmust be below it, to its left"
FAMILIES = {"solve": GREY, "linearised": BLUE, "Lawson": GREEN, "": ORANGE}
"""Beginning of a scheme's name → colour: chosen by rtol, exact steps, Lawson's method; the others split."""
MARKERS = {"Hermite": "D", "local": "s", "cubic": "s", "exact": "s", "finite": "^", "linear ": "^", "": "o"}
"""Part of a scheme's name → mark, the same throughout a family's variants."""
STARTS = {"a": "from the homogeneous u, θ", "b": "from u_h + 1, θ = 0.5σ"}
COLUMNS = ("problem", "scheme", "grid", "seconds", "tables_seconds", "error")


def colour_of(scheme: str) -> str:
    return next(colour for start, colour in FAMILIES.items() if scheme.startswith(start))


def style(scheme: str) -> dict[str, Any]:
    """Few colours, one to a family of schemes, and marks within it; what splits is dashed and hollow, to be seen in grey too."""
    marker = next(mark for part, mark in MARKERS.items() if part in scheme)
    colour, splits = colour_of(scheme), colour_of(scheme) == FAMILIES[""]
    line = ":" if scheme.startswith("solve") else "--" if splits else "-"
    return {"color": colour, "marker": marker, "ls": line, "mfc": "w" if splits else colour}


def write(points: list[Point], path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows(
            (p.case.problem, p.case.scheme, p.size, f"{p.seconds:.6g}", f"{p.tables:.6g}", f"{p.error:.3g}") for p in points
        )


def draw(table: Path, picture: Path) -> None:
    """The picture of a table that `write` has written."""
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure = Figure(figsize=(15, 8.6), layout="constrained")
    panels = figure.subplots(2, 4, sharey=True)
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    problems.sort(key=lambda name: (name.endswith("b"), name.startswith("(12)")))
    schemes = sorted(dict.fromkeys(row["scheme"] for row in rows), key=lambda name: list(map(name.startswith, FAMILIES)))
    handles: dict[str, Any] = {}
    for axes, problem in zip(panels.flat, problems, strict=False):
        for scheme in schemes:
            here = [(float(r["seconds"]), float(r["error"])) for r in rows if (r["problem"], r["scheme"]) == (problem, scheme)]
            if here:
                (handles[scheme],) = axes.plot(*zip(*here, strict=True), ms=5, lw=1.2, **style(scheme))
        for floor in FLOORS:
            if floor.problem == problem:
                colour = colour_of(floor.schemes[0])
                axes.scatter(floor.seconds, floor.error, marker="*", s=150, color=colour, edgecolors="k", lw=0.7, zorder=3)
        name, _, start = problem.partition(", ")
        title = (
            f"follow-the-leader {name}\n{STARTS[start]}"
            if start
            else "inelastic (12), ε = 0.5, Sρ = 10\nfrom the homogeneous u, θ"
        )
        axes.set(xscale="log", yscale="log", ylim=(3e-16, 1), xlabel="seconds of processor time, one core")
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.3)
    for axes in panels[:, 0]:
        axes.set_ylabel("max|Δf|/max f at t = 2")
    handles[ASKED] = panels[-1, -1].scatter([], [], marker="*", s=150, color="w", edgecolors="k", lw=0.7)
    panels[-1, -1].axis("off")
    panels[-1, -1].legend(handles.values(), handles.keys(), loc="center", fontsize=8, frameon=False)
    figure.suptitle("Error against time: the lower and the further left, the better", fontsize=12)
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    sys.exit(main())
