"""Runs that cannot be trusted stop with one line that says what to change; what was written stays."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, SolverStopped, solve
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.solver.monitor import Monitor, Problem
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.scheme import assemble

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 2.0}
COOLING = {
    "model": {"gravity": 0.0, "friction": 0.0, "noise": 0.0},
    "collisions": {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5},
    "initial": {"modes": [], "temperature": 1.0},
    "run": {"end_time": 30.0, "output_every": 0.5},
    "grid": {"nv": 64, "velocity_window": (-6.0, 6.0)},
}


def judged(plan: Plan, f: np.ndarray, clock: float = 0.0) -> Problem | None:
    """What the monitor says of f on the plan's grid."""
    return Monitor(plan).judge(Observation.of(assemble(plan), clock, f)).problem


def one_line(stop: BaseException) -> str:
    text = str(stop)
    assert "\n" not in text
    return text


def test_a_narrowing_distribution_is_stopped_while_it_is_still_right(make_scene: MakeScene) -> None:
    with pytest.raises(SolverStopped, match=r"narrower than 1\.4 dv .* raise grid\.nv") as caught:
        solve(make_scene(**COOLING))
    one_line(caught.value)
    kept = caught.value.dataset
    assert int(kept["status"]) == 2
    assert kept.attrs["stopped"] == str(caught.value)
    assert kept.sizes["time"] > 3
    assert np.isfinite(kept["f"].values).all()
    # What was kept agrees with a run of three times the points to a few per cent, to the last frame.
    fine = make_scene(**{**COOLING, "grid": {"nv": 192, "velocity_window": (-6.0, 6.0)}, "run": {
        "end_time": float(kept["time"][-1]), "output_every": 0.5}})  # fmt: skip
    theta = solve(fine)["temperature"].values[:, 0]
    assert kept["temperature"].values[:, 0] == pytest.approx(theta, rel=0.1)


def test_a_lost_window(make_scene: MakeScene) -> None:
    """Strong gravity carries f to the edge of a window that was given: a warning, since what is given is kept."""
    with pytest.warns(UserWarning, match=r"upper edge of the velocity window .* widen grid\.velocity_window"):
        solve(make_scene(model={"gravity": 5.0}, initial={"mean_velocity": 0.0}, grid={"velocity_window": (-5.0, 5.0), "nv": 64}))


def test_a_window_lost_by_the_rules_stops(make_scene: MakeScene) -> None:
    """The chosen window is right for the scene; here f is put where the rules cannot know of it."""
    scene = make_scene(accuracy={"rtol": 1e-3})
    plan = make_plan(scene)
    f = np.exp(-((plan.grid.v - plan.grid.low - 1.0) ** 2))[None].repeat(plan.grid.nx, axis=0)
    problem = judged(plan, f, 0.3)
    assert problem is not None
    assert problem.what == "low"
    assert str(problem).startswith("t = 0.3: f at the lower edge of the velocity window spoils")
    assert "widen grid.velocity_window (accuracy.rtol = 0.001)" in str(problem)


def test_the_slow_edge_counts_with_its_amplification(make_scene: MakeScene) -> None:
    """The same f passes without collisions and is refused with (6) at R* = 7, which would make it of order one."""
    grid = {"nx": 9, "nv": 128, "velocity_window": (-4.2, 8.0), "time_step": 0.01, "drift_diffusion": "finite-volume"}
    start = {"modes": [], "mean_velocity": 1.0, "temperature": 0.5, "density": 1.0}
    with pytest.warns(UserWarning, match="the estimated error, 0.00076 of max f, exceeds accuracy.rtol = 0.0001"):
        solve(make_scene(initial=start, grid=grid, run={"end_time": 0.1}))
    strong = {"operator": "follow-the-leader", "cross_section": 7.0}
    with pytest.warns(UserWarning, match="lower edge"):
        solve(make_scene(initial=start, grid=grid, collisions=strong, run={"end_time": 1.0}))


def test_nan_stops_at_once(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    from kinetic_solver.operators.collisions import FollowLeader

    calls = []
    whole = FollowLeader.__call__

    def broken(self: FollowLeader, f: np.ndarray, dt: float) -> np.ndarray:
        calls.append(dt)
        out = whole(self, f, dt)
        if len(calls) == 4:
            out[0, 5] = np.nan
        return out

    monkeypatch.setattr(FollowLeader, "__call__", broken)
    with pytest.raises(SolverStopped, match="no longer finite") as caught:
        solve(make_scene(collisions=FOLLOW, run={"end_time": 1.0}, grid={"stepping": "strang"}))
    assert len(calls) == 4
    assert caught.value.dataset.sizes["time"] == 1
    one_line(caught.value)


def test_unresolved_waves_in_x(make_scene: MakeScene) -> None:
    plan = make_plan(make_scene(collisions=FOLLOW))
    grid = plan.grid
    f = np.exp(-((grid.v - 1) ** 2))[None] * (1 + 0.5 * np.cos(grid.wavenumbers[-1] * grid.x))[:, None]
    assert re.search(r"shortest waves in x carry .* raise grid\.nx", str(judged(plan, f)))


def test_negative_f(make_scene: MakeScene) -> None:
    plan = make_plan(make_scene(collisions=FOLLOW))
    grid = plan.grid
    f = np.exp(-((grid.v - 1) ** 2))[None] * (0.5 + np.cos(grid.wavenumbers[1] * grid.x))[:, None]
    assert re.search(r"negative by 0\.33 of its maximum; raise grid\.nx", str(judged(plan, f)))
    with pytest.raises(SolverStopped, match="no positive value left"):
        judged(plan, -np.abs(f))


def test_a_time_step_too_short_for_dv_is_said_once(make_scene: MakeScene) -> None:
    scene = make_scene(
        collisions=FOLLOW, grid={"nx": 27, "nv": 48, "velocity_window": (-7.0, 7.0), "time_step": 0.003, "stepping": "strang"}
    )
    with pytest.warns(UserWarning, match=r"what takes its place errs by about .* raise grid\.nv to \d+") as caught:
        plan = make_plan(scene)
    assert len(caught) == 1
    assert plan.drift_diffusion == "kernel"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is not a readable netCDF file"),
        ("no f", "has no f"),
        ("another period", "its period is"),
        ("no frame", "has no frame of f with numbers in it"),
    ],
)
def test_start_files_that_cannot_be_used(make_scene: MakeScene, tmp_path: Any, content: str | None, message: str) -> None:
    path = tmp_path / "start.nc"
    run = solve(make_scene(grid={"nx": 9, "nv": 32, "velocity_window": (-6.0, 8.0)}, run={"end_time": 0.1}))
    if content is None:
        path.write_text("not netCDF")
    elif content == "no f":
        run.drop_vars("f").to_netcdf(path)
    elif content == "another period":
        run.assign(x_bounds=2 * run["x_bounds"]).to_netcdf(path)
    else:
        (run * np.nan).assign(x_bounds=run["x_bounds"]).to_netcdf(path)
    scene = Scene.model_validate(
        {"pipe": {"length": 9.0}, "initial": {"file": str(path)}, "run": {"end_time": 0.1},
         "grid": {"nx": 9, "nv": 32, "velocity_window": (-6.0, 8.0)}}
    )  # fmt: skip
    with pytest.raises(SceneError, match=message) as caught:
        solve(scene)
    one_line(caught.value)
