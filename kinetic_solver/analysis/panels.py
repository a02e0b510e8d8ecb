"""The parts of the picture of a run: a field over (x, t), w(v), f(x, v), profiles, histories."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from kinetic_solver.analysis.drawing import DASHES, GREY, shades
from kinetic_solver.analysis.frames import FINE_V, fine_v, fine_x, frame_of, is_counted, some, times_of
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of, velocity_axis
from kinetic_solver.scene import INELASTIC
from kinetic_solver.stability.homogeneous import homogeneous_state

if TYPE_CHECKING:
    import xarray as xr

LIGHTEST = 0.85
"""Shade of the curve at the last time."""
IN_A_ROW = 4
"""Panels of f(x, v) beside one another: narrower ones would show little."""
MOST_ROWS, MOST_COLUMNS = 1000, 1000
"""Of a map of colours: its axes have some 500 dots."""
FIELDS = {
    "density": ("density", "ρ", "magma"),
    "mean_velocity": ("mean velocity", "u", "viridis"),
    "temperature": ("temperature", "θ", "cividis"),
}
"""Field over (x, t) → its name, its symbol, and a map of colours whose lightness rises throughout, so that it reads in grey."""
DECADES = 30.0
"""A temperature that spans more than this factor is drawn on a logarithmic scale."""
JUMP = 0.4
"""Of the range of the density: frames between which it changes by more somewhere show a moving front as a row of beads."""
ROUNDING = 1e-9
"""Of a field's scale: what varies by less is rounding, and is drawn level. Chosen: above all rounding, below what rtol is for."""
OUTLIERS = 0.02
"""Share of the places of a field of particles at either end of its range that may have the colour of the end: a velocity or a
temperature is a quotient, and means nothing where few particles are."""
FAR = 3.0
"""Outliers are told apart where the whole range is that much wider than the range without them."""


SCALED_LABEL = "scaled velocity (v − u)/s"
"""Of a run that cools (dataset/scaled.py)."""


def legend_below(axes: Any, columns: int) -> None:
    """Under the axes, where it covers no curve."""
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns, columnspacing=1.0)


def field_map(axes: Any, dataset: xr.Dataset, name: str, marked: Array) -> None:
    """A field over (x, t), white lines at the `marked` times; of up to two frames, its profiles."""
    t = times_of(dataset, name)
    rows = some(t.size, MOST_ROWS)
    title, symbol, colours = FIELDS[name]
    if t.size < 3:
        profiles(axes, dataset, name, list(range(t.size)))
        return
    values = dataset[name].isel({dataset[name].dims[0]: rows}).values
    if is_counted(dataset) and name != "density" and "temperature" in dataset:
        # Where few particles are, the waves of their density may cancel: quotients by it are no velocity, no temperature.
        values = np.where(dataset["temperature"].isel({dataset[name].dims[0]: rows}).values > 0, values, np.nan)
    x, values = fine_x(dataset, values, axis=1)
    columns = some(x.size, MOST_COLUMNS)
    x, values = x[columns], values[:, columns]
    smooth = not is_counted(dataset) and bool(np.isfinite(values).all())
    # Counts hold between the edges of cells, and until the next frame.
    shading = "gouraud" if smooth else "nearest"
    values = np.ma.masked_invalid(values)
    low, high, extend = _range(dataset, name, values)
    logarithmic = name == "temperature" and low > 0 and high > DECADES * low
    norm = LogNorm(low, high) if logarithmic else Normalize(low, high)
    mesh = axes.pcolormesh(x, t[rows], values, cmap=colours, norm=norm, shading=shading, rasterized=True)
    axes.figure.colorbar(mesh, ax=axes, label=symbol, pad=0.02, extend=extend)
    for time in marked[(marked > t[0]) & (marked < t[-1])]:
        axes.axhline(time, color="w", lw=0.6, ls=(0, (2, 4)))
    under = "x (white: too few particles)" if is_counted(dataset) and np.ma.count_masked(values) else "x"
    axes.set(xlabel=under, ylabel="time t", title=title, xlim=(0, x[-1]), ylim=(t[0], t[-1]))


