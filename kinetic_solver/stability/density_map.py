"""Linear theory of one pipe at many densities."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability.spectrum import FIRST_MODES
from kinetic_solver.stability.verdict import linear_theory

if TYPE_CHECKING:
    import xarray as xr


def over_densities(scene: Scene, densities: Iterable[float], modes: Iterable[int] = FIRST_MODES) -> xr.Dataset:
    """What the closure, the equation and noise do with each wave at each density: dims (density, mode).

    `closure_growth_rate` and `kinetic_growth_rate` (Re s), `largest_growth` (transient, √max G_ρ), `structure_factor` and more of
    `verdict.linear_theory`; `critical_density` of the closure and `wavenumber` (mode,); the coordinate `collision_number` is R*.
    All else is the scene's, `particles.count` included. Raises SceneError without friction and noise, and for densities that no
    scene has. Test: tests/linear_theory/test_density_map.py; worked example: docs/critical_density_map.py.
    """
    import xarray as xr

    found, numbers = [], [int(n) for n in modes]
    chosen = [float(density) for density in densities]
    if not chosen or not numbers:
        raise SceneError("densities, modes: one of them is empty; allowed: one number or more in each")
    groups = []
    for density in chosen:
        at = scene.replace(**{"initial.density": density})
        groups.append(at.groups.collision_number)
        found.append(linear_theory(at, numbers))
    along = xr.IndexVariable("density", chosen, {"long_name": "mean density", "units": "particles length-1"})
    same = {name: found[0][name] for name in ("wavenumber", "critical_density")}
    whole = xr.concat([one.drop_vars(list(same)) for one in found], along, combine_attrs="override")
    number = ("density", groups, {"long_name": "collision number R* = S ρ √σ/γ", "units": "1"})
    return whole.assign(same).assign_coords(collision_number=number)
