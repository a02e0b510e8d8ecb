"""One scene above the closure's critical density by every description of the paper's system: density over (x, t), side by side.

The closure (3)-(5), more moments, the kinetic equation (2), and particles, few and many, from the same waves. What it shows, and
why: docs/clusters_details.md and docs/hydrodynamics_details.md. The scene is that of scenes/closure.toml.
Tests: tests/paper/test_closure_figure.py.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from kinetic_solver import hydrodynamics
from kinetic_solver.analysis.drawing import BLUE, GREEN, GREY, ORANGE, plain_logs, save
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import attributes, scene_of
from kinetic_solver.errors import SceneError, SolverStopped
from kinetic_solver.scene import Scene
from kinetic_solver.solver import solve

MOMENTS = 8
"""M of the Hermite hierarchy: stable here, since its critical density is at R* = 2.51 for the shortest waves."""
POINTS = 128
"""Of the deterministic descriptions in the dataset; the waves of the start have 25 or more each."""
CLOSURE_REFINED = 4
"""Times as many points for the closure, whose fronts are sharp. On 257, 513, 1025, 1537 points it runs away at γt = 5.996, 5.995,
5.932, 5.909: before the next frame after 5.9."""
PARTICLE_POINTS = 64
"""Of the particles' density, of which waves up to 31 are kept (docs/particles_details.md)."""
COUNTS = (10_000, 1_000_000)
"""Particles."""
LIGHT, DARK = 0.6, 1.5
"""Densities over ρ̄ between which the one colour scale runs; what is beyond has the colour of its end."""

Say = Callable[[str], None]


def closure_scene(seed: int = 1) -> Scene:
    """R* = 2, L* = 8π, waves of 10, 5 and 4 %, γ = σ = ρ̄ = 1; g = 5 makes density waves fall slowly."""
    waves = [{"mode": mode, "cos": cos} for mode, cos in ((1, 0.1), (3, 0.05), (5, 0.04))]
    return Scene.model_validate(
        {
            "model": {"gravity": 5.0},
            "collisions": {"operator": "follow-the-leader", "cross_section": 2.0},
            "pipe": {"length": 8 * math.pi},
            "initial": {"density": 1.0, "modes": waves},
            "run": {"end_time": 16.0, "output_every": 0.1},
            "output": {"f": False, "budgets": False},
            "accuracy": {"rtol": 1e-3},
            "particles": {"count": COUNTS[-1], "seed": seed, "replicas": 1},
        }
    )


def descriptions(scene: Scene, say: Say | None = None) -> xr.Dataset:
    """The scene's density over its mean by each description, at the frames of the run.

    `closure`, `moments`, `kinetic` over (time, x); `particles` over (time, count, point). Attributes: `closure_stops`, the last
    frame before the closure ran away, after which it is NaN (the end of the run if it did not), and `hierarchy_moments`. `say`
    is told what comes next. Raises SolverStopped where any other description stops.
    """
    from particles.simulation import simulate

    def next_is(text: str) -> None:
        if say is not None:
            say(text)

    times = scene.times()
    mean = scene.initial.density
    next_is("the closure (3)-(5)")
    closure, stops = _closure(scene, times)
    next_is(f"{MOMENTS} moments")
    moments = hydrodynamics.solve(_changed(scene, grid={"nx": POINTS}, hydrodynamics={"moments": MOMENTS}))
    next_is("the kinetic equation (2)")
    with warnings.catch_warnings():
        # Points that are given are kept, with a warning where rtol asks for more: here it asks for less
        warnings.simplefilter("ignore")
        kinetic = solve(_changed(scene, grid={"nx": POINTS}))
    ensembles = []
    for count in COUNTS:
        next_is(f"{count} particles")
        changed = _changed(
            scene, grid={"nx": PARTICLE_POINTS}, particles={"count": count, "seed": scene.particles.seed, "replicas": 1}
        )
        ensembles.append(simulate(changed)["density"].values / mean)
    relative = {"long_name": "density over its mean", "units": "1"}
    data = {
        "closure": (("time", "x"), closure / mean, relative),
        "moments": (("time", "x"), moments["density"].values / mean, relative),
        "kinetic": (("time", "x"), kinetic["density"].values / mean, relative),
        "particles": (("time", "count", "point"), np.stack(ensembles, axis=1), relative),
    }
    place = scene.pipe.length * np.arange(POINTS) / POINTS
    points = scene.pipe.length * np.arange(PARTICLE_POINTS) / PARTICLE_POINTS
    coordinates = {"time": times, "x": place, "point": points, "count": np.array(COUNTS)}
    about = {**attributes(scene, "comparison"), "closure_stops": stops, "hierarchy_moments": MOMENTS}
    return xr.Dataset(data, coordinates, about)


