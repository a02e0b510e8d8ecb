"""Pictures of linear theory. Imported only when asked for; drawn on a canvas of their own, so no display is needed.

Each `save_` function writes one file, whose ending gives the format; SceneError where that cannot be written.
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
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import INELASTIC, Scene
from kinetic_solver.stability.amplification import transient_growth
from kinetic_solver.stability.closure import closure_rates, critical_collision_number, critical_density
from kinetic_solver.stability.flow import Flow, flow_of
from kinetic_solver.stability.follow_leader import FollowLeaderFlow
from kinetic_solver.stability.inelastic import inelastic_flow
from kinetic_solver.stability.spectrum import FIRST_MODES

if TYPE_CHECKING:
    import xarray as xr

KINETIC, CLOSURE, OTHER = "#0072B2", "#D55E00", "#009E73"
SHORTEST_INELASTIC = 8.0
"""k*√(θ_h/σ) up to which the spectrum of (12) is drawn."""
MOMENTS = (2, 3, 4, 5, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128)
RESOLVED = 64
"""Moments up to which double precision resolves the eigenvalues at k* = 1: R*_c then to 1e-7."""
COLLISION_NUMBERS = (0.5, 1.0, 1.347, 2.0, 3.0, 4.0)
INELASTIC_FLOWS = ((0.5, 1.0), (0.0, 1.0), (0.5, 10.0), (0.9, 100.0))
"""(ε, R*)."""


def save_figure_1(dataset: xr.Dataset, path: str | Path) -> None:
    """The paper's Fig. 1 from `stability.figure_1()`: ρ_c of the three-moment closure over the mode number, R*_c at the right."""
    _write(_figure_1(dataset), path)


