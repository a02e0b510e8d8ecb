"""What cannot be compared says so in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import SceneError
from kinetic_solver.compare import compare
from tests.cross_validation.compare.laid_over import GRID, MakeScene, ensemble, on_the_grid, raw, truth, with_collisions


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ({"pipe": {"length": 9.1}}, {}, "pipe.length: 9.1 in A, 9 in B; allowed: the same"),
        ({"output": {"moments": False}}, {}, "A: has neither density over"),
        ({"run": {"end_time": 0.5}, "output": {"moments": 0.5}}, None, "nothing to compare: not compared: 3 times"),
    ],
    ids=["length", "no moments", "no time"],
)
def test_refusals_of_runs(make_scene: MakeScene, first: dict[str, Any], second: dict[str, Any] | None, message: str) -> None:
    other = truth(make_scene(**(second or {})))
    if second is None:
        other = other.isel(time=[1])
    with pytest.raises(SceneError, match=message):
        compare(truth(make_scene(**first)), other)


def test_refusals_of_particles(make_scene: MakeScene, run: xr.Dataset) -> None:
    with pytest.raises(SceneError, match="A, B: neither has a scene, so the period is not known"):
        compare(raw(run), raw(run))
    one = ensemble(make_scene(particles={"count": 2000, "replicas": 1}, grid=GRID))
    with pytest.raises(SceneError, match=r"A: one replica gives no standard errors; set particles.replicas = 8, or output"):
        compare(one, truth(make_scene()))
    lost = raw(run).copy(deep=True)
    lost["x"][0, 0, 0] = np.nan
    with pytest.raises(SceneError, match="A: positions or velocities at t = 0 are not finite"):
        compare(lost, truth(make_scene()))
    deep = raw(run).expand_dims("more", axis=1)
    with pytest.raises(SceneError, match=r"allowed: \(time,\) \(replica,\) particle"):
        compare(deep, truth(make_scene()))


def test_refusals_of_files(make_scene: MakeScene, tmp_path: Path) -> None:
    right = truth(make_scene())
    with pytest.raises(SceneError, match=r"none\.nc: there is no such file"):
        compare(tmp_path / "none.nc", right)
    (tmp_path / "text.nc").write_text("nonsense")
    with pytest.raises(SceneError, match=r"text\.nc: is not a readable netCDF file"):
        compare(right, str(tmp_path / "text.nc"))
    xr.Dataset({"a": ("n", [1.0])}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(SceneError, match=r"other\.nc: has neither density"):
        compare(right, tmp_path / "other.nc")


def test_a_scene_that_is_none(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match="A: its scene cannot be read"):
        compare(truth(make_scene()).assign_attrs(scene="{}"), truth(make_scene()))


def test_a_bound_that_allows_everything_is_no_agreement(make_scene: MakeScene) -> None:
    """At R* = 3 with 50 particles the excess of pairs at contact is beyond 1: nothing is left to be compared."""
    scene = with_collisions(make_scene, 3.0, particles={"count": 50, "replicas": 20}, grid=GRID)
    with pytest.raises(SceneError, match=r"nothing to compare: .*not compared: density, .*: the systematic part may be"):
        compare(ensemble(scene), truth(with_collisions(make_scene, 3.0)))


def test_a_time_for_what_has_times(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match=r"time = 77: both have times of their own"):
        compare(truth(make_scene()), on_the_grid(make_scene()), time=77.0)
