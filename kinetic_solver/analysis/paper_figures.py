"""The paper's Figures 2 and 3: particles below and above the critical density of its closure, at its times, beside equation (2).

The paper gives times of 0, 3 and 500 s and no parameters: times are read as multiples of 1/γ, and R* = 0.5 and 4 are chosen on
both sides of the closure's limit 7√3/9 = 1.347. What the pictures show, and why: docs/clusters_details.md.
Tests: tests/paper/test_figs_2_3.py.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from kinetic_solver.analysis.drawing import BLUE, ORANGE, save
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import attributes, scene_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import INELASTIC, Scene
from kinetic_solver.solver import solve
from kinetic_solver.stability import structure_factor
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stability.verdict import LARGEST_CONTRAST

TIMES = (0.0, 3.0, 500.0)
"""The paper's times, taken in units of 1/γ."""
COLLISION_NUMBERS = {2: 0.5, 3: 4.0}
"""Figure → R*."""
LENGTH = 8 * math.pi
"""L* = Lγ/√σ."""
COUNT = 10_000
"""Particles, where no other number is asked for."""
RESTITUTION = 0.5
"""ε, with operator (12)."""
BINS = 50
"""Bins of the density's histogram."""
LEAST_COUNT = 2 * BINS
"""The fewest particles of which a histogram says anything: two to a bin."""
OUT_OF_RANGE = "too large"
"""What is said of noise beyond `LARGEST_CONTRAST`: too large for linear theory."""
TWO_DENSITIES = "homogeneous flow at the two densities seen"
"""What `two_populations` are."""
PARTICLES, EQUATION, GAUSSIAN, TWO = "0.8", BLUE, "#000000", ORANGE
"""Colours."""


def figure_scene(figure: int, operator: str = "follow-the-leader", count: int = COUNT, seed: int = 1) -> Scene:
    """A homogeneous pipe of L* = 8π with g, γ, σ, ρ̄ = 1; figure 2 has R* = 0.5, figure 3 R* = 4. Operator (12) has ε = 0.5."""
    if figure not in COLLISION_NUMBERS:
        raise SceneError(f"figure {figure}: allowed: 2 or 3")
    if 0 < count < LEAST_COUNT:
        raise SceneError(f"count = {count}: allowed: {LEAST_COUNT} or more, two to a bin")
    collisions = {"operator": operator, "cross_section": COLLISION_NUMBERS[figure]}
    if operator == INELASTIC:
        collisions["restitution"] = RESTITUTION
    return Scene.model_validate(
        {
            "model": {"gravity": 1.0},
            "collisions": collisions,
            "pipe": {"length": LENGTH},
            "run": {"end_time": TIMES[-1], "output_every": 1.0},
            "output": {"f": False, "budgets": False},
            "particles": {"count": count, "seed": seed, "replicas": 1},
        }
    )


def snapshots(scene: Scene) -> xr.Dataset:
    """Particles of the scene's first replica at `TIMES`, and what (2) says; dims (time, replica, particle), (time, bin or v_bin).

    `position`, `velocity`; `density_histogram` over its mean; w(v) per particle: `histogram`, `equation`, `gaussian` of the
    particles' mean and variance, `two_populations`: homogeneous states of the mean densities that particles see in the bins
    above and below ρ̄, each with its share of them, nothing fitted to w; `two_fitted`: two Gaussians of the variance θ_h, their
    means (time, population) `population_velocity` and shares `population_share` fitted to the particles (`fit_two`).
    """
    from particles.plan import make_plan
    from particles.simulation import Simulation

    equation = solve(scene)
    simulation = Simulation(make_plan(scene))
    places, velocities = [], []
    for time in TIMES:
        simulation.advance_to(time)
        x, v = simulation.particles()[0]
        places.append(x.copy())
        velocities.append(v.copy())
    v = np.linspace(min(map(np.min, velocities)) - 0.5, max(map(np.max, velocities)) + 0.5, 61)
    state = homogeneous_state(scene)
    assert state is not None
    names = ("density_histogram", "histogram", "equation", "gaussian", "two", "fitted", "mean", "share")
    columns: dict[str, list[Array]] = {name: [] for name in names}
    for time, x, u in zip(TIMES, places, velocities, strict=True):
        density = np.histogram(x, BINS, (0, scene.pipe.length))[0] * BINS / x.size
        columns["density_histogram"].append(density)
        dv = v[1] - v[0]
        columns["histogram"].append(np.histogram(u, v.size, (v[0] - dv / 2, v[-1] + dv / 2))[0] / (u.size * dv))
        w = equation["velocity_distribution"].sel(time=time, method="nearest") / equation["mass"][0]
        columns["equation"].append(w.interp(v=v, method="cubic", kwargs={"fill_value": 0.0}).values)
        columns["gaussian"].append(gaussian(v, float(u.mean()), float(u.var())))
        columns["two"].append(two_populations(scene, density, v))
        means, shares = fit_two(u, state.temperature)
        columns["mean"].append(means)
        columns["share"].append(shares)
        columns["fitted"].append(sum(s * gaussian(v, float(m), state.temperature) for m, s in zip(means, shares, strict=True)))
    over_v = {"histogram": "particles", "equation": "of (2)", "gaussian": "Gaussian of the particles' mean and variance"}
    data = {
        "position": (("time", "replica", "particle"), np.array(places)[:, None]),
        "velocity": (("time", "replica", "particle"), np.array(velocities)[:, None]),
        "density_histogram": (("time", "bin"), np.array(columns["density_histogram"]), {"long_name": "density over its mean"}),
        **{name: (("time", "v_bin"), np.array(columns[name]), {"long_name": text}) for name, text in over_v.items()},
        "population_velocity": (
            ("time", "population"),
            np.array(columns["mean"]),
            {"long_name": "means of the fitted Gaussians"},
        ),
        "population_share": (("time", "population"), np.array(columns["share"]), {"long_name": "their shares"}),
        "two_fitted": (("time", "v_bin"), np.array(columns["fitted"]), {"long_name": "two fitted Gaussians of variance θ_h"}),
        "two_populations": (("time", "v_bin"), np.array(columns["two"]), {"long_name": "homogeneous states of two densities"}),
    }
    centres = scene.pipe.length * (np.arange(BINS) + 0.5) / BINS
    coordinates = {"time": np.array(TIMES), "bin": centres, "v_bin": v}
    return xr.Dataset(data, coordinates, attributes(scene, "particles"))


