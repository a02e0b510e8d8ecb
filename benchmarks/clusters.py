"""When particles cluster, when the equations do: contrast of the density and w(v), by direct simulation and in single file.

    python -m benchmarks.clusters [direct] [files] [inelastic] [equation]

All sections by default. Processor time, shared by as many processes as there are cores: direct 23 minutes, files 11, inelastic 4,
equation 0.1. Prints the tables of docs/clusters_measured.md and asserts what they say; `direct` draws docs/clusters.png. Replica
r is the run of seed r.
"""

from __future__ import annotations

import dataclasses
import math
import multiprocessing
import os
from collections.abc import Sequence

import numba
import numpy as np
from matplotlib.figure import Figure

from benchmarks.sections import run_sections
from kinetic_solver import Scene, exact, solve, stability
from kinetic_solver.analysis.paper_figures import (
    BINS,
    LENGTH,
    RESTITUTION,
    contrast_in_words,
    expected_contrast,
    figure_scene,
    gaussian,
    two_populations,
)
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Mode
from kinetic_solver.stability.homogeneous import homogeneous_state
from particles.plan import make_plan
from particles.simulation import Simulation
from particles.single_file import sticking

NUMBERS = (0.5, 1.0, 1.347, 2.0, 3.0, 4.0)
COUNTS = (1000, 10_000, 100_000, 1_000_000)
DV = 0.25
V = DV * (np.arange(113) - 64)
"""Centres of the bins of w, from u_h - 16 to u_h + 12: contain all particles of these runs to 1e-3."""
CLUSTER = 1.5
"""Bins denser than this many times the mean are counted as clusters."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One row of a table; averages over the times `start` + 1, …, `end`."""

    number: float
    count: int
    start: int
    end: int
    replicas: int
    operator: str = FOLLOW_LEADER
    single_file: bool = False
    time_step: float | None = None
    refined: int = 1
    """Cells that much narrower than a quarter of the mean free path."""

    def scene(self, seed: int = 1) -> Scene:
        scene = figure_scene(3, self.operator, self.count, seed)
        collisions = scene.collisions.model_copy(update={"cross_section": self.number})
        # Also where few particles are in each: cells as wide as two mean free paths would add to the contrast
        cells = None if self.single_file else self.refined * math.ceil(4 * LENGTH * max(self.number, 1.0))
        kind = "single-file" if self.single_file else "dsmc"
        changes = {"cells": cells, "time_step": self.time_step, "collisions": kind}
        particles = scene.particles.model_copy(update=changes)
        return Scene.model_validate(scene.model_copy(update={"collisions": collisions, "particles": particles}).model_dump())

    @property
    def cost(self) -> float:
        """Roughly, for the order of work."""
        return self.end * self.count * (self.count / 1e4 if self.single_file else 1) * max(self.number, 0.5)


QUANTITIES = (
    *("contrast²", "max", "mean", "variance", "skewness", "a2", "clusters"),
    *("gaussian", "two", "local", "equation", "floor"),
    *("dense share", "dense density", "dense mean", "dense variance", "thin density", "thin mean", "thin variance"),
)


