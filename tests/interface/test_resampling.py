"""Fields at other points: by [output] while a run goes on, and by `resample` afterwards, of every method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, hydrodynamics, resample, run_to_file, solve
from kinetic_solver.dataset import open_run
from particles import simulate

MakeScene = Callable[..., Scene]
FIELDS = ("f", "density", "mean_velocity", "temperature", "velocity_distribution")
LAW = {"operator": "follow-the-leader", "cross_section": 1.4}


def error(run: xr.Dataset, scene: Scene, truth: xr.Dataset | None = None) -> float:
    """The largest over fields and frames, each over what rtol refers to."""
    truth = exact.solve(scene, run["x"], run["v"]) if truth is None else truth
    worst = 0.0
    for name in FIELDS:
        scale = float(np.abs(truth[name]).max())
        if name == "mean_velocity":
            scale = max(scale, float(truth["temperature"].max()) ** 0.5)
        worst = max(worst, float(np.abs(run[name].values - truth[name].values).max()) / scale)
    return worst


OUTPUTS: dict[str, dict[str, Any]] = {
    "by default": {},
    "many": {"nx": 100, "nv": 150},
    "few": {"nx": 5, "nv": 16},
    "a part of v": {"nx": 33, "velocity_window": [0.1, 1.7]},
    "beyond": {"nv": 90, "velocity_window": [-8.0, 12.0]},
}


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("collisions", [None, LAW], ids=["none", "(6)"])
def test_fields_are_those_of_the_solution_wherever_they_are_given(
    make_scene: MakeScene, output: str, collisions: dict[str, Any] | None
) -> None:
    """Within rtol, moments and w(v) as well where few places or a part of the velocities are shown."""
    scene = make_scene(output=OUTPUTS[output], collisions=collisions)
    run = solve(scene)
    assert error(run, scene) < 1e-4
    assert run.sizes["x"] == OUTPUTS[output].get("nx", run.sizes["x"])
    assert run.sizes["v"] == OUTPUTS[output].get("nv", run.sizes["v"])
    if "velocity_window" in OUTPUTS[output]:
        edges = run["v_bounds"].values[0, 0], run["v_bounds"].values[-1, 1]
        assert edges == pytest.approx(OUTPUTS[output]["velocity_window"])


def test_temperatures_of_a_fast_flow_are_kept(make_scene: MakeScene) -> None:
    """A thousand million times as fast as the particles within it: θ is not rounded away between u² and u²."""
    run = solve(make_scene(collisions=None, output={"f": False}))
    fast = run.assign(mean_velocity=run["mean_velocity"] + 1e9)
    assert resample(fast, nx=24)["temperature"].values == pytest.approx(resample(run, nx=24)["temperature"].values, rel=1e-5)


def test_a_wave_has_points_enough_to_be_looked_at(make_scene: MakeScene) -> None:
    coarse = {"modes": [{"mode": 1, "cos": 0.1}]}
    assert dict(solve(make_scene(initial=coarse)).sizes) == {"time": 2, "x": 65, "v": 64, "bounds": 2}
    assert solve(make_scene(initial={"modes": []})).sizes["x"] == 1
    kept = solve(make_scene(initial=coarse, grid={"nx": 9, "nv": 40}))
    assert (kept.sizes["x"], kept.sizes["v"]) == (9, 40)


def test_every_method_has_them(make_scene: MakeScene, tmp_path: Path) -> None:
    scene = make_scene(
        collisions=LAW,
        output={"nx": 12, "nv": 20, "velocity_window": [-1.0, 4.5]},
        particles={"count": 500, "replicas": 2},
        accuracy={"rtol": 1e-2},
    )
    for method in ("grid", "exact", "particles", "hydrodynamics"):
        run_to_file(scene, tmp_path / f"{method}.nc", method)
        with open_run(tmp_path / f"{method}.nc") as run:
            assert run.sizes["x"] == 12
            if method != "hydrodynamics":
                assert run.sizes["v"] == 20
                assert float(run["v_bounds"][0, 0]) == pytest.approx(-1.0)
    assert simulate(scene)["f"].shape[1:] == (12, 20)


def test_hydrodynamics_are_the_same_at_fewer_places(make_scene: MakeScene) -> None:
    """The closure's own points are multiples of those; the hierarchy's waves are evaluated there."""
    for more in ({}, {"hydrodynamics": {"moments": 6}}):
        few, many = (
            hydrodynamics.solve(make_scene(initial={"modes": [{"mode": 1, "cos": 0.1}]}, output={"nx": nx}, **more))
            for nx in (16, 64)
        )
        np.testing.assert_allclose(few["temperature"], many["temperature"][:, ::4], rtol=1e-4)
    given = make_scene(grid={"nx": 64}, output={"nx": 24})
    with pytest.raises(SceneError, match=r"output\.nx = 24: the closure's points are grid\.nx = 64; allowed: what divides it"):
        hydrodynamics.solve(given)


def test_moment_equations_close_on_points_of_their_own(make_scene: MakeScene) -> None:
    run = solve(make_scene(collisions=LAW, output={"moment_equations": True, "nx": 20}))
    assert run["temperature_rate"].sizes["x"] == 20
    assert float(np.abs(run["temperature_rate_residual"]).max()) < 1e-6 * float(np.abs(run["temperature_rate"]).max())


def test_resampling_is_as_accurate_as_the_run(make_scene: MakeScene) -> None:
    """From the solver's own few points, in x and v."""
    scene = make_scene(collisions=LAW, grid={"nx": 31, "nv": 40}, accuracy={"rtol": 1e-4})
    run = solve(scene)
    finer = resample(run, nx=90, nv=130, velocity_window=(-2.0, 5.0))
    assert error(finer, scene) < 1e-4
    assert list(finer.data_vars) == list(run.data_vars)
    assert finer["f"].dims == ("time", "x", "v")
    assert finer["f"].attrs == run["f"].attrs
    assert finer.attrs == run.attrs
    assert float(finer["x_bounds"][-1, 1]) == pytest.approx(9.0 - 0.05)
    xr.testing.assert_identical(finer["energy"], run["energy"])