def gaussian(v: Array, mean: float, variance: float) -> Array:
    """N(v; mean, variance)."""
    return np.asarray(np.exp(-((v - mean) ** 2) / (2 * variance)) / math.sqrt(2 * math.pi * variance))


def fit_two(velocities: Array, variance: float) -> tuple[Array, Array]:
    """(means (2,) ascending, shares (2,)) of the two Gaussians of a given variance that make the velocities the likeliest.

    Both means are the sample's where it is no wider than that variance. Test: test_two_fitted_populations, by the gradient.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    mean, width = velocities.mean(), math.sqrt(variance)
    start = math.sqrt(max(float(velocities.var()) - variance, 0.0)) / width
    if start == 0:
        return np.array([mean, mean]), np.array([0.5, 0.5])
    x = (velocities - mean) / width

    def loss(parameters: Array) -> tuple[float, Array]:
        """Minus the mean logarithm of the likelihood over that of one Gaussian, and its gradient."""
        means, shares = parameters[:2], expit(np.array([-parameters[2], parameters[2]]))
        logs = np.log(shares)[:, None] + means[:, None] * x - means[:, None] ** 2 / 2
        whole = np.logaddexp(logs[0], logs[1])
        belongs = np.exp(logs - whole)
        weight = belongs.mean(axis=1)
        by_mean = belongs @ x / x.size - weight * means
        return -float(whole.mean()), -np.append(by_mean, weight[1] - shares[1])

    best = minimize(loss, np.array([-start, start, 0.0]), jac=True, method="BFGS", options={"gtol": 1e-8}).x
    means, shares = mean + width * best[:2], expit(np.array([-best[2], best[2]]))
    order = np.argsort(means)
    return means[order], shares[order]


def two_populations(scene: Scene, density: Array, v: Array) -> Array:
    """w(v) of homogeneous states of the densities, over their mean, that particles see in the bins above and below it."""
    w = np.zeros(v.size)
    for part in (density > 1, density <= 1):
        share = density[part].sum() / density.sum()
        if share == 0:
            continue
        seen = float((density[part] ** 2).sum() / density[part].sum()) * scene.initial.density
        state = homogeneous_state(scene.model_copy(update={"initial": scene.initial.model_copy(update={"density": seen})}))
        assert state is not None
        w += share * gaussian(v, state.mean_velocity, state.temperature)
    return w


@functools.lru_cache(maxsize=4)
def expected_contrast(scene: Scene, bins: int = BINS, count: int | None = None) -> float:
    """Standard deviation over `bins` of the density of N particles, over its mean: linear theory, √(Σ_m S_m sinc²(πm/bins)/N).

    Sum over all m ≠ 0; 1/√N times √(bins - 1) for independent particles. Not small means: no longer linear.
    """
    last = 4 * bins
    s = structure_factor(scene, range(1, last + 1)).values
    window = np.sinc(np.arange(1, last + 1) / bins) ** 2
    beyond = bins - 1 - 2 * window.sum()  # waves that no noise amplifies: Σ over all m of sinc² is the number of bins
    return math.sqrt((2 * float((s * window).sum()) + beyond) / (count or scene.particles.count))


def contrast_in_words(contrast: float) -> str:
    """A number where linear theory's contrast is one: waves are small."""
    return f"{contrast:.3g}" if contrast <= LARGEST_CONTRAST else OUT_OF_RANGE


