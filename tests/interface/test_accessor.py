"""`ds.kinetic` on datasets of every method, in memory and from files."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, hydrodynamics, run_to_file, solve
from kinetic_solver.stability import growth_rates
from particles import simulate

MakeScene = Callable[..., Scene]
LAW = {"operator": "follow-the-leader", "cross_section": 0.9}


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    return solve(
        Scene.model_validate(
            {
                "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
                "collisions": LAW,
                "pipe": {"length": 9.0},
                "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 1e-4}, {"mode": 2, "sin": 2e-4}]},
                "run": {"end_time": 12.0, "output_every": 0.25},
            }
        )
    )


def test_moments_are_those_written_or_sums_over_f(run: xr.Dataset) -> None:
    written = run.kinetic.moments()
    assert list(written.data_vars) == ["density", "mean_velocity", "temperature", "heat_flux"]
    summed = run[["f"]].kinetic.moments()
    for name in written.data_vars:
        np.testing.assert_allclose(summed[name], written[name], rtol=1e-4, atol=1e-6)
        assert summed[name].attrs == written[name].attrs


def test_the_growth_rate_is_that_of_theory(run: xr.Dataset) -> None:
    rate = run.kinetic.growth_rate(1)
    theory = float(growth_rates(Scene.model_validate_json(run.attrs["scene"]), 1)["kinetic_growth_rate"][0])
    assert float(rate) == pytest.approx(theory, abs=5 * float(rate["uncertainty"]))
    assert float(rate["kinetic_growth_rate"]) == theory
    assert run.kinetic.growth_rate([1, 2])["mode"].values.tolist() == [1, 2]


def test_modes(run: xr.Dataset) -> None:
    c = run.kinetic.modes()
    assert complex(c.sel(mode=2, time=0.0)) == pytest.approx(-1e-4j, rel=1e-6)
    assert complex(c.sel(mode=1, time=0.0)) == pytest.approx(5e-5, rel=1e-6)
    assert float(c["wavenumber"].sel(mode=2)) == pytest.approx(4 * math.pi / 9)


def test_a_homogeneous_run_has_its_mean_alone() -> None:
    scene = {"pipe": {"length": 3.0}, "initial": {"density": 0.4, "temperature": 0.7}, "run": {"end_time": 0.2}}
    c = solve(Scene.model_validate(scene)).kinetic.modes()
    assert c["mode"].values.tolist() == [0]
    assert abs(c - 1).max() < 1e-15


def test_budgets_add_up(run: xr.Dataset) -> None:
    found = run.kinetic.budgets()
    assert found["energy_from"].dims == ("term", "time")
    brought = found["energy_from"].sum("term") + found["energy_residual"]
    np.testing.assert_allclose(found["energy"] - found["energy"][0], brought, atol=1e-9)
    assert np.isnan(found["momentum_rate"].sel(term="noise")).all()


def test_fields_between_the_points(make_scene: MakeScene) -> None:
    """Any place of the pipe, a period away too, and any velocity."""
    scene = make_scene(collisions=LAW)
    found = solve(scene).kinetic.at(x=[1.234, 1.234 + 9.0], v=0.77)
    assert found["f"].dims == ("time", "x")
    state = exact.Solution(scene, 1.5)
    truth = float(state.distribution(np.array([1.234]), np.array([0.77]))[0, 0])
    assert found["f"].values[-1] == pytest.approx([truth, truth], rel=1e-4)
    place = solve(scene).kinetic.at(x=1.234)
    assert place["temperature"].dims == ("time",)
    assert float(place["temperature"][-1]) == pytest.approx(float(state.moments(np.array([1.234]))[2][0]), rel=1e-4)
    with pytest.raises(SceneError, match="x = nan: allowed"):
        place.kinetic.at(x=math.nan)
    with pytest.raises(SceneError, match="v: the dataset has no such axis"):
        hydrodynamics.solve(make_scene(accuracy={"rtol": 1e-2})).kinetic.at(v=0.2)


def test_every_method(make_scene: MakeScene, tmp_path: Path) -> None:
    scene = make_scene(collisions=LAW, particles={"count": 400, "replicas": 2}, accuracy={"rtol": 1e-2})
    for method in ("grid", "exact", "particles", "hydrodynamics"):
        path = tmp_path / f"{method}.nc"
        run_to_file(scene, path, method)
        with xr.open_dataset(path, decode_times=False) as ds:
            assert ds.kinetic.moments()["density"].dims == ("time", "x")
            c = ds.kinetic.modes()
            assert abs(complex(c.sel(mode=1).isel(time=0)) - 0.2) < (0.1 if method == "particles" else 1e-6)
            assert ds.kinetic.at(x=2.0)["mean_velocity"].dims == ("time",)
            if method in ("exact", "particles"):
                with pytest.raises(SceneError, match="has no budgets"):
                    ds.kinetic.budgets()


def test_plots_label_themselves(run: xr.Dataset) -> None:
    before = plt.get_fignums()
    axes = run.kinetic.plot_density()
    assert axes.get_xlabel() == "position [length]"
    assert axes.get_ylabel() == "time [time]"
    f = run.kinetic.plot_f(time=1.0)
    assert f.get_ylabel() == "velocity [length time-1]"
    assert f.collections[0].get_clim()[0] == 0  # not a map of two signs, for round-off's sake
    lines = run.kinetic.plot_velocity_distribution(times=[0.0, 1.0, 3.0]).get_lines()
    assert len(lines) == 3
    own = plt.figure().subplots()
    assert run.kinetic.plot_budgets("momentum", own) is own
    assert [text.get_text() for text in own.get_legend().get_texts()] == ["gravity", "friction", "collisions"]
    assert len({line.get_linestyle() for line in own.get_lines()}) == 3  # told apart in grey
    own.figure.canvas.draw()
    assert own.get_legend().get_window_extent().y1 < own.get_window_extent().y0  # below: it covers no curve
    with pytest.raises(SceneError, match="of = 'mass': allowed"):
        run.kinetic.plot_budgets("mass")
    with pytest.raises(SceneError, match="has no 'f'"):
        run.drop_vars("f").kinetic.plot_f()
    for number in set(plt.get_fignums()) - set(before):
        plt.close(number)


def test_without_x(make_scene: MakeScene) -> None:
    ds = simulate(make_scene(initial={"modes": []}, particles={"count": 200}, grid={"nx": 1}))
    assert ds.kinetic.plot_f().get_xlabel() == "velocity [length time-1]"
    assert ds.kinetic.plot_density().get_xlabel() == "time [time]"
    plt.close("all")


@pytest.mark.parametrize("first", ["kinetic_solver", "xarray"])
def test_it_is_there_whichever_is_imported_first(first: str) -> None:
    second = "xarray" if first == "kinetic_solver" else "kinetic_solver"
    code = f"import {first}\nimport {second}\nimport xarray\nprint(xarray.Dataset().kinetic, xarray.__spec__.loader)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "KineticAccessor" in done.stdout
    assert "_Followed" not in done.stdout