def _changed(scene: Scene, **tables: dict[str, Any]) -> Scene:
    return Scene.model_validate({**scene.model_dump(by_alias=True, exclude_none=True), **tables})


def _closure(scene: Scene, times: Array) -> tuple[Array, float]:
    """(density (time, x), NaN after the runaway; the last frame before that)."""
    fine = _changed(scene, grid={"nx": CLOSURE_REFINED * POINTS})
    stops = float(times[-1])
    with warnings.catch_warnings():
        # rtol is not reached once there are jumps: the picture shows them as sharp as its points are
        warnings.simplefilter("ignore")
        try:
            run = hydrodynamics.solve(fine)
        except SolverStopped as stop:
            if stop.dataset is None:
                raise
            run = stop.dataset
            stops = float(run["time"][-1])
    density = run["density"].values[:, ::CLOSURE_REFINED]
    whole = np.full((times.size, POINTS), np.nan)
    whole[: density.shape[0]] = density
    return whole, stops


def contrast(density: Array) -> Array:
    """Standard deviation over x of the density over its mean, at each time."""
    return np.asarray(density.std(axis=-1) / density.mean(axis=-1))


def closure_summary(dataset: xr.Dataset) -> list[str]:
    """Every description in one line: contrast at the start and at the end, and the range of the density at the end."""
    lines = [f"{'':<32}{'contrast, start':>16}{'end':>8}{'density, end':>16}"]
    for name, density, _ in _panels(dataset):
        seen = density[np.isfinite(density[:, 0])]
        spread = contrast(seen)
        lines.append(
            f"{name:<32}{spread[0]:16.3f}{spread[-1]:8.3f}{seen[-1].min():9.2f} –{seen[-1].max():5.2f}"
            + ("" if len(seen) == len(density) else f"   runs away after t = {dataset.attrs['closure_stops']:.3g}")
        )
    return lines


def _panels(dataset: xr.Dataset) -> list[tuple[str, Array, Array]]:
    """(name, density over its mean (time, place), places)."""
    x, points = dataset["x"].values, dataset["point"].values
    names = ("Paper's closure: 3 moments", f"{dataset.attrs['hierarchy_moments']} moments", "The kinetic equation (2)")
    fields = ("closure", "moments", "kinetic")
    found = [(name, dataset[field].values, x) for name, field in zip(names, fields, strict=True)]
    for count in dataset["count"].values:
        found.append((f"{_grouped(int(count))} particles", dataset["particles"].sel(count=count).values, points))
    return found


def _grouped(count: int) -> str:
    """1000000 → "1 000 000", with the narrow spaces of print."""
    return f"{count:,}".replace(",", "\N{THIN SPACE}")


