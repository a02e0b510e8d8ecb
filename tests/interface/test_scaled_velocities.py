"""Datasets over scaled velocities: their schema, in memory and in files, and all that reads runs."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, resample, run_to_file, solve, sweep
from kinetic_solver.analysis.describe import describe
from kinetic_solver.analysis.info import facts, summary
from kinetic_solver.analysis.plotting import save_overview
from kinetic_solver.compare import compare
from kinetic_solver.dataset import in_velocities, on_scales_of, open_run, scales_of, velocity_axis

MakeScene = Callable[..., Scene]


def cooling(make_scene: MakeScene, **changes: Any) -> Scene:
    tables: dict[str, Any] = {
        "model": {"gravity": 0.3, "friction": 0.0, "noise": 0.0},
        "collisions": {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.6},
        "initial": {"density": 0.8, "temperature": 0.6, "mean_velocity": 0.4, "modes": []},
        "run": {"end_time": 30.0, "output_every": 10.0},
        "accuracy": {"rtol": 1e-5},
    }
    return make_scene(**tables | changes)


@pytest.fixture
def run(make_scene: MakeScene) -> xr.Dataset:
    return solve(cooling(make_scene))


def test_the_schema(run: xr.Dataset) -> None:
    """f over (time, x, scaled_velocity), ∫f dw = ρ, and moments in the scene's units."""
    assert run["f"].dims == ("time", "x", "scaled_velocity")
    assert run["velocity_distribution"].dims == ("time", "scaled_velocity")
    assert run["velocity_scale"].dims == run["velocity_origin"].dims == ("time",)
    assert "v" not in run.dims
    assert run["f"].attrs["units"] == "particles length-1"
    w, bounds = run["scaled_velocity"].values, run["scaled_velocity_bounds"].values
    dw = float(bounds[0, 1] - bounds[0, 0])
    assert w == pytest.approx(bounds.mean(axis=1))
    f, s, u = run["f"].values[:, 0], run["velocity_scale"].values, run["velocity_origin"].values
    density = f.sum(axis=1) * dw
    assert density == pytest.approx(run["density"].values[:, 0], rel=1e-7)
    assert u + s * (f @ w) * dw / density == pytest.approx(run["mean_velocity"].values[:, 0], rel=1e-8)
    assert s**2 * (f @ w**2) * dw / density == pytest.approx(run["temperature"].values[:, 0], rel=1e-6)
    assert run["velocity_distribution"].values.sum(axis=1) * dw == pytest.approx(run["mass"].values, rel=1e-7)
    assert s[0] == pytest.approx(0.6**0.5)
    assert s[-1] ** 2 == pytest.approx(run["temperature"].values[-1, 0], rel=0.1)


def test_a_file_has_the_same(make_scene: MakeScene, run: xr.Dataset, tmp_path: Path) -> None:
    run_to_file(cooling(make_scene), tmp_path / "run.nc")
    with open_run(tmp_path / "run.nc") as there:
        xr.testing.assert_equal(there.load(), run)
        assert set(there["f"].coords) == {"time", "x", "scaled_velocity", "velocity_scale", "velocity_origin"}


def test_fields_with_cadences_of_their_own_have_scales_of_their_own(make_scene: MakeScene) -> None:
    run = solve(cooling(make_scene, output={"f": 15.0}))
    assert run["f"].dims[0] == "time_f"
    assert run["velocity_scale_f"].dims == ("time_f",)
    assert run["velocity_scale"].dims == ("time",)
    s, u = scales_of(run["f"])
    assert float(s[-1]) == float(run["velocity_scale"][-1])
    assert float(u[1]) == pytest.approx(0.4 + 0.3 * 15)


def test_over_velocities(make_scene: MakeScene, run: xr.Dataset) -> None:
    """`in_velocities` and `ds.kinetic.at` are f(x, v); a window of output.velocity_window is in v as well."""
    shown = solve(cooling(make_scene, output={"velocity_window": [-4.0, 14.0], "nv": 300}))
    assert shown["f"].dims == ("time", "x", "v")
    found = in_velocities(run, shown["v"].values)
    assert np.abs(found["f"] - shown["f"]).max() < 1e-6 * shown["f"].max()
    assert found["f"].attrs == shown["f"].attrs
    assert "velocity_scale" not in found.coords
    assert in_velocities(shown, shown["v"].values) is shown
    at = run.kinetic.at(v=[9.3, 9.4])
    fine = in_velocities(run, np.linspace(9.0, 10.0, 11))  # where f is not resolved by the points shown
    assert at["f"].values == pytest.approx(fine["f"].values[:, :, 3:5], rel=1e-9)


