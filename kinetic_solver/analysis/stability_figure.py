"""Linear theory of a scene in one picture: growth rates, the closure's critical density, the noise of N particles.

Blue is the kinetic equation, orange its closure.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from kinetic_solver.analysis.drawing import BLUE, GREY, ORANGE, plain_logs, save
from kinetic_solver.arrays import Array
from kinetic_solver.scene import INELASTIC, Scene
from kinetic_solver.stability.closure import closure_rates, critical_density
from kinetic_solver.stability.flow import Flow, flow_of
from kinetic_solver.stability.spectrum import FIRST_MODES

KINETIC, CLOSURE = BLUE, ORANGE
SHORTEST_INELASTIC = 8.0
"""The largest k*√(θ_h/σ) at which the spectrum of (12) is drawn: shorter waves need ever more points in w."""


def save_scene_figure(scene: Scene, path: str | Path) -> None:
    """Over k*: growth rates of closure and kinetic equation; the closure's critical density; S(k), and what N particles show.

    Dots are the pipe's first modes. The spectrum of (12) is drawn where it is known to 1e-4 and k*√(θ_h/σ) ≤ 8: shorter waves
    want ever more points. Raises SceneError without friction and noise, and where the file cannot be written.
    """
    with np.errstate(over="ignore"):  # where S(k) is near the largest of numbers, its axis ends beyond it
        save(_scene_figure(scene), path)


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
        plain_logs(axes.xaxis)
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
        return f"inelastic collisions, ε = {scene.restitution:g}, R* = {number:.4g}"
    return f"follow-the-leader collisions, R* = {number:.4g}" if scene.operator else "no collisions"


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
    axes.axhline(0, color=GREY, lw=1)
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
    axes.axhline(density, color=GREY, lw=1.5, ls=":", label=f"the scene's, ρ = {density:g}")
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
        axes.text(0.03, 0.04, "closure stable", transform=axes.transAxes, color=GREY)
    axes.set_ylim(low, high)
    plain_logs(axes.yaxis, math.log10(high / low))


def _noise(axes: Any, scene: Scene, flow: Flow, k: Array, modes: Array) -> None:
    count = scene.particles.count
    curve = np.array([flow.structure_factor(float(value)) for value in k])
    _curve_and_dots(axes, k, curve, modes, color=KINETIC, label="S(k)")
    axes.axhline(1, color=GREY, lw=1, ls="--", label="ideal gas")
    top = min(max(3.0, 2 * float(curve[np.isfinite(curve)].max(initial=1.0))), 1e300)
    if top > count / 30 or np.isinf(curve).any():
        top = max(top, 3.0 * count)
        axes.axhline(count, color=GREY, lw=1.5, ls="-.", label="S = N, where linear theory ends")
    if np.isinf(curve).any():
        axes.text(0.5, 0.75, "S(k) > $10^{308}$ where not drawn", ha="center", transform=axes.transAxes, color=KINETIC)
    axes.set(ylabel="structure factor S(k)", title=f"noise of N = {count} particles", yscale="log", ylim=(0.7, top))
    plain_logs(axes.yaxis, math.log10(top / 0.7))
    right = axes.secondary_yaxis("right", functions=(lambda s: 2 * np.sqrt(s / count), lambda a: count * a**2 / 4))
    right.set_ylabel("rms amplitude of a density wave, 2√(S/N)")
    plain_logs(right.yaxis, math.log10(top / 0.7) / 2)
