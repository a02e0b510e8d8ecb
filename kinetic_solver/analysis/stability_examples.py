"""Pictures of linear theory beyond one scene, those of docs/stability_details.md: closures of M moments, S(k), transient growth.

Blue is the kinetic equation, orange its closure; where curves differ in R*, darker is less.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from kinetic_solver.analysis.drawing import BLUE, GREEN, GREY, ORANGE, plain_logs, save, shades
from kinetic_solver.arrays import Array
from kinetic_solver.scene import Scene
from kinetic_solver.stability.amplification import transient_growth
from kinetic_solver.stability.closure import critical_collision_number
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.follow_leader import FollowLeaderFlow
from kinetic_solver.stability.homogeneous import pressure_slope
from kinetic_solver.stability.inelastic import inelastic_flow

KINETIC, CLOSURE, OTHER = BLUE, ORANGE, GREEN
MOMENTS = (2, 3, 4, 5, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128)
"""Moments M of the closures shown, about evenly spaced in log M."""
RESOLVED = 64
"""The most moments at which double precision resolves the closure's eigenvalues at k* = 1: R*_c then to 1e-7."""
COLLISION_NUMBERS = (0.5, 1.0, 1.347, 2.0, 3.0, 4.0)
"""R* of the structure factors of (6); 1.347 is the paper's closure's least R*_c."""
INELASTIC_FLOWS = ((0.5, 1.0), (0.0, 1.0), (0.5, 10.0), (0.9, 100.0))
"""(ε, R*) of the structure factors of (12)."""


def save_moments(path: str | Path) -> None:
    """R*_c of the closure with M moments: for short waves and at k* = 1, with (2/3)√(2(M - 1)). SceneError: cannot be written."""
    save(_moments(), path)


def save_structure_factors(path: str | Path) -> None:
    """S(k) over k* of both operators, at several R*. SceneError: cannot be written."""
    save(_structure_factors(), path)


def save_growth(path: str | Path) -> None:
    """√G_ρ over time of (6) at k* = 1, and the disturbance that grows most at R* = 2. SceneError: cannot be written."""
    save(_growth(), path)


def _moments() -> Figure:
    short = np.array([critical_collision_number(math.inf, m) for m in MOMENTS])
    long = np.array([critical_collision_number(1.0, m) for m in MOMENTS if m <= RESOLVED])
    m = np.array(MOMENTS, dtype=float)
    figure = Figure(figsize=(7.5, 5), layout="constrained")
    axes = figure.subplots()
    axes.plot(m[: long.size], long, color=OTHER, marker="s", ms=5, lw=0.8, label="k* = 1")
    axes.plot(m, short, color=CLOSURE, marker="o", ms=5, lw=0.8, label="k* → ∞")
    axes.plot(m, 2 / 3 * np.sqrt(2 * (m - 1)), color=GREY, lw=1.5, ls="--", label=r"$\frac{2}{3}\sqrt{2(M-1)}$")
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
    plain_logs(axes.yaxis)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="upper left")
    return figure


def _structure_factors() -> Figure:
    k = np.geomspace(0.02, 20, 46)
    figure = Figure(figsize=(12, 5), layout="constrained")
    leader, inelastic = figure.subplots(1, 2)
    for colour, number in zip(shades(len(COLLISION_NUMBERS)), COLLISION_NUMBERS, strict=True):
        limit = math.exp(number**2) * (1 + math.erf(number))
        _labelled(leader, k, FollowLeaderFlow(number).structure_factor, limit, colour, f"R* = {number:g}")
    for colour, (restitution, number) in zip(shades(len(INELASTIC_FLOWS)), INELASTIC_FLOWS, strict=True):
        limit = 1 / pressure_slope(restitution, number)
        factor = inelastic_flow(restitution, number).structure_factor
        _labelled(
            inelastic, k, factor, limit, colour, f"ε = {restitution:g}, R* = {number:g}", below=number == 1 and restitution > 0
        )
    leader.set(title="follow-the-leader collisions (6); bars: k → 0, exp(R*²)(1 + erf R*)", yscale="log", ylim=(0.4, 1e8))
    inelastic.set(title="inelastic collisions (12); bars: k → 0, σ/(d(ρθ)/dρ)", yscale="log", ylim=(0.8, 20))
    for axes in (leader, inelastic):
        axes.set(xscale="log", xlabel="k* = k √σ/γ", ylabel="structure factor S(k)", xlim=(k[0] / 1.6, k[-1]))
        axes.axhline(1, color=GREY, lw=1, ls="--")
        axes.text(k[0] / 1.1, 0.97, "ideal gas", va="top", fontsize=9, color=GREY)
        axes.grid(alpha=0.3)
        plain_logs(axes.xaxis, 3)
    plain_logs(leader.yaxis, 8)
    plain_logs(inelastic.yaxis)
    return figure


def _labelled(
    axes: Any, k: Array, curve: Callable[[float], float], limit: float, colour: Any, label: str, below: bool = False
) -> None:
    """A curve, its limit as a mark at the left, and its name."""
    values = [curve(float(value)) for value in k]
    axes.plot(k, values, color=colour, lw=2)
    axes.plot([k[0] / 1.6, k[0] / 1.12], [limit, limit], color=colour, lw=4, solid_capstyle="butt")
    place, side = (0.96, "top") if below else (1.04, "bottom")
    axes.text(k[0] * 1.1, values[0] * place, label, color="k", va=side, fontsize=9)


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
    for colour, number in zip(shades(len(numbers)), numbers, strict=True):
        gain.plot(t, np.sqrt(FollowLeaderFlow(number).density_gain(1.0, t)), color=colour, lw=2, label=f"R* = {number:g}")
        if number == 2:
            gain.plot(growth["time"], np.sqrt(growth["gain"]), color=colour, lw=2, ls=":", label="R* = 2: √G, all of δf")
    gain.plot(t, np.exp(-t), color=GREY, lw=1, ls="--", label="exp(-k*²γt): a mode alone")
    gain.axhline(1, color=GREY, lw=0.8)
    gain.set(yscale="log", xlim=(0, 10), ylim=(1e-4, 1e4), xlabel="time γt", ylabel=r"$\sqrt{G_\rho}$, largest relative density")
    gain.set_title("largest growth at k* = 1: each mode decays, yet their sum grows at first", fontsize=11)
    gain.legend(frameon=False, fontsize=9, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.11))
    plain_logs(gain.yaxis, 8)
    gain.grid(alpha=0.3)
    best = growth["gain"].values.argmax()
    w = units.velocity(growth["v"].values)
    state.axhline(0, color=GREY, lw=0.8)
    state.plot(w, flow.distribution(w), color=GREY, lw=1.5, ls="--", label="homogeneous state f_h/ρ")
    state.plot(w, growth["optimal_real"], color=KINETIC, lw=2, label="Re δf(0)/ρ")
    state.plot(w, growth["optimal_imag"], color=CLOSURE, lw=2, ls="-.", label="Im δf(0)/ρ")
    state.set(xlim=(-6, 5), xlabel="(v - u_h)/√σ", ylabel="f, in units of ρ/√σ")
    at = f"√G = {math.sqrt(growth['gain'].values[best]):.3g} at γt = {growth['time'].values[best]:.3g}"
    state.set_title(f"what grows most at k* = 1, R* = 2: {at}", fontsize=11)
    state.legend(frameon=False, fontsize=9, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.11))
    state.grid(alpha=0.3)
    return figure