def test_resample_and_moments(run: xr.Dataset) -> None:
    fine = resample(run, nv=401)
    assert fine.sizes["scaled_velocity"] == len(fine["scaled_velocity_bounds"]) == 401
    assert velocity_axis(fine) == "scaled_velocity"
    back = resample(fine, nv=run.sizes["scaled_velocity"])
    assert np.abs(back["f"] - run["f"]).max() < 1e-6 * run["f"].max()
    made = run.drop_vars("density").kinetic.moments()
    for name in ("density", "mean_velocity", "temperature"):
        assert made[name].values == pytest.approx(run[name].values, rel=1e-6)
    run.kinetic.plot_f()
    run.kinetic.plot_velocity_distribution()


def test_compare_lays_them_over_each_other(make_scene: MakeScene, run: xr.Dataset) -> None:
    """Runs to two rtol; a run on a fixed window; another scale."""
    finer = solve(cooling(make_scene, accuracy={"rtol": 1e-6}))
    assert not compare(run, finer).differ
    slower = solve(cooling(make_scene, collisions={"operator": "inelastic", "cross_section": 1.6, "restitution": 0.6}))
    assert compare(run, slower).differ
    moved = on_scales_of(finer, slower)
    assert moved["f"].sum("scaled_velocity").values == pytest.approx(
        run["f"].sum("scaled_velocity").values * float(run["scaled_velocity"].diff("scaled_velocity")[0])
        / float(moved["scaled_velocity"].diff("scaled_velocity")[0]), rel=1e-6)  # fmt: skip
    short = {"run": {"end_time": 6.0, "output_every": 3.0}}
    fixed = solve(cooling(make_scene, **short, grid={"nv": 500, "velocity_window": (-4.0, 6.8)}))
    scaled = solve(cooling(make_scene, **short))
    assert "scaled_velocity" in scaled.dims
    for found in (compare(scaled, fixed), compare(fixed, scaled)):
        assert not found.differ
        assert {"f", "velocity_distribution"} <= {row.field for row in found.rows}


def test_info_plot_and_describe(make_scene: MakeScene, run: xr.Dataset, tmp_path: Path) -> None:
    assert any("in scaled velocities" in line for line in summary(run))
    assert facts(run)["scaled_velocity"][1] == float(run["scaled_velocity"][-1])
    save_overview(run, tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
    rows = {label: text for _, section in describe(cooling(make_scene)) for label, text in section}
    assert "over scaled velocities (v - u)/s" in rows["frame"]
    assert "shrink with the gas" in rows["frame"]


def test_a_run_goes_on_from_one(make_scene: MakeScene, run: xr.Dataset, tmp_path: Path) -> None:
    """From the file, and from the last f itself; the two halves are the whole to the errors of both."""
    run_to_file(cooling(make_scene), tmp_path / "first.nc")
    scene = Scene.model_validate(cooling(make_scene, run={"end_time": 170.0}).model_dump(exclude={"initial"}))
    of_file = solve(scene.replace(**{"initial.file": str(tmp_path / "first.nc")}))
    of_array = solve(scene, initial=run["f"].isel(time=-1))
    whole = solve(cooling(make_scene, run={"end_time": 200.0}))
    for found in (of_file, of_array):
        assert found["f"].dims[-1] == "scaled_velocity"
        assert found["temperature"].values[0] == pytest.approx(run["temperature"].values[-1], rel=1e-6)
        assert found["temperature"].values[-1] == pytest.approx(whole["temperature"].values[-1], rel=1e-5)
        assert found["mean_velocity"].values[-1] == pytest.approx(whole["mean_velocity"].values[-1], rel=1e-12)
    assert Scene.model_validate_json(of_file.attrs["scene"]).initial.file == str(tmp_path / "first.nc")


def test_sweeps_keep_every_points_scale(make_scene: MakeScene) -> None:
    with ThreadPoolExecutor(1) as pool:
        found = sweep(cooling(make_scene), {"collisions.restitution": [0.2, 0.7]}, executor=pool)
        values = {"model.noise": [0.0, 0.4], "model.friction": [0.5]}
        mixed = sweep(cooling(make_scene, run={"end_time": 3.0}), values, executor=pool)
    assert found["velocity_scale"].dims == ("collisions.restitution", "time")
    assert float(found["velocity_scale"][0, -1]) < float(found["velocity_scale"][1, -1])
    assert mixed["f"].dims[-1] == "v"
