"""Which kind of side a dataset or a file is."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from kinetic_solver.compare.ensembles import EnsembleSide
from kinetic_solver.compare.runs import RunSide
from kinetic_solver.compare.sides import Side
from kinetic_solver.dataset import open_netcdf, scene_of
from kinetic_solver.errors import SceneError
from particles.files import particle_names


def side_of(source: str | Path | xr.Dataset, name: str) -> Side:
    """The side that a file or a dataset is. Raises SceneError where it is neither a run nor particles."""
    dataset = source if isinstance(source, xr.Dataset) else _opened(source)
    scene = scene_of(dataset, name) if "scene" in dataset.attrs else None
    raw = particle_names(dataset) is not None
    if "density" not in dataset and not raw:
        raise SceneError(f"{name}: has neither density over (time, x) nor positions and velocities of particles")
    if raw and ("density" not in dataset or dataset.sizes.get("replica", 1) < 2):
        return EnsembleSide(dataset, name, scene)
    return RunSide(dataset, name, scene)


def _opened(path: str | Path) -> xr.Dataset:
    if not Path(path).is_file():
        raise SceneError(f"{path}: there is no such file")
    return open_netcdf(path)