def _range(dataset: xr.Dataset, name: str, values: Any) -> tuple[float, float, Any]:
    """(lowest, highest, at which ends there is more) of a map's colours."""
    found = np.ma.masked_invalid(values).compressed()
    if not found.size:
        return 0.0, 1.0, "neither"
    low, high = float(found.min()), float(found.max())
    if is_counted(dataset):
        least, most = (float(part) for part in np.quantile(found, [OUTLIERS, 1 - OUTLIERS]))
        if high - low > FAR * (most - least) > 0:
            return least, most, "both"
    return *(_level(dataset, name, low, high) or (low, high)), "neither"


def _level(dataset: xr.Dataset, name: str, low: float, high: float) -> tuple[float, float] | None:
    """Limits of an axis for a field that is level but for rounding, which an axis of its own would blow up; None for others."""
    scale = max(abs(low), abs(high))
    if name == "mean_velocity" and "temperature" in dataset:
        warmest = float(np.max(np.nan_to_num(frame_of(dataset, "temperature", 0))))
        scale = max(scale, max(warmest, 0.0) ** 0.5)
    if scale == 0 or not high - low <= ROUNDING * scale:
        return None
    return (low + high) / 2 - 0.5 * scale, (low + high) / 2 + 0.5 * scale


def are_beads(dataset: xr.Dataset) -> bool:
    """Whether the frames are too far apart for the picture of the density to show where its fronts went in between."""
    t = times_of(dataset, "density")
    rho = dataset["density"].isel({dataset["density"].dims[0]: some(t.size, MOST_ROWS)}).values
    if t.size < 3 or t.size > MOST_ROWS or is_counted(dataset):
        return False
    moved = np.abs(np.diff(rho, axis=0)).max(axis=1) > JUMP * np.ptp(rho, axis=1)[:-1]
    matters = np.ptp(rho, axis=1)[:-1] > 0.1 * np.ptp(rho)
    return bool(moved[matters].mean() > 0.25) if matters.any() else False


def profiles(axes: Any, dataset: xr.Dataset, name: str, shown: list[int]) -> None:
    """A field over x at some of its frames, with its standard error where it has one."""
    t, (title, symbol, _) = times_of(dataset, name), FIELDS[name]
    for colour, n in zip(shades(len(shown), LIGHTEST), shown, strict=True):
        x, values = fine_x(dataset, frame_of(dataset, name, n), axis=0)
        axes.plot(x, values, color=colour, lw=2, label=f"t = {t[n]:.3g}")
        if f"{name}_stderr" in dataset:
            error = frame_of(dataset, f"{name}_stderr", n)
            error = np.append(error, error[0])
            axes.fill_between(x, values - error, values + error, color=colour, alpha=0.25, lw=0)
    axes.set(xlabel="x", ylabel=symbol, title=title, xlim=(0, x[-1]))
    drawn = np.concatenate([line.get_ydata() for line in axes.get_lines()])
    if np.isfinite(drawn).any() and (level := _level(dataset, name, float(np.nanmin(drawn)), float(np.nanmax(drawn)))):
        axes.set_ylim(level)
    axes.ticklabel_format(axis="y", useOffset=False)
    legend_below(axes, 4)


