"""Pictures of linear theory. Imported only when asked for; drawn on a canvas of their own, so no display is needed.

Each `save_` function writes one file, whose ending gives the format, and raises SceneError where that cannot be written.
Blue is the kinetic equation, orange its closure; where curves differ in R*, darker is less.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from kinetic_solver.arrays import Array
from kinetic_solver.scene import INELASTIC, Scene, SceneError
from kinetic_solver.stability.amplification import transient_growth
from kinetic_solver.stability.closure import closure_rates, critical_collision_number, critical_density
from kinetic_solver.stability.flow import Flow, flow_of
from kinetic_solver.stability.follow_leader import FollowLeaderFlow
from kinetic_solver.stability.inelastic import inelastic_flow
from kinetic_solver.stability.spectrum import FIRST_MODES

if TYPE_CHECKING:
    import xarray as xr

KINETIC, CLOSURE = "#0072B2", "#D55E00"
SHORTEST_INELASTIC = 12.0
"""k*√(θ_h/σ) up to which the spectrum of (12) is drawn: it wants ever more points, and shorter waves have long died out."""
MOMENTS = (2, 3, 4, 5, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128)
AFFORDABLE = 32
"""Moments up to which R*_c at finite k* is drawn."""
COLLISION_NUMBERS = (0.5, 1.0, 1.347, 2.0, 3.0, 4.0)
INELASTIC_FLOWS = ((0.9, 100.0), (0.5, 10.0), (0.0, 1.0), (0.5, 1.0))
"""(ε, R*)."""


def save_figure_1(dataset: xr.Dataset, path: str | Path) -> None:
    """The paper's Fig. 1 from `stability.figure_1()`: ρ_c of the three-moment closure over the mode number, R*_c at the right."""
    _write(_figure_1(dataset), path)


def save_scene_figure(scene: Scene, path: str | Path) -> None:
    """Over k*: growth rates of closure and kinetic equation; the closure's critical density; S(k) and what N particles show of it.

    Dots are the modes that the scene's pipe holds. Raises SceneError without friction and noise.
    """
    _write(_scene_figure(scene), path)


def save_moments(path: str | Path) -> None:
    """R*_c of the closure with M moments: for short waves and at k* = 1, with (2/3)√(2(M - 1))."""
    _write(_moments(), path)


def save_structure_factors(path: str | Path) -> None:
    """S(k) over k* of both operators, at several R*."""
    _write(_structure_factors(), path)


def save_growth(path: str | Path) -> None:
    """√G_ρ over time of (6) at k* = 1, and the disturbance that grows most at R* = 2."""
    _write(_growth(), path)


def _write(figure: Figure, path: str | Path) -> None:
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be written ({error})") from None


def _colours(count: int) -> Any:
    return colormaps["viridis"](np.linspace(0.0, 0.85, count))


def _plain_logs(axis: Any) -> None:
    """1000 and 0.1 in words of their own on a logarithmic axis, powers of ten beyond."""
    axis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}" if 1e-3 <= y < 1e4 else f"$10^{{{math.log10(y):.0f}}}$"))
    axis.set_minor_formatter(NullFormatter())


