"""Pictures of a run. Imported only when asked for; draws on its own canvas, so no display is needed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from kinetic_solver.arrays import Array
from kinetic_solver.scene import SceneError

if TYPE_CHECKING:
    import xarray as xr


def overview(dataset: xr.Dataset, times: Sequence[float] | None = None) -> Figure:
    """Density over (x, t) and profiles, w(v) with its Gaussian, and f(x, v) at up to four `times` (default: spread evenly).

    For a homogeneous run (nx = 1), the density gives way to the temperature over time and f(x, v) to f(v).
    Raises SceneError where the dataset lacks the fields.
    """
    for name in ("density", "velocity_distribution"):
        if name not in dataset:
            raise SceneError(f"the file has no {name!r}; set output.moments = true")
    shown = _frames(dataset, "density", times)
    extended = dataset.sizes["x"] > 1
    with_f = "f" in dataset and extended
    figure = Figure(figsize=(12, 8.2 if with_f else 4.6), layout="constrained")
    top, *bottom = figure.subfigures(2 if with_f else 1, 1, squeeze=False, height_ratios=[1, 1] if with_f else [1])[:, 0]
    left, right = top.subplots(1, 2, width_ratios=[1.15, 1])
    (_density_map if extended else _temperature_history)(left, dataset, shown)
    _velocity_distribution(right, dataset, shown)
    if with_f:
        _phase_space(bottom[0], dataset, times)
    figure.suptitle(_title(dataset), fontsize=12)
    return figure


def save_overview(dataset: xr.Dataset, path: str | Path, times: Sequence[float] | None = None) -> None:
    """Draw `overview` into a file; its ending gives the format."""
    figure = overview(dataset, times)
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be written ({error})") from None


def _title(dataset: xr.Dataset) -> str:
    from kinetic_solver.scene import Scene

    scene = Scene.model_validate(json.loads(dataset.attrs["scene"]))
    parts = [f"g = {scene.model.gravity:g}, γ = {scene.model.friction:g}, σ = {scene.model.noise:g}"]
    if scene.collisions is None:
        parts.append("no collisions")
    else:
        kind: str = scene.collisions.operator
        if scene.collisions.restitution is not None:
            kind += f", ε = {scene.collisions.restitution:g}"
        parts.append(kind)
        parts.append(f"R* = {scene.groups.collision_number:.3g}")
    return "     ".join(parts)


def _frames(dataset: xr.Dataset, name: str, times: Sequence[float] | None, count: int = 4) -> list[int]:
    t = _times(dataset, name)
    if not t.size:
        raise SceneError("the file has no frame yet")
    wanted = np.linspace(t[0], t[-1], count) if times is None else np.asarray(times, dtype=float)
    return sorted({int(np.abs(t - time).argmin()) for time in wanted})


def _times(dataset: xr.Dataset, name: str) -> Array:
    """Times of the frames of `name` that are complete."""
    dimension = str(dataset[name].dims[0])
    whole = np.isfinite(dataset[name].values.reshape(dataset.sizes[dimension], -1)[:, 0])
    return np.asarray(dataset[dimension].values[whole], dtype=float)


def _colours(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.0, 0.85, count))


def _density_map(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    t, x = _times(dataset, "density"), dataset["x"].values
    length = x[1] * x.size
    rho = dataset["density"].values[: t.size]
    if t.size > 2:
        # The first column again at x = L: the pipe is periodic.
        mesh = axes.pcolormesh(
            np.append(x, length), t, np.hstack([rho, rho[:, :1]]), cmap="magma", shading="gouraud", rasterized=True
        )
        axes.figure.colorbar(mesh, ax=axes, label="density ρ", pad=0.01)
        axes.set(xlabel="x", ylabel="time t", title="density ρ(x, t)", xlim=(0, length))
    else:
        for colour, n in zip(_colours(len(shown)), shown, strict=True):
            axes.plot(np.append(x, length), np.append(rho[n], rho[n, 0]), color=colour, label=f"t = {t[n]:.3g}")
        axes.set(xlabel="x", ylabel="density ρ", title="density ρ(x)", xlim=(0, length))
        axes.legend(frameon=False)


def _temperature_history(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    t = _times(dataset, "temperature")
    axes.plot(t, dataset["temperature"].values[: t.size, 0], color="C0")
    axes.set(xlabel="time t", ylabel="temperature θ", title="temperature θ(t)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)


def _velocity_distribution(axes: Any, dataset: xr.Dataset, shown: list[int]) -> None:
    t, v = _times(dataset, "velocity_distribution"), dataset["v"].values
    w = dataset["velocity_distribution"].values
    dv = v[1] - v[0]
    top = 0.0
    for colour, n in zip(_colours(len(shown)), shown, strict=True):
        mass = w[n].sum() * dv
        mean = (v * w[n]).sum() * dv / mass
        variance = ((v - mean) ** 2 * w[n]).sum() * dv / mass
        gaussian = mass * np.exp(-((v - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)
        axes.plot(v, w[n], color=colour, lw=2, label=f"t = {t[n]:.3g}")
        axes.plot(v, gaussian, color=colour, lw=1, ls=(0, (3, 2)))
        top = max(top, float(w[n].max()))
    axes.plot([], [], color="0.4", lw=1, ls=(0, (3, 2)), label="Gaussian of the same\nmean and variance")
    visible = v[(w[shown] > 1e-3 * top).any(axis=0)]
    axes.set(xlabel="v", ylabel="w(v, t)", title="velocity distribution", xlim=(visible[0], visible[-1]), ylim=(0, None))
    axes.legend(frameon=False, fontsize=9)


def _phase_space(figure: Any, dataset: xr.Dataset, times: Sequence[float] | None) -> None:
    shown = _frames(dataset, "f", times)[:4]
    t, x, v = _times(dataset, "f"), dataset["x"].values, dataset["v"].values
    frames = [dataset["f"].values[n] for n in shown]
    top = max(float(f.max()) for f in frames)
    rows = np.max([f.max(axis=0) for f in frames], axis=0)
    visible = np.flatnonzero(rows > 2e-3 * top)
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    length = x[1] * x.size
    mesh = None
    for axes, n, f in zip(panels, shown, frames, strict=True):
        closed = np.vstack([f, f[:1]])
        mesh = axes.pcolormesh(
            np.append(x, length), v, closed.T, cmap="magma", shading="gouraud", vmin=0, vmax=top, rasterized=True
        )
        axes.set(xlabel="x", title=f"f(x, v), t = {t[n]:.3g}", xlim=(0, length), ylim=(v[visible[0]], v[visible[-1]]))
    panels[0].set_ylabel("velocity v")
    figure.colorbar(mesh, ax=panels, pad=0.01, aspect=30)
