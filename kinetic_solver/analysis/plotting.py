"""Pictures of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from kinetic_solver.analysis.drawing import save, shades
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of, velocity_axis
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import INELASTIC, Scene
from kinetic_solver.scene.cadence import SAME_TIME
from kinetic_solver.stability.homogeneous import homogeneous_state

if TYPE_CHECKING:
    import xarray as xr

LIGHTEST = 0.85
"""Shade of the curve at the last time."""
MOST_FRAMES = 400
"""Frames between which it is seen how much a field changes. Chosen: four of them are shown."""
SCALED_LABELS = {"xlabel": "scaled velocity (v − u)/s", "ylabel": "s w(v, t)"}
"""Of a run that cools (dataset/scaled.py)."""
MOST_ROWS, MOST_COLUMNS = 1000, 1000
"""Of a map of colours: its axes have some 800 dots."""


def overview(dataset: xr.Dataset, times: Sequence[float] | None = None) -> Figure:
    """Density over (x, t), w(v) with its Gaussian, and f(x, v) at up to four `times`; without w(v), profiles of the density.

    By default the times are the first, the last, and those between which f changes equally. A homogeneous run (nx = 1) shows its
    temperature over time instead, with the stationary value or Haff's law. Fields are drawn through the grid's points
    by the trigonometric interpolant in x and a cubic spline in v. Raises SceneError where the dataset lacks the fields.
    """
    if "density" not in dataset:
        method = dataset.attrs.get("method", "unknown")
        raise SceneError(f"the file has no 'density' (method: {method}); allowed: a run with output.moments = true")
    in_v = "velocity_distribution" in dataset
    extended = dataset.sizes["x"] > 1
    with_f = "f" in dataset and extended
    shown = _frames(dataset, "velocity_distribution" if in_v else "density", times)
    figure = Figure(figsize=(12, 8.6 if with_f else 5), layout="constrained")
    top, *bottom = figure.subfigures(2 if with_f else 1, 1, squeeze=False, height_ratios=[1.1, 1] if with_f else [1])[:, 0]
    left, right = top.subplots(1, 2, width_ratios=[1.15, 1])
    (_density_map if extended else _temperature_history)(left, dataset)
    (_velocity_distribution if in_v else _density_profiles)(right, dataset, shown)
    if with_f:
        _phase_space(bottom[0], dataset, times)
    figure.suptitle(_title(scene_of(dataset)), fontsize=12)
    return figure


def save_overview(dataset: xr.Dataset, path: str | Path, times: Sequence[float] | None = None) -> None:
    """Draw `overview` into a file; its ending gives the format."""
    save(overview(dataset, times), path)


def _title(scene: Scene) -> str:
    parts = [f"g = {scene.model.gravity:g}, γ = {scene.model.friction:g}, σ = {scene.model.noise:g}"]
    if scene.collisions is None:
        parts.append("no collisions")
    else:
        kind: str = scene.collisions.operator
        if scene.collisions.restitution is not None:
            kind += f", ε = {scene.collisions.restitution:g}"
        parts.append(kind)
        number = scene.groups.collision_number
        rate = scene.cross_section * scene.initial.density
        parts.append(f"R* = {number:.3g}" if np.isfinite(number) else f"Sρ = {rate:.3g}")
    return "     ".join(parts)


def _frames(dataset: xr.Dataset, name: str, times: Sequence[float] | None, count: int = 4) -> list[int]:
    """Indices of the frames nearest to `times`; by default `count` of them, between which the field changes equally.

    Raises SceneError for a time beyond the frames."""
    t = _times(dataset, name)
    if not t.size:
        raise SceneError("the file has no frame yet")
    if times is not None:
        for time in times:
            if not t[0] <= time <= t[-1] * (1 + SAME_TIME):
                raise SceneError(f"time {time:g}: is beyond the frames of the file; allowed: {t[0]:g} to {t[-1]:g}")
        return sorted({int(np.abs(t - time).argmin()) for time in times})[:count]
    looked = _some(t.size, MOST_FRAMES)
    change, before = [0.0], _frame(dataset, name, 0)
    for n in looked[1:]:
        now = _frame(dataset, name, n)
        change.append(float(np.abs(now - before).sum()))
        before = now
    path = np.cumsum(change)
    return sorted({int(looked[np.abs(path - part).argmin()]) for part in np.linspace(0, path[-1], count)})


def _some(count: int, most: int) -> Array:
    """Indices of that many of `count` frames, evenly, both ends among them; all where there are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _frame(dataset: xr.Dataset, name: str, n: int) -> Array:
    """One frame: a file is read no further."""
    return np.asarray(dataset[name].isel({dataset[name].dims[0]: n}).values)