def _figure_1(dataset: xr.Dataset) -> Figure:
    n, density = dataset["mode"].values, dataset["critical_density"].values
    least = float(dataset.attrs["least_critical_density"])
    unit = float(density[0] / dataset["critical_collision_number"].values[0])
    """The density at which R* = 1."""
    figure = Figure(figsize=(8, 5.2), layout="constrained")
    axes = figure.subplots()
    low, high = 0.75 * least, 1.08 * float(density.max())
    axes.fill_between(n, density, high, color=CLOSURE, alpha=0.12, lw=0)
    axes.plot(n, density, color=CLOSURE, lw=0.8, marker="o", ms=4.5)
    axes.axhline(least, color="0.25", lw=1, ls="--")
    right = float(n[-1])
    axes.text(right, least - 0.015 * (high - low), f"ρ_c^min ≈ {least:g}, for n → ∞", ha="right", va="top", color="0.25")
    axes.text(0.55 * right, 0.35 * least + 0.65 * high, "closure unstable", ha="center", fontsize=12, color=CLOSURE)
    axes.text(0.55 * right, (low + least) / 2, "closure stable", ha="center", fontsize=12, color="0.25")
    axes.set(xlabel="mode number n", ylabel="critical density ρ_c", xlim=(0, right + 1), ylim=(low, high))
    axes.set_title("Critical density of the three-moment closure of (2) with (6)", fontsize=12)
    axes.secondary_yaxis("right", functions=(lambda rho: rho / unit, lambda number: number * unit)).set_ylabel("R*_c = S ρ_c √σ/γ")
    figure.supxlabel(
        "A property of the three-moment closure: the kinetic equation is linearly stable at every density.\n"
        f"{dataset.attrs['length']},  {dataset.attrs['cross_section']}",
        fontsize=9,
        color="0.25",
    )
    return figure


def _scene_figure(scene: Scene) -> Figure:
    flow, _ = flow_of(scene)
    first = scene.groups.wavenumber
    k, modes = np.geomspace(first / 2, 10 * first, 41), first * np.array(FIRST_MODES)
    figure = Figure(figsize=(14, 4.8), layout="constrained")
    rates, critical, noise = figure.subplots(1, 3)
    _growth_rates(rates, scene, flow, k, modes)
    _critical_density(critical, scene, k, modes)
    _noise(noise, scene, flow, k, modes)
    for axes in (rates, critical, noise):
        axes.set(xscale="log", xlabel="k* = k √σ/γ", xlim=(k[0], k[-1]))
        _plain_logs(axes.xaxis)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{_name(scene)}     dots: modes n = 1 … {len(modes)} of the pipe, L* = {scene.groups.length:.4g}", fontsize=12)
    return figure


def _name(scene: Scene) -> str:
    number = scene.groups.collision_number
    if scene.operator == INELASTIC:
        return f"operator (12), ε = {scene.restitution:g}, R* = {number:.4g}"
    return f"operator (6), R* = {number:.4g}" if scene.operator else "no collisions"


def _legend_below(axes: Any) -> None:
    """Under the axes, where it covers no curve."""
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)


def _at(scene: Scene, wavenumber: float) -> Scene:
    """The scene in a pipe whose mode 1 has this k*."""
    length = scene.pipe.length * scene.groups.wavenumber / wavenumber
    return scene.model_copy(update={"pipe": scene.pipe.model_copy(update={"length": length})})


def _growth_rates(axes: Any, scene: Scene, flow: Flow, k: Array, modes: Array) -> None:
    gamma = scene.model.friction
    widest = SHORTEST_INELASTIC / math.sqrt(flow.temperature) if scene.operator == INELASTIC else math.inf

    def closure(k: float) -> float:
        return float(closure_rates(_at(scene, k))[0].real) / gamma

    def kinetic(k: float) -> float:
        if k > widest:
            return math.nan
        s, uncertainty = flow.rates(k, 1)
        return float(s[0].real) if uncertainty[0] < 0.01 * abs(s[0]) else math.nan

    lowest = 0.0
    for rate, colour, style, label in ((closure, CLOSURE, "--", "closure, M = 3"), (kinetic, KINETIC, "-", "kinetic equation")):
        curve = np.array([rate(float(value)) for value in k])
        axes.plot(k, curve, color=colour, ls=style, lw=2, label=label)
        axes.plot(modes, [rate(float(value)) for value in modes], "o", color=colour, ms=5)
        lowest = min(lowest, float(np.nanmin(curve, initial=0.0)))
    axes.axhline(0, color="0.25", lw=1)
    # Without a floor the decay of short waves, as -k*² and faster, would flatten all else.
    axes.set(ylabel="growth rate Re s/γ", title="growth rates")
    axes.set_ylim(max(1.1 * lowest, -1.2), max(1.15 * axes.get_ylim()[1], 0.1))
    _legend_below(axes)


