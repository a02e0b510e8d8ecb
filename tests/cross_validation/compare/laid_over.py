"""Scenes, runs and helpers of the comparisons' tests."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import xarray as xr

from kinetic_solver import Scene, exact, solve
from kinetic_solver.compare import Comparison
from kinetic_solver.compare.rows import MEAN
from kinetic_solver.compare.values import OVER_X, TOTALS
from particles.simulation import simulate

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
HOMOGENEOUS: dict[str, Any] = {"modes": []}
GRID = {"nx": 17, "nv": 48}
FEW = {"count": 2000, "replicas": 20}
W = "velocity_distribution"
SEEN = {*OVER_X, W, *TOTALS}
"""Fields that any two runs share; f has a cadence of its own."""

# Scenes are immutable: one run of each serves all tests.
ensemble, truth, on_the_grid = functools.cache(simulate), functools.cache(exact.solve), functools.cache(solve)


def fields(found: Comparison) -> set[str]:
    return {row.field for row in found.rows}


def times(found: Comparison, field: str | None = None) -> set[float]:
    """Those of a field, or of all; the mean over frames has none."""
    return {row.time for row in found.rows if row.time != MEAN and field in (None, row.field)}


def raw(run: xr.Dataset, names: tuple[str, str] = ("x", "v"), **frame: int) -> xr.Dataset:
    """The positions and velocities of a run alone, in dimensions of other names, without its scene."""
    dimensions = [name if name.startswith("time") else f"{name}_of_raw" for name in run["position"].dims]
    data = {new: (dimensions, run[old].values) for new, old in zip(names, ("position", "velocity"), strict=True)}
    times = [name for name in dimensions if name.startswith("time")]
    return xr.Dataset(data, {name: run[name].values for name in times}).isel({f"{k}_of_raw": n for k, n in frame.items()})


def with_collisions(make_scene: MakeScene, number: float, **changes: Any) -> Scene:
    table = {"operator": "follow-the-leader", "cross_section": number * 0.7 / math.sqrt(0.5) / 0.8}
    return make_scene(**{"collisions": table, "particles": {"count": 1000}, **changes})
