"""The picture of a run."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kinetic_solver.analysis import panels
from kinetic_solver.analysis.drawing import ORANGE, save
from kinetic_solver.analysis.frames import chosen_frames, refuse_sweep, times_of
from kinetic_solver.analysis.titles import in_words, method_in_words, stopped_in_words
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import scene_of
from kinetic_solver.errors import SceneError

if TYPE_CHECKING:
    import xarray as xr

W = "velocity_distribution"
LETTERS = 11.0
"""Of the title, to an inch of the picture's width."""


def overview(dataset: xr.Dataset, times: Sequence[float] | None = None) -> Figure:
    """Density, mean velocity and temperature over (x, t), w(v), and, in a second row, f(x, v), at the same `times` as w(v).

    By default there are four times: the first, the last, and those between which f changes equally; up to twelve may be given.
    A homogeneous run (nx = 1) shows mean velocity and temperature over time; a run without w(v) profiles of its density.
    Fields on a grid are drawn through its points, by the trigonometric interpolant in x and a cubic spline in v; particles as
    they are in the file, with bands of one standard error. Raises SceneError where the dataset lacks the fields, and for a sweep.
    """
    refuse_sweep(dataset)
    if "density" not in dataset:
        method = dataset.attrs.get("method", "unknown")
        raise SceneError(f"the file has no 'density' (method: {method}); allowed: a run with output.moments = true")
    in_v, extended = W in dataset, dataset.sizes["x"] > 1
    with_f = "f" in dataset and extended
    led_by = "f" if "f" in dataset else W if in_v else "density"
    frames = chosen_frames(dataset, led_by, times)
    shown = times_of(dataset, led_by)[frames]
    names = [name for name in panels.FIELDS if name in dataset and (extended or name != "density")]
    rows = -(-len(frames) // panels.IN_A_ROW) if with_f else 0
    figure = Figure(figsize=(4.1 * len(names) + 3.7, 4.6 + 4 * rows), layout="constrained")
    top, *bottom = figure.subfigures(2 if rows else 1, 1, squeeze=False, height_ratios=[1.1, rows] if rows else [1])[:, 0]
    *left, right = top.subplots(1, len(names) + 1)
    for axes, name in zip(left, names, strict=True):
        if extended:
            panels.field_map(axes, dataset, name, shown)
        else:
            panels.history(axes, dataset, name)
    if in_v:
        panels.velocity_distribution(right, dataset, _nearest(dataset, W, shown))
    else:
        panels.profiles(right, dataset, "density", _nearest(dataset, "density", shown))
    if with_f:
        panels.phase_space(bottom[0], dataset, frames)
    _title(figure, dataset)
    return figure


def save_overview(dataset: xr.Dataset, path: str | Path, times: Sequence[float] | None = None) -> None:
    """Draw `overview` into a file; its ending gives the format."""
    save(overview(dataset, times), path)


def _nearest(dataset: xr.Dataset, name: str, shown: Array) -> list[int]:
    t = times_of(dataset, name)
    return sorted({int(np.abs(t - time).argmin()) for time in shown})


def _title(figure: Figure, dataset: xr.Dataset) -> None:
    """The scene; the method and its grid; in colour, what a reader must know before the picture is believed."""
    said = [in_words(scene_of(dataset)), method_in_words(dataset)]
    warned = ["\n".join(textwrap.wrap(stopped_in_words(dataset), int(LETTERS * figure.get_figwidth())))]
    if dataset.sizes["x"] > 1 and panels.are_beads(dataset):
        warned.append("fronts move far between frames, which the map shows as beads: a smaller run.output_every shows them move")
    figure.suptitle("\n".join(said), fontsize=11)
    if any(warned):
        figure.supxlabel("\n".join(filter(None, warned)), fontsize=11, color=ORANGE)
