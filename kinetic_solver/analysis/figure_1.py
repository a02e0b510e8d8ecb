"""The paper's Fig. 1 as a picture: the critical density of its three-moment closure over the mode number."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from kinetic_solver.analysis.drawing import GREY, ORANGE, save

if TYPE_CHECKING:
    import xarray as xr


def save_figure_1(dataset: xr.Dataset, path: str | Path) -> None:
    """Draw the dataset of `stability.figure_1()`: ρ_c over the mode number, R*_c at the right. SceneError: cannot be written."""
    save(_figure_1(dataset), path)


def _figure_1(dataset: xr.Dataset) -> Figure:
    n, density = dataset["mode"].values, dataset["critical_density"].values
    least = float(dataset.attrs["least_critical_density"])
    unit = float(density[0] / dataset["critical_collision_number"].values[0])
    """The density at which R* = 1."""
    figure = Figure(figsize=(8, 5.4), layout="constrained")
    axes: Any = figure.subplots()
    low, high, right = 0.75 * least, 1.06 * float(density.max()), float(n[-1])
    axes.axhline(least, color=GREY, lw=1, ls="--")
    axes.plot(n, density, color=ORANGE, lw=0.8, marker="o", ms=4.5)
    axes.text(right, least - 0.015 * (high - low), rf"$\rho_c^{{\min}}$ ≈ {least:g}, for n → ∞", ha="right", va="top", color=GREY)
    axes.text(right / 2, 0.35 * least + 0.65 * high, "closure unstable", ha="center", fontsize=13, color=ORANGE)
    axes.text(right / 2, low + 0.4 * (least - low), "closure stable", ha="center", fontsize=13, color=GREY)
    axes.set(xlabel="mode number n", ylabel=r"critical density $\rho_c$", xlim=(0, right + 1), ylim=(low, high))
    axes.set_title(dataset.attrs["title"], fontsize=12)
    other = axes.secondary_yaxis("right", functions=(lambda rho: rho / unit, lambda number: number * unit))
    other.set_ylabel(r"$R^*_c = S\,\rho_c\sqrt{\sigma}/\gamma$")
    units = f"{dataset.attrs['length']},  {dataset.attrs['cross_section']}".replace("ρ_c^min", r"$\rho_c^{\min}$")
    figure.supxlabel(
        f"A property of the three-moment closure; the kinetic equation is linearly stable at every density.\n{units}",
        fontsize=10,
        color=GREY,
    )
    return figure