def save_scene_figure(scene: Scene, path: str | Path) -> None:
    """Over k*: growth rates of closure and kinetic equation; the closure's critical density; S(k), and what N particles show.

    Dots are the pipe's first modes. The spectrum of (12) is drawn where it is known to 1e-4 and k*√(θ_h/σ) ≤ 8: shorter waves
    want ever more points. Raises SceneError without friction and noise.
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
    return colormaps["viridis"](np.linspace(0.0, 0.8, count))


def _plain_logs(axis: Any, decades: float = 1.0) -> None:
    """A logarithmic axis with 0.01, 2, 1000 written so, powers of ten beyond; the shorter it is, the more is labelled."""

    def text(y: float, _: Any) -> str:
        if 1e-4 < y < 1e6 and (decades < 3 or y < 1e4):
            return f"{y:g}"
        power = math.floor(math.log10(y) + 1e-9)
        size = round(y / 10.0**power)
        return f"${size} \\cdot 10^{{{power}}}$" if size > 1 else f"$10^{{{power}}}$"

    subs = range(1, 10) if decades < 0.7 else (1, 2, 5) if decades < 3 else (1,)
    axis.set_major_locator(LogLocator(subs=[float(n) for n in subs]))
    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(NullFormatter())


def _figure_1(dataset: xr.Dataset) -> Figure:
    n, density = dataset["mode"].values, dataset["critical_density"].values
    least = float(dataset.attrs["least_critical_density"])
    unit = float(density[0] / dataset["critical_collision_number"].values[0])
    """The density at which R* = 1."""
    figure = Figure(figsize=(8, 5.4), layout="constrained")
    axes: Any = figure.subplots()
    low, high, right = 0.75 * least, 1.06 * float(density.max()), float(n[-1])
    axes.axhline(least, color="0.25", lw=1, ls="--")
    axes.plot(n, density, color=CLOSURE, lw=0.8, marker="o", ms=4.5)
    axes.text(
        right, least - 0.015 * (high - low), rf"$\rho_c^{{\min}}$ ≈ {least:g}, for n → ∞", ha="right", va="top", color="0.25"
    )
    axes.text(right / 2, 0.35 * least + 0.65 * high, "closure unstable", ha="center", fontsize=13, color=CLOSURE)
    axes.text(right / 2, low + 0.4 * (least - low), "closure stable", ha="center", fontsize=13, color="0.25")
    axes.set(xlabel="mode number n", ylabel=r"critical density $\rho_c$", xlim=(0, right + 1), ylim=(low, high))
    axes.set_title(dataset.attrs["title"], fontsize=12)
    other = axes.secondary_yaxis("right", functions=(lambda rho: rho / unit, lambda number: number * unit))
    other.set_ylabel(r"$R^*_c = S\,\rho_c\sqrt{\sigma}/\gamma$")
    units = f"{dataset.attrs['length']},  {dataset.attrs['cross_section']}".replace("ρ_c^min", r"$\rho_c^{\min}$")
    figure.supxlabel(
        f"A property of the three-moment closure; the kinetic equation is linearly stable at every density.\n{units}",
        fontsize=10,
        color="0.25",
    )
    return figure


def _scene_figure(scene: Scene) -> Figure:
    flow, _ = flow_of(scene)
    first = scene.groups.wavenumber
    modes = first * np.array(FIRST_MODES)
    k = np.union1d(np.geomspace(0.6 * first, 9 * first, 45), modes)
    figure = Figure(figsize=(14, 4.8), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12)  # type: ignore[union-attr,call-arg]
    rates, critical, noise = figure.subplots(1, 3)
    for axes in (rates, critical, noise):
        axes.set(xscale="log", xlabel="k* = k √σ/γ", xlim=(k[0], k[-1]))
        _plain_logs(axes.xaxis)
        axes.grid(alpha=0.3)
    _growth_rates(rates, scene, flow, k, modes)
    _critical_density(critical, scene, k, modes)
    _noise(noise, scene, flow, k, modes)
    for axes in (rates, critical, noise):  # below, where they cover no curve
        axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3)
    figure.suptitle(
        f"{_name(scene)}     dots: modes n = 1 … {len(modes)} of the pipe, L* = {scene.groups.length:.4g}", fontsize=12
    )
    return figure


def _name(scene: Scene) -> str:
    number = scene.groups.collision_number
    if scene.operator == INELASTIC:
        return f"operator (12), ε = {scene.restitution:g}, R* = {number:.4g}"
    return f"operator (6), R* = {number:.4g}" if scene.operator else "no collisions"


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
        return float(s[0].real) if uncertainty[0] <= 1e-4 * abs(s[0]) else math.nan

    lowest = highest = 0.0
    for rate, colour, style, label in ((closure, CLOSURE, "--", "closure, M = 3"), (kinetic, KINETIC, "-", "kinetic equation")):
        curve = np.array([rate(float(value)) for value in k])
        _curve_and_dots(axes, k, curve, modes, color=colour, ls=style, label=label)
        lowest, highest = np.nanmin(curve, initial=lowest), np.nanmax(curve, initial=highest)
    axes.axhline(0, color="0.25", lw=1)
    low, high = 1.2 * lowest, max(1.2 * highest, 0.1 * min(-lowest, 3.0))
    if low < -3:  # short waves decay as -k*² and faster: a linear axis would flatten all else
        axes.set_yscale("asinh", linear_width=0.5)
        sizes = [10.0**n for n in range(9)] if low < -30 else [0.2, 0.5, 1, 2, 5, 10, 20]
        axes.set_yticks([tick for size in (0, *sizes) for tick in (-size, size) if low < tick < high])
        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}".replace("-", "−")))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.set(ylabel="growth rate Re s/γ", title="growth rates", ylim=(low, high))


def _curve_and_dots(axes: Any, k: Array, curve: Array, modes: Array, **style: Any) -> None:
    axes.plot(k, curve, lw=2, **style)
    axes.plot(modes, curve[np.isin(k, modes)], "o", color=style["color"], ms=5)


def _critical_density(axes: Any, scene: Scene, k: Array, modes: Array) -> None:
    density = scene.initial.density
    critical = np.array([critical_density(_at(scene, float(value))) for value in k])
    axes.axhline(density, color="0.25", lw=1.5, ls=":", label=f"the scene's, ρ = {density:g}")
    axes.set(ylabel="density ρ", title="critical density of the closure", yscale="log")
    if np.isinf(critical).all():
        low, high = density / 4, density * 4
        axes.text(
            0.5, 0.75, "the closure has none:\nstable at every density", ha="center", transform=axes.transAxes, color=CLOSURE
        )
    else:
        low, high = min(density, critical.min()) / 1.8, max(density, critical.max()) * 1.8
        axes.fill_between(k, critical, high, color=CLOSURE, alpha=0.12, lw=0)
        _curve_and_dots(axes, k, critical, modes, color=CLOSURE, ls="--", label="critical density, M = 3")
        axes.text(0.97, 0.96, "closure unstable", ha="right", va="top", transform=axes.transAxes, color=CLOSURE)
        axes.text(0.03, 0.04, "closure stable", transform=axes.transAxes, color="0.25")
    axes.set_ylim(low, high)
    _plain_logs(axes.yaxis, math.log10(high / low))


def _noise(axes: Any, scene: Scene, flow: Flow, k: Array, modes: Array) -> None:
    count = scene.particles.count
    curve = np.array([flow.structure_factor(float(value)) for value in k])
    _curve_and_dots(axes, k, curve, modes, color=KINETIC, label="S(k)")
    axes.axhline(1, color="0.25", lw=1, ls="--", label="ideal gas")
    top = min(max(3.0, 2 * float(curve[np.isfinite(curve)].max(initial=1.0))), 1e300)
    if top > count / 30 or np.isinf(curve).any():
        top = max(top, 3.0 * count)
        axes.axhline(count, color="0.25", lw=1.5, ls="-.", label="S = N, where linear theory ends")
    if np.isinf(curve).any():
        axes.text(0.5, 0.75, "S(k) > $10^{308}$ where not drawn", ha="center", transform=axes.transAxes, color=KINETIC)
    axes.set(ylabel="structure factor S(k)", title=f"noise of N = {count} particles", yscale="log", ylim=(0.7, top))
    _plain_logs(axes.yaxis, math.log10(top / 0.7))
    right = axes.secondary_yaxis("right", functions=(lambda s: 2 * np.sqrt(s / count), lambda a: count * a**2 / 4))
    right.set_ylabel("rms amplitude of a density wave, 2√(S/N)")
    _plain_logs(right.yaxis, math.log10(top / 0.7) / 2)


def _moments() -> Figure:
    short = np.array([critical_collision_number(math.inf, m) for m in MOMENTS])
    long = np.array([critical_collision_number(1.0, m) for m in MOMENTS if m <= RESOLVED])
    m = np.array(MOMENTS, dtype=float)
    figure = Figure(figsize=(7.5, 5), layout="constrained")
    axes = figure.subplots()
    axes.plot(m[: long.size], long, color=OTHER, marker="s", ms=5, lw=0.8, label="k* = 1")
    axes.plot(m, short, color=CLOSURE, marker="o", ms=5, lw=0.8, label="k* → ∞")
    axes.plot(m, 2 / 3 * np.sqrt(2 * (m - 1)), color="0.25", lw=1.5, ls="--", label=r"$\frac{2}{3}\sqrt{2(M-1)}$")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="moments M that the closure keeps",
        ylabel=r"critical collision number $R^*_c$",
        title="Closures with more moments lose stability at higher densities",
        xticks=[2, 4, 8, 16, 32, 64, 128],
    )
    line = {"arrowstyle": "-", "color": CLOSURE, "shrinkB": 5}
    axes.annotate("the paper's closure, M = 3", (3, short[1]), (4.4, 1.0), color=CLOSURE, arrowprops=line)
    axes.text(0.98, 0.04, "M → ∞, the kinetic equation: none", ha="right", transform=axes.transAxes, color=KINETIC)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda m, _: f"{m:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    _plain_logs(axes.yaxis)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="upper left")
    return figure


def _structure_factors() -> Figure:
    k = np.geomspace(0.02, 20, 46)
    figure = Figure(figsize=(12, 5), layout="constrained")
    leader, inelastic = figure.subplots(1, 2)
    for colour, number in zip(_colours(len(COLLISION_NUMBERS)), COLLISION_NUMBERS, strict=True):
        limit = math.exp(number**2) * (1 + math.erf(number))
        _labelled(leader, k, FollowLeaderFlow(number).structure_factor, limit, colour, f"R* = {number:g}")
    for colour, (restitution, number) in zip(_colours(len(INELASTIC_FLOWS)), INELASTIC_FLOWS, strict=True):
        limit = 1 / pressure_slope(restitution, number)
        factor = inelastic_flow(restitution, number).structure_factor
        _labelled(
            inelastic, k, factor, limit, colour, f"ε = {restitution:g}, R* = {number:g}", below=number == 1 and restitution > 0
        )
    leader.set(title="operator (6); marks: k → 0, exp(R*²)(1 + erf R*)", yscale="log", ylim=(0.4, 1e8))
    inelastic.set(title="operator (12); marks: k → 0, σ/(d(ρθ)/dρ)", yscale="log", ylim=(0.8, 20))
    for axes in (leader, inelastic):
        axes.set(xscale="log", xlabel="k* = k √σ/γ", ylabel="structure factor S(k)", xlim=(k[0] / 1.6, k[-1]))
        axes.axhline(1, color="0.25", lw=1, ls="--")
        axes.text(k[0] / 1.1, 0.97, "ideal gas", va="top", fontsize=9, color="0.25")
        axes.grid(alpha=0.3)
        _plain_logs(axes.xaxis, 3)
    _plain_logs(leader.yaxis, 8)
    _plain_logs(inelastic.yaxis)
    return figure


def pressure_slope(restitution: float, collision_number: float) -> float:
    """d(ρθ_h)/dρ of (12) over σ, to 1e-6: differences of order 4 in ln ρ, on which θ_h depends through R* alone."""

    def pressure(change: float) -> float:
        return (1 + change) * inelastic_flow(restitution, collision_number * (1 + change)).temperature

    h = 0.01
    return (8 * (pressure(h) - pressure(-h)) - (pressure(2 * h) - pressure(-2 * h))) / (12 * h)


def _labelled(
    axes: Any, k: Array, curve: Callable[[float], float], limit: float, colour: Any, label: str, below: bool = False
) -> None:
    """A curve, its limit as a mark at the left, and its name."""
    values = [curve(float(value)) for value in k]
    axes.plot(k, values, color=colour, lw=2)
    axes.plot([k[0] / 1.6, k[0] / 1.12], [limit, limit], color=colour, lw=4, solid_capstyle="butt")
    place, side = (0.96, "top") if below else (1.04, "bottom")
    axes.text(k[0] * 1.1, values[0] * place, label, color=colour, va=side, fontsize=9)


def _growth() -> Figure:
    """At k* = 1: long enough for R* to act, short enough for the spectrum's decay to show."""
    scene = Scene.model_validate(
        {
            "collisions": {"operator": "follow-the-leader", "cross_section": 2.0},
            "pipe": {"length": 2 * math.pi},
            "run": {"end_time": 1.0},
        }
    )
    flow, units = flow_of(scene)
    growth = transient_growth(scene)
    figure = Figure(figsize=(12, 5), layout="constrained")
    gain, state = figure.subplots(1, 2)
    numbers = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    t = np.linspace(0, 10, 401)
    for colour, number in zip(_colours(len(numbers)), numbers, strict=True):
        gain.plot(t, np.sqrt(FollowLeaderFlow(number).density_gain(1.0, t)), color=colour, lw=2, label=f"R* = {number:g}")
        if number == 2:
            gain.plot(growth["time"], np.sqrt(growth["gain"]), color=colour, lw=2, ls=":", label="R* = 2: √G, all of δf")
    gain.plot(t, np.exp(-t), color="0.25", lw=1, ls="--", label="exp(-k*²γt): a mode alone")
    gain.axhline(1, color="0.25", lw=0.8)
    gain.set(yscale="log", xlim=(0, 10), ylim=(1e-4, 1e4), xlabel="time γt", ylabel=r"$\sqrt{G_\rho}$, largest relative density")
    gain.set_title("largest growth at k* = 1: every mode decays, their sum first grows", fontsize=11)
    gain.legend(frameon=False, fontsize=9, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.11))
    _plain_logs(gain.yaxis, 8)
    gain.grid(alpha=0.3)
    best = growth["gain"].values.argmax()
    w = units.velocity(growth["v"].values)
    state.axhline(0, color="0.25", lw=0.8)
    state.plot(w, flow.distribution(w), color="0.25", lw=1.5, ls="--", label="homogeneous state f_h/ρ")
    state.plot(w, growth["optimal_real"], color=KINETIC, lw=2, label="Re δf(0)/ρ")
    state.plot(w, growth["optimal_imag"], color=CLOSURE, lw=2, ls="-.", label="Im δf(0)/ρ")
    state.set(xlim=(-6, 5), xlabel="(v - u_h)/√σ", ylabel="f, in units of ρ/√σ")
    at = f"√G = {math.sqrt(growth['gain'].values[best]):.3g} at γt = {growth['time'].values[best]:.3g}"
    state.set_title(f"what grows most at k* = 1, R* = 2: {at}", fontsize=11)
    state.legend(frameon=False, fontsize=9, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.11))
    state.grid(alpha=0.3)
    return figure