def _critical_density(axes: Any, scene: Scene, k: Array, modes: Array) -> None:
    density = scene.initial.density
    critical = np.array([critical_density(_at(scene, float(value))) for value in k])
    axes.axhline(density, color="0.25", lw=1.5, ls=":", label="density of the scene")
    axes.set(ylabel="density ρ", title="critical density of the closure", yscale="log")
    if np.isinf(critical).all():
        axes.set_ylim(density / 10, density * 10)
        axes.text(0.5, 0.75, "the closure has none:\nstable at every density", ha="center", transform=axes.transAxes, color=CLOSURE)
    else:
        low, high = min(density, critical.min()) / 1.8, max(density, critical.max()) * 1.8
        axes.fill_between(k, critical, high, color=CLOSURE, alpha=0.12, lw=0)
        axes.plot(k, critical, color=CLOSURE, ls="--", lw=2, label="critical density, M = 3")
        axes.plot(modes, [critical_density(_at(scene, float(value))) for value in modes], "o", color=CLOSURE, ms=5)
        axes.set_ylim(low, high)
        axes.text(0.97, 0.96, "closure unstable", ha="right", va="top", transform=axes.transAxes, color=CLOSURE)
        axes.text(0.03, 0.04, "closure stable", transform=axes.transAxes, color="0.25")
    _plain_logs(axes.yaxis)
    _legend_below(axes)


def _noise(axes: Any, scene: Scene, flow: Flow, k: Array, modes: Array) -> None:
    count = scene.particles.count
    curve, dots = (np.array([flow.structure_factor(float(value)) for value in where]) for where in (k, modes))
    axes.plot(k, curve, color=KINETIC, lw=2, label="S(k)")
    axes.plot(modes, dots, "o", color=KINETIC, ms=5)
    axes.axhline(1, color="0.25", lw=1, ls="--", label="ideal gas")
    top = max(3.0, 2 * float(curve[np.isfinite(curve)].max(initial=1.0)))
    if top > count / 30:
        top = max(top, 3.0 * count)
        axes.axhline(count, color=CLOSURE, lw=1.5, ls="-.", label="S = N: linear theory ends")
    axes.set(ylabel="structure factor S(k)", title=f"noise of N = {count} particles", yscale="log", ylim=(0.6, top))
    _plain_logs(axes.yaxis)
    right = axes.secondary_yaxis("right", functions=(lambda s: 2 * np.sqrt(s / count), lambda a: count * a**2 / 4))
    right.set_ylabel("rms amplitude of a density wave, 2√(S/N)")
    _legend_below(axes)


def _moments() -> Figure:
    short = np.array([critical_collision_number(math.inf, m) for m in MOMENTS])
    long = np.array([critical_collision_number(1.0, m) for m in MOMENTS if m <= AFFORDABLE])
    m = np.array(MOMENTS, dtype=float)
    figure = Figure(figsize=(7.5, 5), layout="constrained")
    axes = figure.subplots()
    axes.plot(m[: long.size], long, color=KINETIC, marker="s", ms=5, lw=0.8, label="k* = 1")
    axes.plot(m, short, color=CLOSURE, marker="o", ms=5, lw=0.8, label="k* → ∞")
    axes.plot(m, 2 / 3 * np.sqrt(2 * (m - 1)), color="0.25", lw=1.5, ls="--", label="(2/3) √(2(M - 1))")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="moments M that the closure keeps",
        ylabel="critical collision number R*_c",
        title="Closures with more moments lose stability at higher densities",
        xticks=[2, 4, 8, 16, 32, 64, 128],
    )
    axes.annotate("the paper's: M = 3", (3, short[1]), (4.2, 1.02), color=CLOSURE, arrowprops={"arrowstyle": "-", "color": CLOSURE})
    _plain_logs(axes.xaxis)
    _plain_logs(axes.yaxis)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="upper left")
    return figure


