"""The picture of a comparison."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinetic_solver.analysis.drawing import BLUE, GREY, ORANGE, save
from kinetic_solver.compare.comparison import Comparison
from kinetic_solver.compare.rows import MEAN, Row

FIRST, SECOND = BLUE, ORANGE
"""Colours of the two sides."""
SYSTEMATIC = "0.75"
"""Colour of the band in which the two may differ."""
TINY = 0.02
"""Of the bound: smaller differences are drawn on a logarithmic scale."""
BOUND = "bound of the systematic part"
BAND = "two standard errors more: one point in twenty is beyond by chance"
"""What the two bands are."""
NAMES = {
    "density": "density ρ",
    "mean_velocity": "mean velocity u",
    "temperature": "temperature θ",
    "velocity_distribution": "w(v)",
}
"""Fields that are drawn, as they are called."""


def save_comparison(found: Comparison, path: str | Path) -> None:
    """Both sides' fields at the time at which they differ most, and below them the differences in standard errors.

    Without chance the lower row is the difference over the bound on its systematic part. Raises SceneError where the file cannot
    be written.
    """
    save(comparison_figure(found), path)


def comparison_figure(found: Comparison) -> Figure:
    """The figure that `save_comparison` writes."""
    shown = [row for row in found.rows if row.field in NAMES]
    worst = min(shown, key=lambda row: (row.p, -row.time))
    rows = [row for row in shown if row.time == worst.time or math.isnan(worst.time)]
    figure = Figure(figsize=(3.6 * len(rows), 6.2), layout="constrained")
    axes = figure.subplots(2, len(rows), sharex="col", squeeze=False, height_ratios=[1.6, 1])
    names = [side.split(":")[0] for side in found.sides]
    for row, (top, bottom) in zip(rows, axes.T, strict=True):
        _fields(top, row, names)
        _differences(bottom, row)
    drawn = dict[str, Any]()
    for panel in axes.flat:
        drawn |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    figure.legend(drawn.values(), drawn.keys(), fontsize=8, loc="outside lower center", ncols=len(drawn), frameon=False)
    when = "mean over the frames after the first" if worst.time == MEAN else f"t = {worst.time:g}, where they differ most"
    figure.suptitle(f"{when}     {found.verdict}", fontsize=11)
    return figure


def _fields(axes: Axes, row: Row, names: list[str]) -> None:
    axes.plot(row.points, row.first, color=FIRST, lw=1.6, label=names[0])
    axes.errorbar(row.points, row.second, np.nan_to_num(row.error), color=SECOND, fmt=".", ms=4, lw=0.8, label=names[1])
    axes.set_title(NAMES[row.field], fontsize=10)
    axes.margins(x=0.02)


def _differences(axes: Axes, row: Row) -> None:
    axes.set_xlabel("v" if row.field == "velocity_distribution" else "x")
    if not np.isfinite(row.z).any():
        share = row.difference / row.bound
        if 0 < np.nanmax(np.abs(share)) < TINY:  # a straight line, else
            axes.semilogy(row.points, np.abs(share), ".", color=GREY, ms=4)
            axes.axhline(1, color=SYSTEMATIC, lw=4, label=BOUND)
            axes.set_ylabel("|difference| over its bound", fontsize=8)
            return
        axes.axhspan(-1, 1, color=SYSTEMATIC, zorder=0, label=BOUND)
        axes.plot(row.points, share, ".-", color=GREY, lw=0.8, ms=4)
        axes.set_ylabel("difference over its bound", fontsize=8)
        return
    allowed = row.bound / row.error
    axes.fill_between(row.points, -allowed, allowed, color=SYSTEMATIC, zorder=0.5, label=BOUND)
    axes.fill_between(row.points, -2 - allowed, 2 + allowed, color="0.9", zorder=0, label=BAND)
    axes.plot(row.points, row.difference / row.error, ".-", color=GREY, lw=0.8, ms=4)
    axes.set_ylabel("difference, standard errors", fontsize=8)
