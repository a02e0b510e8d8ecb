"""Which kind of side a dataset or a file is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeAlias

import xarray as xr

from kinetic_solver.compare.ensembles import EnsembleSide
from kinetic_solver.compare.runs import RunSide
from kinetic_solver.compare.sides import Side
from kinetic_solver.dataset import in_velocities, on_scales_of, scales_of, scene_of
from kinetic_solver.dataset.schema import SCALED
from kinetic_solver.errors import SceneError
from particles.files import open_particles, particle_names, what_is_read

Source: TypeAlias = "str | Path | xr.Dataset"


def over_the_same_velocities(first: Source, second: Source) -> tuple[xr.Dataset, xr.Dataset]:
    """Both over the velocities of one kind, called v: of two runs over scaled ones those of the first, otherwise velocities."""
    a, b = (source if isinstance(source, xr.Dataset) else open_particles(source) for source in (first, second))
    for side, source in ((a, first), (b, second)):
        if "swept" in side.attrs:
            name = "the dataset" if isinstance(source, xr.Dataset) else source
            raise SceneError(
                f"{name}: is a sweep over {', '.join(json.loads(side.attrs['swept']))}; allowed: the file of one run, as those "
                "in the sweep's folder points"
            )
    scaled = [SCALED in side.dims for side in (a, b)]
    if all(scaled):
        return a.rename({SCALED: "v"}), on_scales_of(b, a).rename({SCALED: "v"})
    return (_in_those_of(a, b), b) if scaled[0] else (a, _in_those_of(b, a)) if scaled[1] else (a, b)


def _in_those_of(run: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Without velocities of its own, as of particles or hydrodynamics, the run's at its first frame."""
    if "v" in other.dims and other.sizes["v"] > 1:
        return in_velocities(run, other["v"].values)
    field = run["f"] if "f" in run else run["velocity_distribution"]
    s, origin = (float(value[0]) for value in scales_of(field))
    return in_velocities(run, origin + s * run[SCALED].values)


def side_of(dataset: xr.Dataset, name: str) -> Side:
    """The side that a dataset is. Raises SceneError where it is neither a run nor particles."""
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