def sample(scene: Scene, x: np.ndarray, v: np.ndarray, u_h: float, theta_h: float) -> list[float]:
    """`QUANTITIES` of one snapshot. Distances are ∫|w - …|dv; `floor` is that of as many independent draws of the Gaussian."""
    bins = np.minimum((x * (BINS / LENGTH)).astype(np.int64), BINS - 1)
    number = np.bincount(bins, minlength=BINS)
    density = number * (BINS / x.size)
    mean, variance = float(v.mean()), float(v.var())
    c = (v - mean) / math.sqrt(variance)
    cube = c * c * c
    above = density > CLUSTER
    clusters = int((above & ~np.roll(above, 1)).sum())
    found = [density.var(), density.max(), mean, variance, cube.mean(), (cube @ c) / (3 * v.size) - 1, clusters]
    if scene.operator == FOLLOW_LEADER:
        points = u_h + V
        w = np.histogram(v, V.size, (points[0] - DV / 2, points[-1] + DV / 2))[0] / (v.size * DV)
        own = gaussian(points, mean, variance)
        # The homogeneous state of each bin's own density
        local = sum(d / BINS * gaussian(points, u_h - scene.cross_section * (d - 1) * theta_h, theta_h) for d in density)
        shapes = (own, two_populations(scene, density, points), local, gaussian(points, u_h, theta_h))
        found += [float(np.abs(w - shape).sum() * DV) for shape in shapes]
        p = own * DV
        found.append(math.sqrt(2 / (math.pi * v.size)) * float(np.sqrt(p * np.maximum(1 - p, 0)).sum()))
    else:
        found += [math.nan] * 5
    momentum, energy = np.bincount(bins, v, BINS), np.bincount(bins, v * v, BINS)
    parts: list[float] = []
    for part in (density > 1, density <= 1):
        n = number[part].sum()
        u = momentum[part].sum() / n
        parts += [float((density[part] * number[part]).sum() / n), u, energy[part].sum() / n - u * u]
    return [*found, number[density > 1].sum() / x.size, *parts]


def average(work: tuple[Case, int]) -> list[float]:
    """Averages over time of one replica."""
    numba.set_num_threads(1)
    case, seed = work
    scene = case.scene(seed)
    state = homogeneous_state(scene)
    assert state is not None
    simulation = Simulation(make_plan(scene))
    simulation.advance_to(case.start)
    rows = []
    for t in range(case.start + 1, case.end + 1):
        simulation.advance_to(t)
        rows.append(sample(scene, *simulation.particles()[0], state.mean_velocity, state.temperature))
    return [float(q) for q in np.mean(rows, axis=0)]


Result = dict[str, tuple[float, float]]
_known: dict[Case, Result] = {}


def measure(cases: Sequence[Case]) -> dict[Case, Result]:
    """Mean and standard error over replicas of each quantity; `contrast` is the root of the mean square over time."""
    work = [(case, seed) for case in dict.fromkeys(cases) if case not in _known for seed in range(1, case.replicas + 1)]
    work.sort(key=lambda w: -w[0].cost)
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        found = pool.map(average, work, chunksize=1)
    for case in cases:
        if case in _known:
            continue
        rows = np.array([row for (c, _), row in zip(work, found, strict=True) if c == case])
        values = dict(zip(QUANTITIES, rows.T, strict=True))
        values["contrast"] = np.sqrt(values["contrast²"])
        root = math.sqrt(case.replicas)
        _known[case] = {name: (float(q.mean()), float(q.std(ddof=1)) / root) for name, q in values.items()}
    return {case: _known[case] for case in cases}


def text(value: tuple[float, float]) -> str:
    """Mean ± standard error, with two digits of the error."""
    digits = max(0, 1 - math.floor(math.log10(value[1]))) if value[1] > 0 else 3
    return f"{value[0]:.{digits}f} ± {value[1]:.{digits}f}"


