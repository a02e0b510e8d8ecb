"""The grid follows the solution: it grows where it was too small, shrinks where less will do, and what [grid] gives is kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SolverStopped, exact, solve
from kinetic_solver.dataset import Frame, MemoryRecorder
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.solver import adaptation, integrate
from kinetic_solver.solver.monitor import Judgement, Monitor, Problem
from kinetic_solver.solver.observation import Observation

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.9}
STRONG = {"operator": "follow-the-leader", "cross_section": 2.5}
INELASTIC = {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}
COLLISIONS = {"(6)": FOLLOW, "(12)": INELASTIC}
WARM = {"mean_velocity": -0.4, "temperature": 0.9}
RUN = {"end_time": 1.5, "output_every": 0.5}
LONG = {"collisions": STRONG, "initial": {"temperature": 4.0}, "run": {"end_time": 50.0, "output_every": 10.0}}
HOT = {
    "collisions": INELASTIC,
    "initial": {"mean_velocity": -0.4, "temperature": 8.0},
    "run": {"end_time": 6.0, "output_every": 1.0},
    "accuracy": {"rtol": 1e-3},
}


class Counting(MemoryRecorder):
    """Remembers when it was handed frames."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan.output, plan.scene, plan.schedule)
        self.handed: list[float] = []

    def record(self, time: float, frame: Frame) -> None:
        self.handed.append(time)
        super().record(time, frame)


def run_plan(plan: Plan) -> xr.Dataset:
    recorder = Counting(plan)
    report = integrate(plan, recorder)
    recorder.close(report=report.attributes())
    assert recorder.handed == plan.scene.times().tolist()  # every frame, and none twice
    return recorder.dataset()


def poorer(scene: Scene, *, nx: float = 1.0, nv: float = 1.0, window: float = 1.0) -> Plan:
    """The scene's plan with these fractions of the solver's first grid, nx odd and at least 9. The output's grid stays."""
    plan = make_plan(scene)
    grid = plan.grid
    middle, half = (grid.low + grid.high) / 2, (grid.high - grid.low) / 2 * window
    small = dataclasses.replace(
        grid, nx=max(9, int(grid.nx * nx) | 1), nv=int(grid.nv * nv * window), low=middle - half, high=middle + half
    )
    return dataclasses.replace(plan, grid=small)


def grids(dataset: xr.Dataset) -> list[tuple[int, int]]:
    """(nx, nv) of the first grid and of all that followed."""
    return [tuple(int(n) for n in part.split(":")[1].split(" on ")[0].split("×")) for part in dataset.attrs["grids"].split(";")]


def of_f(found: xr.Dataset, truth: xr.Dataset) -> float:
    """max|Δf|/max f, the worst frame after time 0."""
    return float((abs(found["f"] - truth["f"]).max(("x", "v")) / truth["f"].max(("x", "v")))[1:].max())


def truth_of(scene: Scene, found: xr.Dataset) -> xr.Dataset:
    """The closed form for (6); for (12) a run at rtol/30 on a given grid, which nothing may change, thrice as fine, and wider."""
    if scene.operator != "inelastic":
        return exact.solve(scene, x=found["x"], v=found["v"])
    grid, more = make_plan(scene).output, 8
    wider = (grid.low - more * grid.dv, grid.high + more * grid.dv)
    given = {"nx": grid.nx, "nv": 3 * (grid.nv + 2 * more), "velocity_window": wider}
    accuracy = {"rtol": scene.accuracy.rtol / 30}
    fine = solve(Scene.model_validate({**scene.model_dump(), "grid": given, "accuracy": accuracy}))
    return fine.isel(v=slice(3 * more + 1, -3 * more, 3)).assign_coords(v=found["v"])


def coordinates_are_the_plans(scene: Scene, found: xr.Dataset) -> None:
    grid = make_plan(scene).output
    assert np.array_equal(found["x"], grid.x)
    assert np.array_equal(found["v"], grid.v)


