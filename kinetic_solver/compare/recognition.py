"""Which kind of side a dataset or a file is."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from kinetic_solver.compare.ensembles import EnsembleSide
from kinetic_solver.compare.runs import RunSide
from kinetic_solver.compare.sides import Side
from kinetic_solver.dataset import scene_of
from kinetic_solver.errors import SceneError
from particles.files import open_particles, particle_names, what_is_read


def side_of(source: str | Path | xr.Dataset, name: str) -> Side:
    """The side that a file or a dataset is. Raises SceneError where it is neither a run nor particles."""
    dataset = source if isinstance(source, xr.Dataset) else open_particles(source)
    scene = scene_of(dataset, name) if "scene" in dataset.attrs else None
    raw = particle_names(dataset) is not None
    if "density" not in dataset and not raw:
        raise SceneError(
            f"{name}: has neither density over (time, x) nor positions and velocities of particles ({what_is_read(dataset)})"
        )
    for coordinate in dataset.coords.values():
        if coordinate.dtype.kind in "mM":
            raise SceneError(
                f"{name}: its {coordinate.name} is of type {coordinate.dtype}; allowed: numbers, as xarray reads them with "
                "decode_times=False"
            )
    if raw and ("density" not in dataset or dataset.sizes.get("replica", 1) < 2):
        return EnsembleSide(dataset, name, scene)
    return RunSide(dataset, name, scene)
