"""`ds.kinetic`: what one wants to know of a run's dataset, of whatever method, in memory or from a file.

Nothing is loaded but what is asked for: from a file that was opened lazily, `f` at one time is one frame.
Tests: tests/interface/test_accessor.py.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from kinetic_solver.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

MOMENTS = ("density", "mean_velocity", "temperature", "heat_flux")
TERMS = ("gravity", "friction", "noise", "collisions")


@xr.register_dataset_accessor("kinetic")
class KineticAccessor:
    """Of a dataset of this software (docs/output.md). Methods raise SceneError where it lacks what they need."""

    def __init__(self, ds: xr.Dataset) -> None:
        self._ds = ds

    def moments(self) -> xr.Dataset:
        """Density, mean velocity, temperature, heat flux over (time, x): as written, else as sums over the velocities of f."""
        ds = self._ds
        if "density" in ds:
            return ds[[name for name in MOMENTS if name in ds]]
        f = self._need("f", "output.moments or output.f")
        from kinetic_solver.dataset import VARIABLES, scales_of, velocity_axis

        over = velocity_axis(f)
        s, origin = (1.0, 0.0) if over == "v" else scales_of(f)
        dv = float(ds[over][1] - ds[over][0])
        density = f.sum(over) * dv
        u = (f * ds[over]).sum(over) * dv / density
        c = ds[over] - u
        found = (density, origin + s * u, s**2 * (f * c**2).sum(over) * dv / density, s**3 * (f * c**3).sum(over) * dv)
        named = {}
        for name, field in zip(MOMENTS, found, strict=True):
            _, units, long_name = VARIABLES["moments"][name]
            field.attrs = {"long_name": long_name, "units": units}
            named[name] = field
        return xr.Dataset(named, attrs=ds.attrs)

    def growth_rate(self, mode: int | Iterable[int]) -> xr.DataArray:
        """Re s of the density mode, ∝ exp(ikx + st), fitted to the run; NaN where it cannot be measured.

        With the coordinates `frequency`, `uncertainty`, `kinetic_growth_rate`, `closure_growth_rate`, … of `measured_rates`.
        One mode gives a number, several an array over `mode`.
        """
        from kinetic_solver.analysis.measured_rates import measured_rates

        found = measured_rates(self._ds, [mode] if isinstance(mode, int) else mode)
        rates = found["growth_rate"].assign_coords({name: found[name] for name in found.data_vars if name != "growth_rate"})
        return rates.isel(mode=0) if isinstance(mode, int) else rates

    def modes(self) -> xr.DataArray:
        """c_n(t) = (1/L)∫ρ exp(-ikx) dx over the mean density, complex, over (time, mode), with k as `wavenumber`.

        Of particles the mean over replicas of what they themselves have, not of their density at points.
        """
        import numpy as np

        from kinetic_solver.analysis.measured_rates import mode_amplitudes
        from kinetic_solver.dataset import scene_of

        ds, length = self._ds, scene_of(self._ds).pipe.length
        if "density_mode_real" in ds:
            found = (ds["density_mode_real"] + 1j * ds["density_mode_imag"]).mean("replica")
        else:
            density = self._need("density", "output.moments")
            c = mode_amplitudes(ds)
            found = xr.DataArray(c, dims=[str(density.dims[0]), "mode"], coords={density.dims[0]: density[density.dims[0]]})
            found = found.assign_coords(mode=np.arange(c.shape[1]))
        found = found.assign_coords(wavenumber=2 * np.pi / length * found["mode"])
        return found.rename("density_mode").assign_attrs(long_name="density mode over the mean density", units="1")

    def budgets(self) -> xr.Dataset:
        """Rates of momentum and energy, and what each term has brought since time 0, over (term, time); and the residuals."""
        ds = self._ds
        if "momentum_rate_gravity" not in ds:
            raise SceneError("the dataset has no budgets; allowed: a run on the grid or of the closure, output.budgets = true")
        result = ds[[name for name in ("mass", "momentum", "energy") if name in ds]]
        for name in ("momentum_rate", "momentum_from", "energy_rate", "energy_from"):
            there = [term for term in TERMS if f"{name}_{term}" in ds]
            terms = xr.concat([ds[f"{name}_{term}"].rename(name) for term in there], "term", combine_attrs="override")
            what = "rate of" if name.endswith("rate") else "brought since time 0:"
            terms = terms.assign_attrs(long_name=f"{what} {name.partition('_')[0]} by terms").assign_coords(term=there)
            result[name] = terms.reindex(term=list(TERMS))
        for name in ("mass", "momentum", "energy"):
            result[f"{name}_residual"] = ds[f"{name}_residual"]
        return result

    def at(self, x: ArrayLike | None = None, v: ArrayLike | None = None) -> xr.Dataset:
        """Fields at any places and velocities, between the points too: spectrally in x (docs/using.md)."""
        from kinetic_solver.analysis.resampling import at

        return at(self._ds, x, v)

    def plot_density(self, axes: Any = None) -> Any:
        """The density over (x, time), or over time alone where nothing depends on x; returns matplotlib's axes."""
        density = self._need("density", "output.moments").squeeze("x" if self._ds.sizes["x"] == 1 else None)
        return _labelled(density, axes, **({"cmap": "magma"} if density.ndim == 2 else {}))

    def plot_f(self, time: float | None = None, axes: Any = None) -> Any:
        """f over (x, v), or over v where nothing depends on x, at the frame nearest to `time`, by default the last one."""
        f = self._need("f", "output.f")
        frame = f.isel({f.dims[0]: -1}) if time is None else f.sel({f.dims[0]: time}, method="nearest")
        frame = frame.transpose(..., "x").squeeze("x" if self._ds.sizes["x"] == 1 else None)
        return _labelled(frame, axes, **({"cmap": "magma", "vmin": 0, "extend": "neither"} if frame.ndim == 2 else {}))

    def plot_velocity_distribution(self, times: Sequence[float] | None = None, axes: Any = None) -> Any:
        """w(v) at the frames nearest to `times`, by default the first and the last one."""
        w = self._need("velocity_distribution", "output.moments")
        over = w.dims[0]
        shown = w.isel({over: [0, -1]}) if times is None else w.sel({over: list(times)}, method="nearest")
        return _labelled(shown, axes, hue=str(over))

    def plot_budgets(self, of: str = "energy", axes: Any = None) -> Any:
        """What each term has brought of "energy" or "momentum" since time 0, over time."""
        if of not in ("energy", "momentum"):
            raise SceneError(f"of = {of!r}: allowed: 'energy' or 'momentum'")
        return _labelled(self.budgets()[f"{of}_from"].dropna("term", how="all"), axes, hue="term")

    def animate(self, path: str | Path | None = None, fps: float | None = None, overwrite: bool = False) -> Any:
        """A movie: f(x, v) with the density above and w(v) beside it, one picture for each frame.

        With a path it is written, .gif or .mp4, and the path returned; without one it is matplotlib's animation, for notebooks
        (`HTML(ds.kinetic.animate().to_jshtml())`) and windows. A file is read a frame at a time. `fps` and errors as of
        `kinetic_solver.analysis.animation.save_animation`.
        """
        from kinetic_solver.analysis.animation import animation, save_animation

        if path is None:
            return animation(self._ds, fps)
        save_animation(self._ds, path, fps, overwrite)
        return path

    def _need(self, name: str, key: str) -> xr.DataArray:
        if name not in self._ds:
            raise SceneError(f"the dataset has no {name!r}; allowed: a run of a method that has it, with {key} = true")
        return self._ds[name]


def _labelled(field: xr.DataArray, axes: Any, **options: Any) -> Any:
    """Drawn by xarray, which takes labels and units from the attributes; the axes are new ones where none are given."""
    if axes is None:
        import matplotlib.pyplot as plt

        axes = plt.figure(layout="constrained").subplots()
    if (hue := options.get("hue")) is None:
        plane: dict[str, Any] = {"x": "x", "rasterized": True} if field.ndim == 2 else {}
        field.plot(ax=axes, **plane, **options)
        return axes
    lines = field.plot.line(ax=axes, add_legend=False, **options)
    for line, style in zip(lines, itertools.cycle(("-", "--", "-.", ":"))):  # to be told apart in grey
        line.set_linestyle(style)
    names = [
        value if isinstance(value, str) else f"{hue.partition('_')[0]} = {value:.4g}" for value in field[hue].values.tolist()
    ]
    axes.legend(lines, names, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=4)
    return axes