@pytest.mark.parametrize("lack", [{"nx": 0.3}, {"nv": 0.5}, {"window": 0.5}, {"nx": 0.4, "nv": 0.6, "window": 0.6}])
@pytest.mark.parametrize("collisions", COLLISIONS)
def test_a_plan_that_is_too_small_is_mended(make_scene: MakeScene, collisions: str, lack: dict[str, float]) -> None:
    """With a third of nx, half of nv, half of the window, on the coordinates of the plan: rtol is met. What stays of too coarse
    a dv, which is refined only until peaks are resolved, is at least said."""
    scene = make_scene(collisions=COLLISIONS[collisions], initial=WARM, run=RUN)
    found = run_plan(poorer(scene, **lack))
    coordinates_are_the_plans(scene, found)
    assert found.attrs["grids"].startswith("t = 0: ")
    sizes = grids(found)
    assert len(sizes) > 1
    assert np.prod(sizes[-1]) > np.prod(sizes[0])
    said = float(found["error_estimate"].max()) if "nv" in lack else 0.0
    assert of_f(found, truth_of(scene, found)) < max(1e-4, said)


@pytest.mark.parametrize("lack", [{"nx": 0.3}, {"nv": 0.5}, {"window": 0.5}])
@pytest.mark.parametrize("collisions", COLLISIONS)
def test_budgets_close_over_a_change(make_scene: MakeScene, collisions: str, lack: dict[str, float]) -> None:
    """Nothing of what was dropped is booked: mass to round-off, the residuals within rtol of what the terms move."""
    found = run_plan(poorer(make_scene(collisions=COLLISIONS[collisions], initial=WARM, run=RUN), **lack))
    assert len(grids(found)) > 1
    mass = float(found["mass"][-1])
    assert mass == pytest.approx(0.8 * 9, rel=1e-4)
    for kind in ("momentum", "energy"):
        moved = sum(float(abs(found[name]).max()) for name in found if str(name).startswith(f"{kind}_from_"))
        assert abs(found[f"{kind}_residual"]).max() < 1e-4 * moved, kind
    assert abs(found["mass_residual"]).max() < 1e-4 * mass


@pytest.mark.parametrize("collisions", COLLISIONS)
def test_what_is_given_is_kept(make_scene: MakeScene, collisions: str) -> None:
    """nx, nv and the window: a warning, and the grid of the scene to the end."""
    scene = {"collisions": COLLISIONS[collisions], "initial": WARM, "run": RUN}
    for given, warning in (
        ({"nx": 9}, r"raise grid\.nx"),
        ({"velocity_window": (-3.2, 2.8)}, r"widen grid\.velocity_window"),
        ({"velocity_window": (-3.2, 2.8), "nv": 40, "nx": 35}, r"widen grid\.velocity_window"),
    ):
        with pytest.warns(UserWarning, match=warning):
            found = solve(make_scene(**scene, grid=given))
        assert len(grids(found)) == 1
        assert found.sizes["x"] == given.get("nx", found.sizes["x"])
        if "velocity_window" in given:
            assert (found["v_bounds"][0, 0], found["v_bounds"][-1, 1]) == pytest.approx(given["velocity_window"], rel=1e-12)


@pytest.mark.parametrize("collisions", COLLISIONS)
def test_a_given_nv_that_is_too_small_stops(make_scene: MakeScene, collisions: str) -> None:
    scene = make_scene(collisions=COLLISIONS[collisions], initial=WARM, run=RUN, grid={"nv": 20})
    with pytest.raises(SolverStopped, match=r"narrower than 1\.4 dv .* raise grid\.nv") as caught:
        solve(scene)
    assert "refining" not in str(caught.value)
    assert caught.value.dataset.sizes["v"] == 20


@pytest.mark.parametrize(("case", "fewer"), [("(6) from hot to rest", 5), ("(12) from hot to cold", 3)])
def test_a_run_shrinks_its_grid(make_scene: MakeScene, case: str, fewer: int) -> None:
    """Later grids have fewer points, so many times at the end: those of (12) takes few steps, and looks for smaller ones after
    every ten. rtol, mass and coordinates are kept."""
    scene = make_scene(**(LONG if case.startswith("(6)") else HOT))
    found = run_plan(make_plan(scene))
    coordinates_are_the_plans(scene, found)
    points = [nx * nv for nx, nv in grids(found)]
    assert points == sorted(points, reverse=True)
    assert len(points) > 1
    assert points[-1] < points[0] / fewer
    assert abs(found["mass"] / found["mass"][0] - 1).max() < 1e-12
    assert of_f(found, truth_of(scene, found)) < scene.accuracy.rtol
    for kind in ("momentum", "energy"):
        moved = sum(float(abs(found[name]).max()) for name in found if str(name).startswith(f"{kind}_from_"))
        assert abs(found[f"{kind}_residual"]).max() < 1e-4 * moved, kind


