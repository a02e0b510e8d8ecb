"""Starts from files whose coordinates others chose: the same state whatever the order, beginning and spacing of its points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, initial, run_to_file, solve
from kinetic_solver.initial.from_file import from_file, read_state

MakeScene = Callable[..., Scene]
LENGTH = 9.0
X, V = LENGTH / 24 * np.arange(24), np.linspace(-3.0, 6.5, 120)


def state(scene: Scene, x: np.ndarray, v: np.ndarray) -> xr.Dataset:
    return xr.Dataset({"f": (("x", "v"), initial.distribution(scene, x, v))}, {"x": x, "v": v})


def reader(make_scene: MakeScene, path: Path, **changes: Any) -> Scene:
    given = make_scene(**changes).model_dump(exclude={"initial"}, exclude_none=True)
    return Scene.model_validate({**given, "initial": {"file": str(path)}})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.isel(x=slice(None, None, -1)), "its x descends: read from the other end"),
        (lambda f: f.isel(v=slice(None, None, -1)), "its v descends: read from the other end"),
        (lambda f: f.assign_coords(x=f["x"] - 4.5).roll(x=12), "its places begin at x = -4.5: waves are turned by that much"),
        (
            lambda f: xr.concat([f, f.isel(x=[0]).assign_coords(x=[LENGTH])], "x"),
            "its last place, x = 9, is its first one a period on, and left out",
        ),
        (lambda f: f.transpose("v", "x"), None),
        (lambda f: f.assign_coords(x=f["x"].astype("f4"), v=f["v"].astype("f4")), None),
        (lambda f: f.expand_dims(time_f=[2.5]), "read frame 1 of 1, t = 2.5"),
        (lambda f: xr.concat([0.5 * f, f], xr.DataArray([0.0, 1.0], dims="time_f", name="time_f")), "read frame 2 of 2, t = 1"),
    ],
    ids=["x descends", "v descends", "about 0", "both ends", "v first", "single precision", "time_f", "two frames"],
)
def test_the_same_state(
    make_scene: MakeScene, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], said: str | None
) -> None:
    """What is only another order of the same numbers gives the same f to round-off, and no warning."""
    scene = make_scene()
    change(state(scene, X, V)).to_netcdf(tmp_path / "start.nc")
    there = reader(make_scene, tmp_path / "start.nc")
    truth = initial.distribution(scene, X, V)
    single = 3e-7 if said is None else 0.0
    assert np.abs(from_file(there, X, V) - truth).max() <= (1e-13 + single) * truth.max()
    assert initial.file_notes(there) == ([] if said is None else [said])
    nx, nv, low, high = initial.file_grid(there)
    assert (nx, nv) == (24, 120)
    assert (low, high) == pytest.approx((-3 - 4.75 / 119, 6.5 + 4.75 / 119), abs=1e-6)


def test_what_differs_at_both_ends_is_refused(make_scene: MakeScene, tmp_path: Path) -> None:
    f = state(make_scene(), np.append(X, LENGTH), V)
    f["f"][-1] *= 1.2
    f.to_netcdf(tmp_path / "start.nc")
    with pytest.raises(SceneError, match=r"its places go from 0 to 9, the same place one period on, where f differs by 0\.17 of"):
        initial.file_grid(reader(make_scene, tmp_path / "start.nc"))


def error_of_uneven(make_scene: MakeScene, path: Path, nx: int, nv: int) -> tuple[float, float]:
    """(max|Δf|/max f, error of the mass) of points up to 1.38 (x) and 1.31 (v) times as far apart as on average."""
    scene = make_scene()
    s, t = np.arange(nx) / nx, np.linspace(-1, 1, nv)
    x, v = LENGTH * (s + 0.06 * np.sin(2 * np.pi * s) + 0.013), 1.75 + 4.75 * (t + 0.1 * np.sin(np.pi * t))
    state(scene, x, v).to_netcdf(path)
    there = reader(make_scene, path)
    with pytest.warns(UserWarning, match="are not equally far apart: f is interpolated at .* that are, mass kept"):
        initial.file_grid(there)
    found = read_state(there)
    truth = initial.distribution(scene, X, V)
    places = found.first + LENGTH / len(found.f) * np.arange(len(found.f))
    dv = found.v[1] - found.v[0]
    mass = found.f.sum() * LENGTH / places.size * dv
    return float(np.abs(from_file(there, X, V) - truth).max() / truth.max()), abs(float(mass) - 0.8 * LENGTH)


def test_uneven_points_are_interpolated_to_order_4(make_scene: MakeScene, tmp_path: Path) -> None:
    errors = np.array([error_of_uneven(make_scene, tmp_path / f"{n}.nc", n, 3 * n) for n in (20, 40, 80)])
    orders = np.log2(errors[:-1, 0] / errors[1:, 0])
    assert (abs(orders - 4) < 0.7).all(), orders
    assert errors[-1, 0] < 2e-6
    assert (errors[:, 1] < 20 * errors[:, 0]).all()


def test_uneven_points_keep_the_mass_to_round_off(make_scene: MakeScene, tmp_path: Path) -> None:
    """The integral of the spline through the points, cell by cell."""
    from scipy.interpolate import CubicSpline

    from kinetic_solver.initial.uneven import uniform_in_v, uniform_in_x

    rng = np.random.default_rng(7)
    x, v = np.sort(rng.uniform(0, LENGTH, 17)), np.sort(rng.uniform(-2, 5, 30))
    f = rng.uniform(0.2, 1.0, (17, 30))
    first, over_x = uniform_in_x(x, f, LENGTH)
    around = CubicSpline(np.append(x, x[0] + LENGTH), np.concatenate([f, f[:1]]), bc_type="periodic")
    assert over_x.mean(axis=0) * LENGTH == pytest.approx(around.integrate(x[0], x[0] + LENGTH), rel=1e-12)
    assert first == pytest.approx(x[0] + LENGTH / len(over_x) / 2)
    new, over_v = uniform_in_v(v, f)
    assert over_v.sum(axis=1) * (new[1] - new[0]) == pytest.approx(CubicSpline(v, f, axis=1).integrate(v[0], v[-1]), rel=1e-12)


def test_a_stopped_run_starts_from_its_last_frame_and_a_damaged_one_is_refused(make_scene: MakeScene, tmp_path: Path) -> None:
    f = state(make_scene(), X, V)["f"]
    frames = xr.concat([f, 1.1 * f, np.nan * f], xr.DataArray([0.0, 1.0, 2.0], dims="time", name="time"))
    frames.to_dataset(name="f").to_netcdf(tmp_path / "stopped.nc")
    there = reader(make_scene, tmp_path / "stopped.nc")
    with pytest.warns(UserWarning, match="starts from frame 2 of 3, t = 1: the later ones are empty"):
        initial.file_grid(there)
    assert np.array_equal(from_file(there, X, V), 1.1 * f.values)
    frames[2] = f.where(f["v"] < 2)
    frames.to_dataset(name="f").to_netcdf(tmp_path / "damaged.nc")
    with pytest.raises(SceneError, match="frame 3 of 3, t = 2 is not finite at 1368 of its points"):
        read_state(reader(make_scene, tmp_path / "damaged.nc"))


def test_f_of_a_cadence_of_its_own_starts_another_run(make_scene: MakeScene, tmp_path: Path) -> None:
    scene = make_scene(output={"f": 0.75}, accuracy={"rtol": 1e-5})
    run_to_file(scene, tmp_path / "first.nc")
    with xr.open_dataset(tmp_path / "first.nc", decode_times=False) as first:
        assert first["f"].dims == ("time_f", "x", "v")
        second = solve(reader(make_scene, tmp_path / "first.nc", accuracy={"rtol": 1e-5}))
        assert np.array_equal(second["f"][0], first["f"][-1])


def test_times_in_seconds_are_numbers(make_scene: MakeScene, tmp_path: Path) -> None:
    """xarray made durations of them in some of its versions."""
    f = state(make_scene(), X, V).expand_dims(time=[0.25])
    f["time"].attrs["units"] = "seconds"
    f.to_netcdf(tmp_path / "start.nc")
    assert initial.file_notes(reader(make_scene, tmp_path / "start.nc")) == ["read frame 1 of 1, t = 0.25"]


@pytest.mark.parametrize(
    ("name", "message"), [("none.nc", "there is no such file"), ("", "is a folder"), ("a.csv", "is a table of particles")]
)
def test_what_is_no_file(make_scene: MakeScene, tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        solve(reader(make_scene, tmp_path / name))