def summary(dataset: xr.Dataset) -> list[str]:
    """Each snapshot in one line, and what linear theory expects of its density."""
    scene = scene_of(dataset)
    state = homogeneous_state(scene)
    assert state is not None
    lines = [f"{'time':>6}{'ρ contrast':>12}{'ρ max/mean':>12}{'mean v':>9}{'variance':>10}{'skewness':>10}{'a2':>8}"]
    for time in dataset["time"].values:
        density = dataset["density_histogram"].sel(time=time).values
        u = dataset["velocity"].sel(time=time).values.ravel()
        c = (u - u.mean()) / u.std()
        lines.append(
            f"{time:6g}{density.std():12.3f}{density.max():12.3f}{u.mean():9.3f}{u.var():10.3f}{(c**3).mean():10.3f}"
            f"{(c**4).mean() / 3 - 1:8.3f}"
        )
    for time, means, shares in zip(
        *(dataset[n].values for n in ("time", "population_velocity", "population_share")), strict=True
    ):
        parts = ", ".join(f"{share:.2f} at {mean:.3g}" for mean, share in zip(means, shares, strict=True))
        lines.append(f"t = {time:g}: two populations of variance {state.temperature:.3g}, shares {parts}")
    dv = float(dataset["v_bin"][1] - dataset["v_bin"][0])
    for time in dataset["time"].values:
        frame = dataset.sel(time=time)
        distances = {
            name: dv * float(np.abs(frame["histogram"] - frame[variable]).sum())
            for name, variable in (
                ("Gaussian", "gaussian"),
                ("two fitted", "two_fitted"),
                ("two densities", "two_populations"),
                ("equation (2)", "equation"),
            )
        }
        lines.append(f"t = {time:g}: ∫|w - …|dv: " + ", ".join(f"{name} {value:.3f}" for name, value in distances.items()))
    lines.append(f"(2) stays homogeneous: mean v {state.mean_velocity:.4g}, variance {state.temperature:.4g}")
    expected, independent = expected_contrast(scene), math.sqrt((BINS - 1) / scene.particles.count)
    predicted = (
        f"linear theory of noise: contrast {expected:.3g}"
        if expected <= LARGEST_CONTRAST
        else f"noise: {OUT_OF_RANGE} for linear theory"
    )
    lines.append(f"{predicted} (independent particles {independent:.3g})")
    return lines


def save_snapshots(dataset: xr.Dataset, path: str | Path) -> None:
    """Density and w(v) at the three times. Raises SceneError where the file cannot be written."""
    save(draw_snapshots(dataset), path)


def draw_snapshots(dataset: xr.Dataset) -> Figure:
    """The dataset of `snapshots` as a picture of two rows: the density over x, and w(v), at each of its times."""
    scene = scene_of(dataset)
    figure = Figure(figsize=(12, 7), layout="constrained")
    axes = figure.subplots(2, dataset.sizes["time"], sharey="row", sharex="row", squeeze=False)
    width = scene.pipe.length / dataset.sizes["bin"]
    dv = float(dataset["v_bin"][1] - dataset["v_bin"][0])
    for (top, bottom), time in zip(axes.T, dataset["time"].values, strict=True):
        frame = dataset.sel(time=time)
        top.bar(frame["bin"], frame["density_histogram"], width, color=PARTICLES, label="particles, counted")
        top.axhline(1, color=EQUATION, lw=4, alpha=0.7, label="equation (2)")
        counted = float(frame["density_histogram"].std())
        top.set_title(f"{f't = {time:g}/γ' if time else 't = 0'}: density contrast {counted:.2g}")
        top.set_xlim(0, scene.pipe.length)
        top.set_xlabel("x")
        bottom.bar(frame["v_bin"], frame["histogram"], dv, color=PARTICLES)
        # From wide to narrow: each is seen where all of them coincide.
        bottom.plot(frame["v_bin"], frame["equation"], color=EQUATION, lw=4, alpha=0.7)
        bottom.plot(frame["v_bin"], frame["two_fitted"], color=TWO, lw=2, label="two populations, fitted")
        bottom.plot(frame["v_bin"], frame["gaussian"], color=GAUSSIAN, lw=1, ls=(0, (5, 3)), label="one Gaussian")
        bottom.plot(
            frame["v_bin"],
            frame["two_populations"],
            color=GAUSSIAN,
            lw=1.2,
            ls=":",
            label=TWO_DENSITIES,
        )
        bottom.set_xlabel("v")
    axes[0, 0].set_ylabel("density over its mean")
    axes[1, 0].set_ylabel("w(v), per particle")
    drawn = [panel.get_legend_handles_labels() for panel in axes[:, 0]]
    handles, labels = ([*first, *second] for first, second in zip(*drawn, strict=True))
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    axes[1, 0].set_ylim(top=1.08 * max(float(dataset[name].max()) for name in ("histogram", "equation", "two_fitted")))
    kind = "inelastic collisions, ε = 0.5" if scene.operator == INELASTIC else "follow-the-leader collisions"
    number, expected = scene.groups.collision_number, expected_contrast(scene)
    predicted = f"linear theory of their noise: density contrast {expected:.2g}"
    if expected > LARGEST_CONTRAST:
        predicted = f"their noise is {OUT_OF_RANGE} for linear theory"
    figure.suptitle(f"{kind}, R* = {number:g}, {scene.particles.count} particles; {predicted}")
    return figure