def test_a_run_with_a_given_grid_does_not_shrink(make_scene: MakeScene) -> None:
    given = make_plan(make_scene(**HOT)).grid
    table = {"nx": given.nx, "nv": given.nv, "velocity_window": (given.low, given.high)}
    assert len(grids(solve(make_scene(**HOT, grid=table)))) == 1


@pytest.mark.parametrize("scene", [LONG, HOT])
def test_two_runs_give_the_same_bits(make_scene: MakeScene, scene: dict[str, Any]) -> None:
    """Also where the grid changes: nothing depends on the clock on the wall, or on what ran before."""
    first, second = solve(make_scene(**scene)), solve(make_scene(**scene))
    assert len(grids(first)) > 1
    assert first.attrs["grids"] == second.attrs["grids"]
    for name in first.data_vars:
        assert np.array_equal(first[name], second[name], equal_nan=True), name


@pytest.mark.parametrize("collisions", COLLISIONS)
def test_a_grid_that_does_not_help_stops_the_run(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch, collisions: str) -> None:
    """A defect that no nx mends: given up after a few, with one line, and the frames before it kept."""
    judge = Monitor.judge

    def never_good(self: Monitor, seen: Observation, share: float) -> Judgement:
        found = judge(self, seen, share)
        if seen.clock <= 1.2:
            return found
        problem = Problem("nx", 0.1, f"t = {seen.time:g}", "it is not resolved; raise grid.nx")
        return Judgement(found.diagnostics, problem)

    monkeypatch.setattr(Monitor, "judge", never_good)
    with pytest.raises(
        SolverStopped, match=r"not resolved \(refining the grid \d+ times did not help\); raise accuracy\.rtol, or end"
    ) as caught:
        solve(make_scene(collisions=COLLISIONS[collisions], initial=WARM, run=RUN))
    assert "\n" not in str(caught.value)
    kept = caught.value.dataset
    assert kept["time"].values.tolist() == [0.0, 0.5, 1.0]
    assert int(kept["status"]) == 2
    assert np.isfinite(kept["f"].values).all()


def test_a_grid_may_not_grow_without_end(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond MOST_GROWTH times the first plan's points."""
    monkeypatch.setattr(adaptation, "MOST_GROWTH", 1.2)
    plan = poorer(make_scene(collisions=INELASTIC, initial=WARM, run=RUN), nx=0.0)
    recorder = Counting(plan)
    with pytest.raises(SolverStopped, match=r"waves in x carry .*; raise accuracy\.rtol, or end"):
        integrate(plan, recorder)
    assert recorder.handed == [0.0]


def test_a_shrunk_grid_still_holds_a_cooling_gas() -> None:
    """(12), homogeneous, from twenty times the temperature of its end: nv made smaller on the way was 1.6 rtol off."""
    scene = Scene.model_validate({
        "model": {"gravity": -2.9, "friction": 0.21, "noise": 0.5},
        "collisions": {"operator": "inelastic", "cross_section": 3.0, "restitution": 0.1},
        "pipe": {"length": 2.0},
        "initial": {"mean_velocity": 6.8, "temperature": 2.5},
        "run": {"end_time": 1.0},
        "accuracy": {"rtol": 1e-5},
        "output": {"budgets": False},
    })  # fmt: skip
    run = solve(scene)
    v, dv = run["v"].values, float(run["v"][1] - run["v"][0])
    finer = {"nv": 3 * v.size, "velocity_window": (float(v[0] - dv / 2), float(v[-1] + dv / 2))}
    truth = solve(Scene.model_validate({**scene.model_dump(by_alias=True), "grid": finer, "accuracy": {"rtol": 2e-6}}))
    f, fine = run["f"].values[-1, 0], truth["f"].values[-1, 0][1::3]
    assert np.abs(f - fine).max() < 1e-5 * fine.max()
    assert float(run["error_estimate"].max()) < 1e-5