def _structure_factors() -> Figure:
    k = np.geomspace(0.02, 20, 81)
    figure = Figure(figsize=(12, 5), layout="constrained")
    leader, inelastic = figure.subplots(1, 2)
    for colour, number in zip(_colours(len(COLLISION_NUMBERS)), COLLISION_NUMBERS, strict=True):
        limit = math.exp(number**2) * (1 + math.erf(number))
        _labelled(leader, k, FollowLeaderFlow(number).structure_factor, colour, f"R* = {number:g}", limit)
    for colour, (restitution, number) in zip(_colours(len(INELASTIC_FLOWS))[::-1], INELASTIC_FLOWS, strict=True):
        _labelled(
            inelastic, k, inelastic_flow(restitution, number).structure_factor, colour, f"ε = {restitution:g}, R* = {number:g}"
        )
    leader.set(title="operator (6)", ylim=(0.5, 1e9))
    inelastic.set(title="operator (12)", ylim=(0.8, 30))
    for axes in (leader, inelastic):
        axes.set(xscale="log", yscale="log", xlabel="k* = k √σ/γ", ylabel="structure factor S(k)", xlim=(k[0] / 1.6, k[-1]))
        axes.axhline(1, color="0.25", lw=1, ls="--")
        axes.grid(alpha=0.3)
        _plain_logs(axes.xaxis)
        _plain_logs(axes.yaxis)
    leader.text(0.97, 0.96, "short marks: k → 0, exp(R*²)(1 + erf R*)", ha="right", va="top", transform=leader.transAxes)
    for axes in (leader, inelastic):
        axes.text(k[-1] / 1.15, 0.97, "ideal gas", ha="right", va="top", fontsize=9, color="0.25")
    return figure


def _labelled(axes: Any, k: Array, curve: Callable[[float], float], colour: Any, label: str, limit: float | None = None) -> None:
    values = [curve(float(value)) for value in k]
    axes.plot(k, values, color=colour, lw=2)
    axes.text(k[0] * 1.1, values[0] * 1.06, label, color=colour, va="bottom", fontsize=9)
    if limit is not None:
        axes.plot([k[0] / 1.6, k[0] / 1.15], [limit, limit], color=colour, lw=3.5, solid_capstyle="butt")


def _growth() -> Figure:
    t = np.linspace(0, 10, 401)
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    gain, state = figure.subplots(1, 2)
    numbers = (0.0, 1.0, 2.0, 3.0, 4.0)
    for colour, number in zip(_colours(len(numbers)), numbers, strict=True):
        curve = np.sqrt(FollowLeaderFlow(number).density_gain(1.0, t))
        gain.plot(t, curve, color=colour, lw=2, label=f"R* = {number:g}")
    gain.plot(t, np.exp(-t), color="0.25", lw=1, ls="--", label="exp(-k*²t): every mode's decay")
    gain.set(yscale="log", xlabel="γt", ylabel="√G_ρ")
    gain.legend()
    scene = Scene.model_validate(
        {
            "collisions": {"operator": "follow-the-leader", "cross_section": 2.0},
            "pipe": {"length": 2 * math.pi},
            "run": {"end_time": 1.0},
        }
    )
    flow, units = flow_of(scene)
    growth = transient_growth(scene)
    w = units.velocity(growth["v"].values)
    state.plot(w, flow.distribution(w), color="0.25", lw=1.5, ls="--", label="f_h")
    state.plot(w, growth["optimal_real"], color=KINETIC, lw=2, label="Re δf(0)")
    state.plot(w, growth["optimal_imag"], color=CLOSURE, lw=2, ls="-.", label="Im δf(0)")
    state.legend()
    return figure
