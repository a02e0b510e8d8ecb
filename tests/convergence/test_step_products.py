"""A density step under (12): what the products of its waves miss falls fast in dx, so that any rtol can be met."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, solve
from kinetic_solver.plan import make_plan

MakeScene = Callable[..., Scene]
STEP: dict[str, Any] = {
    "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.5},
    "initial": {"modes": [], "mean_velocity": 0.4, "temperature": 0.6, "step": {"from": 0.2, "to": 0.45, "ratio": 3.0}},
    "run": {"end_time": 0.5},
    "output": {"budgets": False, "moments": False},
}


def waves(scene: Scene) -> tuple[np.ndarray, int]:
    """(those of the last frame of f along x, over the number of points, that number)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a given grid is too poor
        f = solve(scene)["f"].values[-1]
    return np.fft.rfft(f, axis=0) / f.shape[0], f.shape[0]


def difference(coarse: Scene, fine: Scene) -> float:
    """max|Δf|/max f at the points of the coarse one."""
    (few, n), (many, _) = waves(coarse), waves(fine)
    phases = np.exp(2j * np.pi / n * np.outer(np.arange(n), np.arange(1, many.shape[0])))
    truth = many[0].real + 2 * (phases @ many[1:]).real
    mine = np.fft.irfft(few * n, n=n, axis=0)
    return float(np.abs(mine - truth).max() / truth.max())


def test_what_products_miss_falls_as_a_third_power_or_faster(make_scene: MakeScene) -> None:
    """nx = 45, 75, 135 against 315: 1.6e-3, 3.5e-4, 4.2e-5, orders 3.0 and 3.6 (4.1 at 243)."""
    grids = {nx: {"nx": nx, "nv": 48, "velocity_window": (-5.0, 6.0)} for nx in (45, 75, 135, 315)}
    scenes = {nx: make_scene(**STEP, accuracy={"rtol": 1e-5}, grid=grid) for nx, grid in grids.items()}
    errors = [difference(scenes[nx], scenes[315]) for nx in (45, 75, 135)]
    orders = [np.log(a / b) / np.log(ratio) for a, b, ratio in zip(errors, errors[1:], (75 / 45, 135 / 75), strict=False)]
    assert 2.7 < orders[0] < 3.4
    assert 3.2 < orders[1] < 4.2


@pytest.mark.parametrize("ratio", [0.1, 20.0])
def test_rtol_is_met(make_scene: MakeScene, ratio: float) -> None:
    """At 1e-5, against twice the points in x at rtol/5, on the same velocities."""
    table = {**STEP, "initial": {**STEP["initial"], "step": {"from": 0.2, "to": 0.45, "ratio": ratio}}}
    scene = make_scene(**table, accuracy={"rtol": 1e-5}, pipe={"length": 6.0})
    grid = make_plan(scene).grid
    given = {"nx": 2 * grid.nx + 1, "nv": grid.nv, "velocity_window": (grid.low, grid.high)}
    plain = make_scene(**table, accuracy={"rtol": 1e-5}, pipe={"length": 6.0}, grid={**given, "nx": grid.nx})
    fine = make_scene(**table, accuracy={"rtol": 2e-6}, pipe={"length": 6.0}, grid=given)
    assert 0.01e-5 < difference(plain, fine) < 1e-5
