"""Frames are looked at, not built upon: how many there are changes neither the grid nor the answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kinetic_solver import Scene, exact, solve
from kinetic_solver.plan import make_plan

MakeScene = Callable[..., Scene]


def error(scene: Scene, run: xr.Dataset) -> float:
    """max|Δf|/max f over about ten of the frames."""
    worst = 0.0
    for n in np.unique(np.linspace(1, run.sizes["time"] - 1, 10).astype(int)):
        truth = exact.Solution(scene, float(run["time"][n])).distribution(run["x"].values, run["v"].values)
        worst = max(worst, float(np.abs(run["f"].values[n] - truth).max() / truth.max()))
    return worst


def residual(run: xr.Dataset) -> float:
    """Of momentum, over all that gravity brought."""
    return float(np.abs(run["momentum_residual"]).max() / np.abs(run["momentum_from_gravity"]).max())


@pytest.mark.parametrize("frames", [1, 50, 1000])
def test_a_clustering_pipe(standing_scene: MakeScene, frames: int) -> None:
    """R* = 2, ten relaxation times: error below its estimate, and 1e-6 of rtol; the momentum's budget closed to 1e-8."""
    scene = standing_scene(2.0, run={"end_time": 10.0, "output_every": 10.0 / frames}, output={"moments": False, "budgets": True})
    grid = make_plan(scene).grid
    assert grid == make_plan(scene.model_copy(update={"run": scene.run.model_copy(update={"output_every": None})})).grid
    run = solve(scene.replace(**{"output.nx": grid.nx, "output.nv": grid.nv}))  # where the solver has them
    found = error(scene, run)
    assert found < 1e-8
    assert found < float(run["error_estimate"].max()) < 1e-4
    assert residual(run) < 1e-8


@settings(max_examples=12)
@given(
    cross_section=st.sampled_from([0.0, 0.4, 1.3, 5.0]),
    friction=st.sampled_from([0.3, 1.1, 2.3]),
    length=st.sampled_from([2.1, 9.0, 47.0]),
    temperature=st.sampled_from([0.2, 0.7, 1.6]),
    end=st.floats(0.5, 5.0),
    cadence=st.floats(0.003, 0.4),
    rtol=st.sampled_from([1e-2, 1e-4, 1e-6]),
)
def test_any_cadence(
    cross_section: float, friction: float, length: float, temperature: float, end: float, cadence: float, rtol: float
) -> None:
    # With both (6) amplifies rounding beyond rtol, which the run says (tests/convergence/test_estimate.py).
    assume(not (cross_section == 5.0 and friction == 0.3))
    table: dict[str, Any] = {
        "model": {"gravity": 1.3, "friction": friction, "noise": 0.8},
        "pipe": {"length": length},
        "initial": {
            "density": 0.9,
            "modes": [{"mode": 1, "cos": 0.6}, {"mode": 4, "sin": 0.25}],
            "mean_velocity": 0.4,
            "temperature": temperature,
        },
        "accuracy": {"rtol": rtol},
        "output": {"moments": False},
    }
    if cross_section:
        table["collisions"] = {"operator": "follow-the-leader", "cross_section": cross_section}
    found = {}
    for every in (end, cadence * end):
        scene = Scene.model_validate(table | {"run": {"end_time": end, "output_every": every}})
        run = solve(scene)
        assert error(scene, run) <= rtol
        found[every] = (run.sizes["x"], run.sizes["v"], run.attrs["grids"].count("×"))
        assert residual(run) < max(rtol, 1e-5)
    if cross_section:  # without, nothing couples: waves that have faded by the first frame need no velocities that hold them
        assert len(set(found.values())) == 1
