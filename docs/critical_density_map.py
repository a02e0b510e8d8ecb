"""The critical-density map: what the paper's closure, the kinetic equation and the noise of particles do with every wave at
every density. One dataset over (density, mode), one figure.

    python docs/critical_density_map.py            # critical_density_map.nc and critical_density_map.png, four seconds
    python docs/critical_density_map.py docs/critical_density_map.png

What it shows: docs/stability_details.md, "The critical-density map".
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from kinetic_solver import Scene, stability
from kinetic_solver.scene import shipped

DENSITIES, MODES = np.linspace(0.05, 2.0, 40), range(1, 41)
LETTERS = "abcd"


def dataset(densities: Any = DENSITIES, modes: Any = MODES) -> xr.Dataset:
    """The pipe of scenes/pipe.toml, where R* = 2ρ and k* = n/4."""
    found = stability.over_densities(Scene.from_toml(shipped("pipe")), densities, modes)
    assert (found["kinetic_growth_rate"] < 0).all(), "the kinetic equation is stable at every density"
    return found


def figure(found: xr.Dataset) -> Figure:
    picture = Figure(figsize=(10, 7.4), layout="constrained")
    panels = picture.subplots(2, 2, sharex=True, sharey=True)
    rates = {"cmap": "RdBu_r", "norm": TwoSlopeNorm(0.0, -3.0, 3.0), "levels": np.linspace(-3, 3, 25), "extend": "both"}
    gains = {"cmap": "viridis", "norm": LogNorm(), "levels": np.geomspace(1, 160, 28)}
    factors = {"cmap": "magma", "norm": LogNorm(), "levels": np.geomspace(1, 2e7, 30)}
    closure, kinetic, growth, noise = (
        _map(axes, found, name, style)
        for axes, name, style in zip(
            panels.flat,
            ("closure_growth_rate", "kinetic_growth_rate", "largest_growth", "structure_factor"),
            (rates, rates, gains, factors),
            strict=True,
        )
    )
    picture.colorbar(closure, ax=panels[0, 0], label="Re s/γ", ticks=range(-3, 4))
    picture.colorbar(kinetic, ax=panels[0, 1], label="Re s/γ", ticks=range(-3, 4))
    picture.colorbar(growth, ax=panels[1, 0], label="largest √G", ticks=[1, 10, 100], format="%g")
    picture.colorbar(noise, ax=panels[1, 1], label="S(k)", ticks=10.0 ** np.arange(8))
    _contours(panels[0, 0], found, "closure_growth_rate", [-0.5, -0.3, 0.5, 1, 1.5, 2], "black")  # the sign is seen in grey too
    _contours(panels[0, 1], found, "kinetic_growth_rate", [-1, -0.3, -0.1], "black")
    _contours(panels[0, 1], found, "kinetic_growth_rate", [-30, -10, -3])
    _contours(panels[1, 0], found, "largest_growth", [1.1, 3, 10, 30, 100])
    _contours(panels[1, 1], found, "structure_factor", [10, 1e2, 1e3, 1e4, 1e5, 1e6])
    titles = (
        "closure (3)–(5): unstable above the line",
        "kinetic equation (2): stable at every density",
        "largest transient growth of a wave in (2)",
        "noise of N particles: of order one where S = N",
    )
    for letter, title, axes in zip(LETTERS, titles, panels.flat, strict=True):
        axes.set_title(f"({letter})  {title}", fontsize=10, loc="left")
    for axes in panels[1]:
        axes.set_xlabel("mode number n")
        axes.set_xticks([1, 2, 5, 10, 20, 40], ["1", "2", "5", "10", "20", "40"])
        axes.xaxis.set_minor_formatter(NullFormatter())
    for axes in panels[:, 0]:
        axes.set_ylabel("mean density ρ")
    per_density = float(found["collision_number"][0] / found["density"][0])
    for axes in panels[:, 1]:
        other = axes.secondary_yaxis("right", functions=(lambda rho: rho * per_density, lambda number: number / per_density))
        other.set_ylabel("R* = Sρ√σ/γ")
    return picture


def _map(axes: Any, found: xr.Dataset, name: str, style: dict[str, Any]) -> Any:
    mesh = axes.contourf(found["mode"], found["density"], found[name], **style)
    axes.plot(found["mode"], found["critical_density"], color="white", lw=2.6)
    axes.plot(found["mode"], found["critical_density"], color="black", lw=1.4, ls="--")
    axes.set(xscale="log", xlim=(found["mode"][0], found["mode"][-1]), ylim=(found["density"][0], found["density"][-1]))
    return mesh


def _contours(axes: Any, found: xr.Dataset, name: str, levels: list[float], colour: str = "white") -> None:
    lines = axes.contour(
        found["mode"], found["density"], found[name], levels=levels, colors=colour, linewidths=0.7, linestyles="-"
    )
    axes.clabel(lines, fontsize=8, fmt=lambda level: f"{level:g}" if abs(level) < 1000 else f"$10^{{{np.log10(level):.0f}}}$")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "critical_density_map.png")
    numbers = dataset()
    numbers.to_netcdf(target.with_suffix(".nc"))
    figure(numbers).savefig(target, dpi=120)
    print(f"wrote {target} and {target.with_suffix('.nc')}")