def closure_figure(dataset: xr.Dataset) -> Figure:
    """Panels of the density over (x, t), as `plot` has them, one colour scale, and in the last the contrast of each over time."""
    scene, times = scene_of(dataset), dataset["time"].values
    figure = Figure(figsize=(9.3, 5.5), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06, hspace=0.03, wspace=0.02))
    axes = figure.subplots(2, 3)
    panels = _panels(dataset)
    mesh = None
    for place, (name, density, x) in zip(axes.flat[: len(panels)], panels, strict=True):
        whole = np.isfinite(density[:, 0])
        half, frame = scene.pipe.length / x.size / 2, (times[1] - times[0]) / 2
        mesh = place.imshow(
            np.append(density[whole], density[whole, :1], axis=1),  # the period's end is its beginning
            cmap="magma",
            vmin=LIGHT,
            vmax=DARK,
            aspect="auto",
            origin="lower",
            extent=(-half, scene.pipe.length + half, times[0] - frame, times[whole][-1] + frame),
            interpolation="bilinear",
        )
        place.set(xlim=(0, scene.pipe.length), ylim=(times[0], times[-1]), yticks=_whole(times))
        place.set_title(name, fontsize=10, loc="left")
        for side in ("top", "right"):
            place.spines[side].set_visible(False)
        if not whole.all():
            middle = (times[whole][-1] + times[-1]) / 2
            text = f"runs away\nafter γt = {scene.model.friction * dataset.attrs['closure_stops']:.3g}"
            place.text(scene.pipe.length / 2, middle, text, ha="center", va="center", fontsize=11, color=GREY)
    _contrasts(axes[1, 2], dataset, panels)
    for place in axes[:, 0]:
        place.set_ylabel("time γt")
    for place in (*axes[1, :2], axes[0, 2]):
        place.set_xlabel("x, down the pipe")
    axes[1, 2].set_xlabel("time γt")
    for place in (*axes[:, 1], axes[0, 2]):
        place.set_yticklabels([])
    assert mesh is not None
    bar = figure.colorbar(mesh, ax=axes, extend="both", aspect=38, pad=0.015)
    bar.set_label("density over its mean")
    bar.outline.set_visible(False)
    number = scene.groups.collision_number
    figure.suptitle(f"The same pipe, R* = {number:g}, from the same waves: which description clusters?", fontsize=13)
    return figure


def _whole(times: Array) -> Array:
    """Four ticks or so, at whole numbers where the run is long enough for them."""
    step = max(1.0, float(times[-1]) // 4) if times[-1] > 2 else float(times[-1]) / 4
    return np.arange(times[0], times[-1] + 0.5 * step, step)


def _contrasts(place: Any, dataset: xr.Dataset, panels: list[tuple[str, Array, Array]]) -> None:
    times = dataset["time"].values
    styles = [(ORANGE, "-", 2.2), (GREEN, "-", 4.5), ("black", "--", 1.6), ("#56B4E9", "-.", 1.4), (BLUE, ":", 1.8)]
    names = ["closure", f"{dataset.attrs['hierarchy_moments']} moments", "equation (2)"]
    names += [name for name, *_ in panels[3:]]
    for (_, density, _), (colour, line, width), name in zip(panels, styles, names, strict=True):
        place.plot(times, contrast(density), color=colour, ls=line, lw=width, label=name)
    place.set(yscale="log", xlim=(times[0], times[-1]), ylim=(0.006, 0.5), xticks=_whole(times))
    plain_logs(place.yaxis)
    place.yaxis.tick_right()
    place.set_title("Contrast: standard deviation/mean", fontsize=10, loc="left")
    for side in ("top", "left"):
        place.spines[side].set_visible(False)
    place.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0, -0.02), handlelength=1.8, labelspacing=0.3)


def save_closure_figure(dataset: xr.Dataset, path: str | Path) -> None:
    """Draw `closure_figure` into a file; its ending gives the format."""
    save(closure_figure(dataset), path)


def refuse_options(operator: str, count: int | None) -> None:
    """Raises SceneError for what this picture has no choice of."""
    if operator != "follow-the-leader":
        raise SceneError(f"figure closure: operator = {operator!r}; allowed: 'follow-the-leader', whose closure is unstable")
    if count is not None:
        both = " and ".join(str(n) for n in COUNTS)
        raise SceneError(f"figure closure: count = {count}; it has {both} particles: allowed with figures 2 and 3 alone")
