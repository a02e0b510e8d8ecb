"""Starts from a file with f(x, v), written by others, against the closed form of the start that is in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, initial, solve

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.6}


def write(scene: Scene, path: Path, x: np.ndarray, v: np.ndarray) -> None:
    xr.Dataset({"f": (("x", "v"), initial.distribution(scene, x, v))}, {"x": x, "v": v}).to_netcdf(path)


@pytest.mark.parametrize("first", [0.0, 0.5], ids=["from 0", "cell centres"])
@pytest.mark.parametrize(("points", "nx"), [(21, None), (24, None), (24, 35)])
def test_f_without_a_time(make_scene: MakeScene, tmp_path: Path, first: float, points: int, nx: int | None) -> None:
    scene = make_scene(run={"end_time": 0.8})
    x, v = 9.0 / points * (np.arange(points) + first), np.linspace(-3.0, 6.5, 120)
    write(scene, tmp_path / "start.nc", x, v)
    there = {"initial": {"file": str(tmp_path / "start.nc"), "density": 0.8}, "grid": {"nx": nx} if nx else {}}
    given = scene.model_dump(exclude={"initial"}, exclude_none=True)
    run = solve(Scene.model_validate({**given, **there}))
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
    assert run.sizes["x"] == (nx or points)
    assert float(abs(run["f"] - truth["f"]).max() / truth["f"].max()) < 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.rename(x="place"), r"has no f\(time, x, v\) or f\(x, v\)"),
        (lambda f: f.drop_vars("x"), "f has no coordinate x"),
        (lambda f: f.assign_coords(x=f["x"] ** 2), r"its uneven places lie from 0 to 62\.0156, which does not fit one period"),
        (lambda f: f.assign_coords(x=f["x"] * 0.7 + 0.01 * f["x"] ** 2), "its uneven places lie from 0 to"),
        (lambda f: f.assign_coords(x=f["x"].where(f["x"] != 2.25, np.nan)), "its coordinate x is not finite at 1 of its points"),
        (lambda f: f.assign_coords(v=abs(f["v"])), "its v goes neither up nor down all the way"),
        (lambda f: f.assign_coords(x=2 * f["x"]), "its period is 18, the scene's 9"),
        (lambda f: f.where(f["v"] < 2), "f is not finite at 152 of its points; allowed: numbers"),
        (lambda f: f * np.nan, "has no frame of f with numbers in it"),
        (lambda f: -f, "its f is nowhere positive"),
        (lambda f: f - 0.05 * f.max(), r"its f is negative, 0\.053 of its maximum; allowed: 0 or more, but for accuracy.rtol"),
        (lambda f: f.isel(v=[0, 1]), "has 2 velocities; allowed: 4 or more"),
    ],
)
def test_what_is_refused(make_scene: MakeScene, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], message: str) -> None:
    write(make_scene(), tmp_path / "start.nc", 9.0 / 8 * np.arange(8), np.linspace(-3.0, 6.5, 40))
    with xr.open_dataset(tmp_path / "start.nc") as data:
        change(data.load()).to_netcdf(tmp_path / "changed.nc")
    given = make_scene().model_dump(exclude={"initial"}, exclude_none=True)
    with pytest.raises(SceneError, match=message):
        solve(Scene.model_validate({**given, "initial": {"file": str(tmp_path / "changed.nc")}}))