def test_a_window_that_cuts_f_needs_the_spline(make_scene: MakeScene) -> None:
    """There and back would ring by a tenth of f with waves in v."""
    scene = make_scene(collisions=LAW, output={"nv": 48, "velocity_window": [1.0, 3.0]})
    run, finer = solve(scene), make_scene(collisions=LAW)
    assert error(resample(run, nv=95), finer) < 1e-4


def test_what_is_missing_stays_missing_and_outside_is_zero(make_scene: MakeScene) -> None:
    run = exact.solve(make_scene()).isel(time=[0, 1])
    run["mean_velocity"][1, 10] = run["temperature"][1, 10] = run["heat_flux"][1, 10] = np.nan
    finer = resample(run, nx=128)
    assert np.flatnonzero(np.isnan(finer["mean_velocity"][1])).tolist() == [19, 20, 21]
    assert not np.isnan(finer["mean_velocity"][0]).any()
    assert not np.isnan(finer["density"]).any()
    wide = resample(run, nv=200, velocity_window=(-30.0, 30.0))
    assert float(np.abs(wide["f"].sel(v=slice(20.0, None))).max()) == 0.0


def test_particles_and_their_errors(make_scene: MakeScene) -> None:
    run = simulate(make_scene(collisions=LAW, particles={"count": 2000, "replicas": 4}))
    finer = resample(run, nx=130, nv=128)
    assert finer["density_stderr"].shape == (2, 130)
    assert float(finer["density_stderr"].min()) > 0
    np.testing.assert_allclose(finer["density"][:, ::2], run["density"], rtol=1e-10)
    assert finer["density_replica"].sizes["x"] == 130


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"nx": 0}, "nx = 0: allowed: a whole number, 1 or more"),
        ({"nv": 2.5}, "nv = 2.5: allowed: a whole number, 2 or more"),
        ({"velocity_window": (2.0, -1.0)}, r"velocity_window = \(2.0, -1.0\): allowed: two numbers, the smaller one first"),
    ],
)
def test_what_makes_no_grid(make_scene: MakeScene, arguments: dict[str, Any], message: str) -> None:
    run = exact.solve(make_scene())
    with pytest.raises(SceneError, match=message):
        resample(run, **arguments)
    with pytest.raises(SceneError, match="the dataset has no velocities"):
        resample(run.drop_dims("v"), nv=9)


def test_one_place_shows_no_wave(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match=r"output\.nx = 1: one place does not show a scene that depends on x"):
        make_scene(output={"nx": 1})
    with pytest.raises(SceneError, match=r"output\.nx = 0: input should be greater than or equal to 1"):
        make_scene(output={"nx": 0})
    with pytest.raises(SceneError, match=r"output: velocity_window = \[2.0, 1.0\] is reversed"):
        make_scene(output={"velocity_window": [2.0, 1.0]})
