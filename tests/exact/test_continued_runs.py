"""Runs that go on from the last f of another: as good as one run all the way, whatever friction and operator."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, run_to_file, solve

START = {"density": 1.2, "modes": [{"mode": 1, "cos": 0.5}], "mean_velocity": 0.4, "temperature": 0.9}
FOLLOW, INELASTIC = "follow-the-leader", {"operator": "inelastic", "cross_section": 0.3, "restitution": 0.5}
RTOL = 1e-5


def scene_of(model: dict[str, float], collisions: dict[str, Any] | None, **tables: Any) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 0.6, **model},
            "pipe": {"length": 6.0},
            "accuracy": {"rtol": RTOL},
            **({"collisions": collisions} if collisions else {}),
            **tables,
        }
    )


def last_error(run: xr.Dataset, truth: xr.Dataset, name: str) -> float:
    wanted = truth[name].values[-1]
    return float(np.abs(run[name].values[-1] - wanted).max() / np.abs(wanted).max())


def continued(path: Path, model: dict[str, float], collisions: dict[str, Any] | None, kind: str, **tables: Any) -> xr.Dataset:
    """From t = 0 to 1, and on to 2 from what was written."""
    run_to_file(scene_of(model, collisions, initial=START, run={"end_time": 1.0}, **tables), path)
    rest = scene_of(model, collisions, run={"end_time": 1.0}, **tables)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if kind == "file":
            return solve(rest.replace(**{"initial.file": str(path)}))
        with xr.open_dataset(path) as first:
            return solve(rest, initial=first["f"][-1].load())


@pytest.mark.parametrize("kind", ["file", "array"])
@pytest.mark.parametrize(
    ("model", "cross_section"),
    [
        ({"friction": 0.0, "noise": 1.0}, 0.0),
        ({"friction": 1e-4, "noise": 100.0}, 0.0),
        ({"friction": 0.7, "noise": 1.3}, 0.0),
        ({"friction": 0.0, "noise": 1.0}, 0.5),
        ({"friction": 0.01, "noise": 2.0}, 0.5),
        ({"friction": 0.1, "noise": 3.0}, 3.0),
        ({"friction": 0.7, "noise": 1.3}, 0.9),
        ({"friction": 0.4, "noise": 0.0}, 0.5),
    ],
)
def test_two_runs_are_as_good_as_one(tmp_path: Path, model: dict[str, float], cross_section: float, kind: str) -> None:
    """Without collisions and with (6), against the closed form of the whole way; R_t of the hardest is 5.8, and then 8.1."""
    law = {"operator": FOLLOW, "cross_section": cross_section} if cross_section else None
    second = continued(tmp_path / "first.nc", model, law, kind)
    whole = scene_of(model, law, initial=START, run={"end_time": 2.0})
    truth = exact.solve(whole, x=second["x"].values, v=second["v"].values)
    for name in ("f", "density", "temperature"):
        assert last_error(second, truth, name) < RTOL, name


@pytest.mark.parametrize("kind", ["file", "array"])
@pytest.mark.parametrize(("friction", "noise"), [(0.0, 1.0), (0.01, 1.2), (0.7, 1.3)])
def test_likewise_of_inelastic_collisions(tmp_path: Path, friction: float, noise: float, kind: str) -> None:
    """Against one run, ten times as accurate."""
    model = {"friction": friction, "noise": noise}
    second = continued(tmp_path / "first.nc", model, INELASTIC, kind)
    dv = float(second["v"][1] - second["v"][0])
    window = (float(second["v"][0]) - dv / 2, float(second["v"][-1]) + dv / 2)
    there = {"nx": second.sizes["x"], "nv": second.sizes["v"], "velocity_window": window}
    whole = scene_of(model, INELASTIC, initial=START, run={"end_time": 2.0}, output=there)
    truth = solve(whole.replace(**{"accuracy.rtol": RTOL / 10}))
    for name in ("f", "density", "temperature"):
        assert last_error(second, truth, name) < RTOL, name


@pytest.mark.parametrize("friction", [0.0, 1e-4, 0.1])
def test_a_callable_far_from_the_terminal_velocity(friction: float) -> None:
    """g/γ is where no particle is."""

    def f(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        density = 1.2 * (1 + 0.5 * np.cos(2 * np.pi * x / 6))
        return np.asarray(density * np.exp(-((v - 0.4) ** 2) / 1.8) / np.sqrt(1.8 * np.pi))

    model, law = {"friction": friction, "noise": 2.3}, {"operator": FOLLOW, "cross_section": 0.5}
    run = solve(scene_of(model, law, run={"end_time": 1.0}), initial=f)
    whole = scene_of(model, law, initial=START, run={"end_time": 1.0})
    assert last_error(run, exact.solve(whole, x=run["x"].values, v=run["v"].values), "f") < RTOL


def test_the_output_keeps_the_files_points(tmp_path: Path) -> None:
    """And adds velocities where the flow, which falls, leaves them."""
    model = {"friction": 0.01, "noise": 1.2, "gravity": 7.0}
    second = continued(tmp_path / "first.nc", model, None, "file")
    with xr.open_dataset(tmp_path / "first.nc") as first:
        assert np.array_equal(second["x"], first["x"])
        begin = int(np.abs(second["v"].values - float(first["v"][0])).argmin())
        assert np.allclose(second["v"][begin : begin + first.sizes["v"]], first["v"], rtol=0.0, atol=1e-9)
        assert second.sizes["v"] > first.sizes["v"] + begin


def test_a_given_window_is_held_against_the_flow_of_the_file(tmp_path: Path) -> None:
    model, law = {"friction": 0.1, "noise": 3.0}, {"operator": FOLLOW, "cross_section": 3.0}
    first = scene_of(model, law, initial=START, run={"end_time": 1.0})
    run_to_file(first, tmp_path / "first.nc")
    rest = scene_of(model, law, initial={"file": str(tmp_path / "first.nc")}, run={"end_time": 1.0})
    with pytest.raises(SceneError, match=r"does not hold the mean velocities from -[0-9.]+ to .* allowed: one that does") as told:
        solve(rest.replace(**{"grid.velocity_window": (-2.0, 5.0)}))
    low, high = (float(text) for text in str(told.value).split("as [")[1].rstrip("]").split(","))
    assert -40 < low < -20 < 5 < high < 12
    solve(rest.replace(**{"grid.velocity_window": (low, high)}))


def test_a_tail_that_is_not_in_the_start_is_told(tmp_path: Path) -> None:
    """(6) would amplify what was cut off, or what ringing there is, to more than the rest."""
    law = {"operator": FOLLOW, "cross_section": 3.0}
    scene = scene_of({"friction": 0.1, "noise": 3.0}, law, initial=START, run={"end_time": 1.0})
    last = solve(scene)["f"][-1]
    rest = scene_of({"friction": 0.1, "noise": 3.0}, law, run={"end_time": 1.0})
    with pytest.raises(SceneError, match=r"what it leaves out below v = .* follow-the-leader collisions make .* of max f"):
        solve(rest, initial=last.sel(v=slice(-8.6, None)))
    with pytest.warns(UserWarning, match="start from one with a slower tail, or end the run before"):
        solve(rest, initial=last.sel(v=slice(-11.5, None)))