def velocity_distribution(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    """w(v), each frame under a Gaussian of its mean and variance; of particles as steps, with bands of one standard error."""
    over = velocity_axis(dataset)
    t, v = times_of(dataset, "velocity_distribution"), dataset[over].values
    w = {n: frame_of(dataset, "velocity_distribution", n) for n in shown}
    dv = v[1] - v[0]
    edges = np.append(v - dv / 2, v[-1] + dv / 2)
    top = max(float(values.max()) for values in w.values())
    visible = v[np.any([values > 1e-3 * top for values in w.values()], axis=0)]
    shown_v = (float(visible[0]), float(visible[-1]))
    for colour, n in zip(shades(len(shown), LIGHTEST), shown, strict=True):
        mass = w[n].sum() * dv
        mean = (v * w[n]).sum() * dv / mass
        variance = ((v - mean) ** 2 * w[n]).sum() * dv / mass
        if is_counted(dataset):
            axes.stairs(w[n], edges, color=colour, lw=1, label=f"t = {t[n]:.3g}")
            if "velocity_distribution_stderr" in dataset:
                error = frame_of(dataset, "velocity_distribution_stderr", n)
                axes.stairs(w[n] + error, edges, baseline=w[n] - error, fill=True, color=colour, alpha=0.45, lw=0)
            fine = np.linspace(v[0], v[-1], FINE_V)
        else:
            fine, curve = fine_v(dataset, w[n], shown_v)
            axes.plot(fine, curve, color=colour, lw=3.5, alpha=0.6, label=f"t = {t[n]:.3g}")
        gaussian = mass * np.exp(-((fine - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
        axes.plot(fine, gaussian, color="k", lw=0.8, ls=DASHES, zorder=3)  # thin and on top: seen where it is w(v) itself
    axes.plot([], [], color="k", lw=0.8, ls=DASHES, label="Gaussian of its\nmean and variance")
    labels = {"xlabel": "v", "ylabel": "w(v)"} if over == "v" else {"xlabel": SCALED_LABEL, "ylabel": "s w(v)"}
    axes.set(**labels, title="velocity distribution", xlim=shown_v, ylim=(0, None))
    legend_below(axes, 3)


def phase_space(figure: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    """f(x, v) side by side with one scale of colours; of particles at the file's own points."""
    t, frames = times_of(dataset, "f"), []
    v = dataset[velocity_axis(dataset)].values
    highest = np.array([frame_of(dataset, "f", n).max(axis=0) for n in shown]).max(axis=0)
    visible = v[highest > 2e-3 * highest.max()]
    shown_v = (float(visible[0]), float(visible[-1]))
    for n in shown:
        x, f = fine_x(dataset, frame_of(dataset, "f", n), axis=0)
        fine, f = fine_v(dataset, f, shown_v)
        frames.append(f)
    top = max(float(f.max()) for f in frames)
    columns = min(len(shown), IN_A_ROW)
    panels = figure.subplots(-(-len(shown) // columns), columns, sharey=True, squeeze=False)
    for axes in panels.flat[len(shown) :]:
        axes.set_axis_off()
    shading = "nearest" if is_counted(dataset) else "gouraud"
    mesh = None
    for axes, n, f in zip(panels.flat[: len(shown)], shown, frames, strict=True):
        mesh = axes.pcolormesh(x, fine, f.T, cmap="magma", shading=shading, vmin=0, vmax=top, rasterized=True)
        axes.set(xlabel="x", title=f"f(x, v), t = {t[n]:.3g}", xlim=(0, x[-1]), ylim=shown_v)
    scaled = velocity_axis(dataset) != "v"
    for axes in panels[:, 0]:
        axes.set_ylabel(SCALED_LABEL if scaled else "velocity v")
    figure.colorbar(mesh, ax=panels, pad=0.01, aspect=30, label="s f" if scaled else "f")


def history(axes: Any, dataset: xr.Dataset, name: str) -> None:
    """A field of a homogeneous run over time, beside its stationary value, or Haff's law."""
    scene, t = scene_of(dataset), times_of(dataset, name)
    (title, symbol, _), values = FIELDS[name], dataset[name].values[: t.size, 0]
    axes.plot(t, values, color="C0", lw=2, label="the run")
    if f"{name}_stderr" in dataset:
        error = dataset[f"{name}_stderr"].values[: t.size, 0]
        axes.fill_between(t, values - error, values + error, color="C0", alpha=0.3, lw=0)
    state = homogeneous_state(scene)
    if state is not None:
        stationary = {"mean_velocity": state.mean_velocity, "temperature": state.temperature}[name]
        axes.axhline(stationary, color=GREY, lw=1, ls="--", label=f"stationary: {stationary:.6g}")
    elif name == "temperature" and scene.operator == INELASTIC and scene.model.friction == 0:
        rate = scene.cross_section * (1 - scene.restitution**2) * scene.initial.density * np.sqrt(values[0] / np.pi)
        axes.plot(t, values[0] / (1 + rate * (t - t[0])) ** 2, color=GREY, lw=1, ls="--", label="Haff's law")
    axes.set(xlabel="time t", ylabel=symbol, title=title)
    if name == "temperature" and values.min() > 0 and values.max() > DECADES * values.min():
        axes.set(yscale="log")
        if velocity_axis(dataset) != "v" and t.size > 2:
            axes.set(xscale="log", xlim=(t[1], t[-1]))  # it cools as 1/t²
    elif name == "temperature":
        axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
    if level := _level(dataset, name, float(values.min()), float(values.max())):
        axes.set_ylim(level if name == "mean_velocity" else (0, level[1]))
    if axes.get_yscale() == "linear":
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(alpha=0.3)
    legend_below(axes, 2)