def table(*heads: str) -> None:
    print("\n| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def ideal(count: int) -> float:
    return math.sqrt((BINS - 1) / count)


def direct_case(number: float, count: int) -> Case:
    """Noise of the longest wave settles as exp(-2k²t) = exp(-t/8)."""
    start, end, replicas = {1000: (50, 450, 8), 10_000: (50, 350, 8), 100_000: (40, 140, 4), 1_000_000: (30, 70, 4)}[count]
    # Twice the default step for a million: nothing to be seen of it in `files`
    step = 0.2 / max(1.0, 2 * number) if count == 1_000_000 else None
    return Case(number, count, start, end, replicas, time_step=step)


def direct() -> None:
    """Operator (6) by direct simulation, R* and N."""
    cases = [direct_case(number, count) for number in NUMBERS for count in COUNTS if count < 1_000_000 or number >= 2]
    found = measure(cases)
    print(f"\nDensity over its mean in {BINS} bins; a2 = ⟨c⁴⟩/3 - 1 of w(v)")
    table("R*", "N", "contrast", "linear theory", "ideal gas", "largest ρ/ρ̄", "mean v", "u_h", "variance", "skewness", "a2")
    for case, q in found.items():
        columns = [text(q[name]) for name in ("max", "mean", "variance", "skewness", "a2")]
        columns.insert(2, f"{1 - case.number:g}")
        theory = expected_contrast(case.scene())
        row(
            f"{case.number:g}",
            f"{case.count}",
            text(q["contrast"]),
            contrast_in_words(theory),
            f"{ideal(case.count):.3g}",
            *columns,
        )

    print("\nR* where S(k)/N = level at k = 0.25")
    table("level", *(f"N = {count}" for count in COUNTS))
    scene = figure_scene(3)
    for level in (1.0, 0.01):
        densities = [stability.apparent_critical_density(scene, count, 1, level) for count in COUNTS]
        row(f"{level:g}", *(f"{scene.cross_section * density:.3f}" for density in densities))

    print("\nw(v): ∫|w - …|dv per snapshot; `floor` is what as many independent particles of the Gaussian would show")
    names = ("gaussian", "two", "local", "equation", "floor")
    table("R*", "N", *names)
    chosen = [
        direct_case(*c) for c in ((0.5, 10_000), (2.0, 10_000), (4.0, 1000), (4.0, 10_000), (4.0, 100_000), (4.0, 1_000_000))
    ]
    for case in chosen:
        row(f"{case.number:g}", f"{case.count}", *(text(found[case][name]) for name in names))
    print("\nThe two populations: where the density is above and below its mean")
    table(
        *("R*", "N", f"clusters above {CLUSTER:g} ρ̄", "share of particles above ρ̄"),
        *("density seen", "mean v", "variance", "u_h of it", "density seen, below", "mean v", "variance", "u_h of it"),
    )
    for case in chosen:
        q, columns = found[case], []
        for part in ("dense", "thin"):
            columns += [text(q[f"{part} {name}"]) for name in ("density", "mean", "variance")]
            columns.append(f"{1 - case.number * q[f'{part} density'][0]:.2f}")
        row(f"{case.number:g}", f"{case.count}", text(q["clusters"]), text(q["dense share"]), *columns)
    save_figure(found, "docs/clusters.png")
    for case, q in found.items():
        (value, error), theory = q["contrast"], expected_contrast(case.scene())
        if case.number <= 1:
            # Finite N: of the order of the contrast squared, which linear theory leaves out; cells: 2 % (`files`)
            assert abs(value / theory - 1) < 4 * error / theory + theory**2 + 0.02, (case, value, error, theory)
        if theory > 0.5:
            assert value < 0.7 * theory, (case, value, theory)
        if case.number == 4:
            more = [other for other in found if other.number == 4 and other.count > case.count]
            assert all(found[other]["contrast"][0] < 0.7 * value for other in more), case
            assert value > 2.5 * ideal(case.count), (case, value)
            distances = [q[name][0] for name in ("two", "local", "equation")]
            assert min(distances) > 2 * q["gaussian"][0], (case, distances)


HIGHEST = 3.0
"""Contrast at the top of the picture: the line of R* = 4 is above it."""


def save_figure(found: dict[Case, Result], path: str) -> None:
    figure = Figure(figsize=(11, 5), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    count = np.geomspace(600, 2e6, 50)
    left.plot(count, np.sqrt((BINS - 1) / count), color="0.5", ls=":", label="ideal gas")
    right.plot([0.005, 1], [0.005, 1], color="0.5", lw=1, label="linear theory")
    markers = "osD^vP"
    for n, number in enumerate(NUMBERS):
        colour = ("#000000", "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00")[n]
        cases = [case for case in found if case.number == number]
        one = expected_contrast(cases[0].scene(), count=1)
        left.plot(count, one / np.sqrt(count), color=colour, lw=1)
        if one / math.sqrt(count[-1]) < HIGHEST:
            left.text(1.1 * count[-1], one / math.sqrt(count[-1]), f"{number:g}", va="center", fontsize=8)
        n_of, theory = np.array([case.count for case in cases]), np.array([one / math.sqrt(case.count) for case in cases])
        values, errors = np.array([found[case]["contrast"] for case in cases]).T
        style = {"fmt": markers[n], "color": colour, "ms": 5, "capsize": 2, "label": f"R* = {number:g}"}
        left.errorbar(n_of, values, errors, **style)
        right.errorbar(theory, values, errors, **style)
    left.set(xscale="log", yscale="log", ylim=(0.004, HIGHEST), xlim=(500, 5e6), xlabel="particles N", ylabel="density contrast")
    right.set(
        xscale="log",
        yscale="log",
        ylim=(0.004, HIGHEST),
        xlabel="√(Σ S sinc²/N): linear theory's contrast while that is small",
    )
    left.set_title("lines: linear theory, √(Σ S sinc²/N), at each R*", fontsize=10)
    right.set_title("the same points: on the line where linear theory holds", fontsize=10)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=7, fontsize=9, frameon=False)
    figure.savefig(path, dpi=150)


def files() -> None:
    """Single file beside direct simulation, and both against their steps, at the same N."""
    pairs = []
    for number in (0.5, 1.0, 2.0, 4.0):
        few = Case(number, 2000, 50, 200, 6)
        pairs.append((dataclasses.replace(few, single_file=True, time_step=0.005), few))
    pairs.append((Case(4.0, 10_000, 30, 80, 4, single_file=True, time_step=0.005), direct_case(4.0, 10_000)))
    steps = [Case(4.0, 2000, 50, 200, 6, single_file=True, time_step=h) for h in (0.02, 0.005, 0.00125)]
    rest = [
        Case(4.0, 2000, 50, 200, 6, time_step=h, refined=r)
        for h, r in ((0.025, 1), (None, 1), (0.00625, 1), (None, 2), (None, 4), (0.003125, 4))
    ]
    linear = [direct_case(0.5, 10_000), Case(0.5, 10_000, 50, 350, 8, time_step=0.025, refined=4)]
    linear += [direct_case(1.0, 10_000), Case(1.0, 10_000, 50, 350, 8, time_step=0.0125, refined=4)]
    found = measure([*(case for pair in pairs for case in pair), *steps, *rest, *linear])
    print("\nγh = 0.005 in single file")
    table(*("R*", "N", "P", "sticking", "", "contrast", "linear theory", "largest ρ/ρ̄", "mean v", "variance", "skewness", "a2"))
    for pair in pairs:
        for case in pair:
            columns = [text(found[case][name]) for name in ("contrast", "max", "mean", "variance", "skewness", "a2")]
            columns.insert(1, contrast_in_words(expected_contrast(case.scene())))
            row(f"{case.number:g}", f"{case.count}", *_encounters(case), *columns)
    print("\nSteps and cells")
    table("R*", "N", "", "γh", "cell over free path", "sticking", "contrast", "linear theory", "mean v", "variance")
    for case in (*steps, *rest, *linear):
        plan = make_plan(case.scene())
        columns = [text(found[case][name]) for name in ("contrast", "mean", "variance")]
        columns.insert(1, contrast_in_words(expected_contrast(case.scene())))
        stick, kind = _encounters(case)[1:]
        width = "–" if case.single_file else f"{plan.relative_width:.3f}"
        row(f"{case.number:g}", f"{case.count}", kind, f"{plan.time_step:g}", width, stick, *columns)
    smallest, error = found[steps[-1]]["contrast"]
    wide, narrow = found[rest[1]]["contrast"], found[rest[4]]["contrast"]
    assert smallest < wide[0] + 2 * math.hypot(error, wide[1]), (smallest, wide)
    assert abs(smallest / narrow[0] - 1) < 0.05 + 2 * math.hypot(error, narrow[1]) / narrow[0], (smallest, narrow)


def _encounters(case: Case) -> tuple[str, str, str]:
    probability = make_plan(case.scene()).probability
    if not case.single_file:
        return f"{probability:.3g}", "–", "direct"
    assert case.time_step is not None
    return f"{probability:.3g}", f"{sticking(probability, case.time_step):.3f}", "single file"


def inelastic() -> None:
    """Operator (12) with ε = 0.5."""
    cases = [Case(number, 10_000, 40, 240, 8, INELASTIC) for number in (0.5, 4.0, 10.0)]
    found = measure(cases)
    print(f"\n(12), ε = {RESTITUTION:g}")
    table("R*", "N", "contrast", "linear theory", "ideal gas", "largest ρ/ρ̄", "variance", "θ_h", "skewness", "a2", "a2_h")
    for case, q in found.items():
        state = homogeneous_state(case.scene())
        assert state is not None
        columns = [text(q[name]) for name in ("max", "variance", "skewness", "a2")]
        columns.insert(2, f"{state.temperature:.4f}")
        columns.append(f"{state.kurtosis_excess:.4f}")
        theory = expected_contrast(case.scene())
        row(f"{case.number:g}", f"{case.count}", text(q["contrast"]), f"{theory:.4f}", f"{ideal(case.count):.3g}", *columns)
        slack = 4 * q["contrast"][1] / theory + theory**2
        assert abs(q["contrast"][0] / theory - 1) < slack, (case, q["contrast"], theory)


def equation() -> None:
    """Equation (2) with (6): homogeneous, and from a wave of 50 %, by the grid solver and the closed form."""
    times = (0, 3, 10, 30)
    print("\nEquation (2) with (6), homogeneous start: contrast at 500/γ")
    table("R*", "contrast")
    for figure in (2, 3):
        # On points in x: left to itself the solver takes one point for a homogeneous scene
        scene = figure_scene(figure)
        scene = scene.model_copy(update={"grid": scene.grid.model_copy(update={"nx": 65})})
        density = solve(scene)["density"].values[-1]
        row(f"{scene.groups.collision_number:g}", f"{density.std() / density.mean():.1e}")
        assert density.std() < 1e-12 * density.mean()
    print("\nFrom a wave of 50 %, R* = 4: contrast, least and largest ρ/ρ̄")
    table("", *(f"t = {t}/γ" for t in times))
    scene = figure_scene(3)
    start = scene.initial.model_copy(update={"modes": (Mode(mode=1, cos=0.5),)})
    run = scene.run.model_copy(update={"end_time": 30.0, "output_every": 1.0})
    scene = Scene.model_validate(scene.model_copy(update={"initial": start, "run": run}).model_dump())
    answers = {"grid solver": solve(scene), "closed form": exact.solve(scene)}
    contrasts = {}
    for name, answer in answers.items():
        density = answer["density"].values
        contrasts[name] = density.std(axis=1)
        cells = (f"{density[t].std():.6f} [{density[t].min():.4f}, {density[t].max():.4f}]" for t in times)
        row(name, *cells)
        assert density.min() > 0.5 - 1e-6, density.min()
        assert density.max() < 1.5 + 1e-6, density.max()
        assert (np.diff(contrasts[name]) < 0).all()
    assert np.abs(contrasts["grid solver"] - contrasts["closed form"]).max() < 1e-4


SECTIONS = {"direct": direct, "files": files, "inelastic": inelastic, "equation": equation}


def main() -> None:
    run_sections(SECTIONS)


if __name__ == "__main__":
    main()