def _times(dataset: xr.Dataset, name: str) -> Array:
    """Times of the frames of `name` that are complete."""
    dimension, *others = map(str, dataset[name].dims)
    whole = np.isfinite(dataset[name].isel(dict.fromkeys(others, 0)).values)
    return np.asarray(dataset[dimension].values[whole], dtype=float)


def _period(dataset: xr.Dataset) -> float:
    return scene_of(dataset).pipe.length


def _fine_x(values: Array, length: float, axis: int) -> tuple[Array, Array]:
    """(x, values) on at least 240 intervals of the period, its end included, by the trigonometric interpolant."""
    nx = values.shape[axis]
    factor = max(1, -(-240 // nx))
    spectrum = np.fft.rfft(values, axis=axis)
    if nx % 2 == 0 and factor > 1:  # the Nyquist cosine becomes an ordinary mode, which counts twice
        spectrum[(slice(None),) * axis + (-1,)] /= 2
    fine = np.fft.irfft(spectrum, n=nx * factor, axis=axis) * factor
    return np.linspace(0, length, nx * factor + 1), np.concatenate([fine, fine.take([0], axis=axis)], axis=axis)


def _fine_v(v: Array, values: Array, axis: int) -> tuple[Array, Array]:
    """(v, values) on at least 300 points, by a cubic spline."""
    from scipy.interpolate import make_interp_spline

    if v.size >= 300:
        return v, values
    fine = np.linspace(v[0], v[-1], 400)
    return fine, make_interp_spline(v, values, k=3, axis=axis)(fine)


def _legend_below(axes: Any, columns: int) -> None:
    """Under the axes, where it covers no curve."""
    axes.legend(frameon=False, fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=min(columns, 3))


def _density_map(axes: Any, dataset: xr.Dataset) -> None:
    t = _times(dataset, "density")
    rows = _some(t.size, MOST_ROWS)
    t = t[rows]
    x, rho = _fine_x(dataset["density"].isel({dataset["density"].dims[0]: rows}).values, _period(dataset), axis=1)
    if t.size > 2:
        columns = _some(x.size, MOST_COLUMNS)
        x, rho = x[columns], rho[:, columns]
        mesh = axes.pcolormesh(x, t, rho, cmap="magma", shading="gouraud", rasterized=True)
        axes.figure.colorbar(mesh, ax=axes, label="density ρ", pad=0.01)
        axes.set(xlabel="x", ylabel="time t", title="density ρ(x, t)", xlim=(0, x[-1]))
        return
    for colour, time, row in zip(shades(t.size, LIGHTEST), t, rho, strict=True):
        axes.plot(x, row, color=colour, lw=2, label=f"t = {time:.3g}")
    axes.set(xlabel="x", ylabel="density ρ", title="density ρ(x)", xlim=(0, x[-1]))
    _legend_below(axes, t.size)


def _temperature_history(axes: Any, dataset: xr.Dataset) -> None:
    scene, t = scene_of(dataset), _times(dataset, "temperature")
    theta = dataset["temperature"].values[: t.size, 0]
    axes.plot(t, theta, color="C0", lw=2, label="θ(t)")
    state = homogeneous_state(scene)
    if state is not None:
        axes.axhline(state.temperature, color="0.4", lw=1, ls="--", label=f"stationary, θ = {state.temperature:.6g}")
    elif scene.operator == INELASTIC and scene.model.friction == 0:
        rate = scene.cross_section * (1 - scene.restitution**2) * scene.initial.density * np.sqrt(theta[0] / np.pi)
        axes.plot(t, theta[0] / (1 + rate * (t - t[0])) ** 2, color="0.4", lw=1, ls="--", label="Haff's law (Maxwellian gas)")
    axes.set(xlabel="time t", ylabel="temperature θ", title="temperature θ(t)")
    if theta.min() > 0 and theta.max() > 30 * theta.min():
        axes.set(yscale="log")
        if velocity_axis(dataset) != "v" and t.size > 2:
            axes.set(xscale="log", xlim=(t[1], t[-1]))  # it cools as 1/t²
    else:
        axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
    axes.grid(alpha=0.3)
    _legend_below(axes, 2)


def _density_profiles(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    """In place of w(v), where a run has none: hydrodynamics. As it is at its points, since shocks have no interpolant."""
    t, length = _times(dataset, "density"), _period(dataset)
    x = np.append(dataset["x"].values, length)
    for colour, n in zip(shades(len(shown), LIGHTEST), shown, strict=True):
        rho = _frame(dataset, "density", n)
        axes.plot(x, np.append(rho, rho[0]), color=colour, lw=2, label=f"t = {t[n]:.3g}")
    axes.set(xlabel="x", ylabel="ρ(x, t)", title="density", xlim=(0, length))
    axes.legend(frameon=False)


def _velocity_distribution(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    over = velocity_axis(dataset)
    t, v = _times(dataset, "velocity_distribution"), dataset[over].values
    w = {n: _frame(dataset, "velocity_distribution", n) for n in shown}
    dv = v[1] - v[0]
    top = max(float(values.max()) for values in w.values())
    for colour, n in zip(shades(len(shown), LIGHTEST), shown, strict=True):
        mass = w[n].sum() * dv
        mean = (v * w[n]).sum() * dv / mass
        variance = ((v - mean) ** 2 * w[n]).sum() * dv / mass
        fine, curve = _fine_v(v, w[n], axis=0)
        gaussian = mass * np.exp(-((fine - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
        axes.plot(fine, curve, color=colour, lw=2, label=f"t = {t[n]:.3g}")
        axes.plot(fine, gaussian, color=colour, lw=1, ls=(0, (3, 2)))
    axes.plot([], [], color="0.4", lw=1, ls=(0, (3, 2)), label="Gaussian, same moments")
    visible = v[np.any([values > 1e-3 * top for values in w.values()], axis=0)]
    labels = {"xlabel": "v", "ylabel": "w(v, t)"} if over == "v" else SCALED_LABELS
    axes.set(**labels, title="velocity distribution", xlim=(visible[0], visible[-1]), ylim=(0, None))
    _legend_below(axes, len(shown) + 1)


def _phase_space(figure: Any, dataset: xr.Dataset, times: Sequence[float] | None) -> None:
    shown = _frames(dataset, "f", times)
    t, v = _times(dataset, "f"), dataset[velocity_axis(dataset)].values
    frames = []
    for n in shown:
        x, f = _fine_x(_frame(dataset, "f", n), _period(dataset), axis=0)
        fine, f = _fine_v(v, f, axis=1)
        frames.append(f)
    top = max(float(f.max()) for f in frames)
    visible = np.flatnonzero(np.max([f.max(axis=0) for f in frames], axis=0) > 2e-3 * top)
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    mesh = None
    for axes, n, f in zip(panels, shown, frames, strict=True):
        mesh = axes.pcolormesh(x, fine, f.T, cmap="magma", shading="gouraud", vmin=0, vmax=top, rasterized=True)
        axes.set(xlabel="x", title=f"f(x, v), t = {t[n]:.3g}", xlim=(0, x[-1]), ylim=(fine[visible[0]], fine[visible[-1]]))
    panels[0].set_ylabel("velocity v" if velocity_axis(dataset) == "v" else SCALED_LABELS["xlabel"])
    figure.colorbar(mesh, ax=panels, pad=0.01, aspect=30)
