"""The dataset's error_estimate against true errors of f over max f: the closed form, and for (12) a refined run.

What [grid] imposes is too poor on purpose, in one respect at a time. Measured ratios, estimate over error, are in the tables.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from benchmarks.random_kinds_scenes import draw_scene
from benchmarks.random_scenes import random_scene
from benchmarks.steps_error import judged, truth
from kinetic_solver import Scene, exact, solve
from kinetic_solver.plan import make_plan
from kinetic_solver.scene import INELASTIC as INELASTIC_NAME
from kinetic_solver.solver.estimate import PARTS
from kinetic_solver.solver.scheme import assemble
from tests.conftest import BASE, merge

FOLLOW = {"collisions": {"operator": "follow-the-leader", "cross_section": 0.9}}
INELASTIC = {"collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}}
COMMON = {"initial": {"mean_velocity": -0.4, "temperature": 0.9}, "run": {"end_time": 1.5, "output_every": 0.5},
          "output": {"moments": False, "budgets": False}}  # fmt: skip
"""θ0 = 1.8σ, u0 far from both homogeneous states."""
NARROW = {6: (-3.8, 2.7), 12: (-2.7, 3.3), 0: (-2.5, 3.1)}
TOO_LOW, TOO_HIGH = 0.4, 50.0
"""Bounds of estimate/error; the table's values are from 0.6 to 41."""

Truth = Callable[[xr.Dataset], np.ndarray]


def scene_of(*changes: dict[str, Any]) -> Scene:
    table = merge(BASE, COMMON)
    for change in changes:
        table = merge(table, change)
    return Scene.model_validate(table)


@pytest.fixture(scope="module")
def refined() -> xr.Dataset:
    """(12) on a given grid that resolves it: its own estimate is 1e-6, a hundredth of the smallest error below."""
    grid = {"nx": 45, "nv": 144, "velocity_window": (-7.5, 8.0)}
    return solve(scene_of(INELASTIC, {"accuracy": {"rtol": 1e-6}, "grid": grid}))


def on_the_points_of(found: xr.Dataset, fine: xr.Dataset) -> np.ndarray:
    """f of the refined run, (time, x, v), by trigonometric interpolation in both."""

    def matrix(points: np.ndarray, source: np.ndarray) -> np.ndarray:
        period, k = (source[1] - source[0]) * source.size, np.arange(1 - source.size // 2, (source.size + 1) // 2)
        return (
            np.exp(2j * np.pi / period * np.outer(points, k)) @ np.exp(-2j * np.pi / period * np.outer(k, source)) / source.size
        )

    x, v = matrix(found["x"].values, fine["x"].values), matrix(found["v"].values, fine["v"].values)
    return np.einsum("ix,txv,jv->tij", x, fine["f"].values, v, optimize=True).real


def error_and_run(scene: Scene, fine: xr.Dataset | None = None) -> tuple[float, xr.Dataset]:
    """max|Δf|/max f, the worst frame after time 0, and the run."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that what is given is too poor: tests/faults/test_stops.py
        found = solve(scene)
    truth = on_the_points_of(found, fine) if fine is not None else exact.solve(scene, x=found["x"], v=found["v"])["f"].values
    errors = np.abs(found["f"].values - truth).max(axis=(1, 2)) / truth.max(axis=(1, 2))
    return float(errors[1:].max()), found


def ratio(scene: Scene, part: str, fine: xr.Dataset | None = None) -> float:
    """error_estimate over the true error, where `part` is the largest part, and named as what limits the run."""
    error, found = error_and_run(scene, fine)
    parts = {name: float(found[name].max()) for name in PARTS}
    assert max(parts, key=lambda name: parts[name]) == part, (error, parts)
    assert found.attrs["limited_by"].startswith(PARTS[part])
    estimate = found["error_estimate"]
    assert float(estimate[0]) == 0.0
    assert float(estimate.max()) <= sum(parts.values()) * (1 + 1e-12)
    return float(estimate.max()) / error


FOLLOW_CASES = {
    "nx = 9": ({"nx": 9}, "error_x"),  # 0.6
    "nx = 13": ({"nx": 13}, "error_x"),  # 0.7
    "extrapolated, nx = 9": ({"nx": 9, "stepping": "extrapolated"}, "error_x"),  # 3.6
    "extrapolated, nx = 13": ({"nx": 13, "stepping": "extrapolated"}, "error_x"),  # 1.3
    "window": ({"velocity_window": NARROW[6]}, "error_window"),  # 8
    "extrapolated, window": ({"velocity_window": NARROW[6], "stepping": "extrapolated"}, "error_window"),  # 3.5
    "finite volumes, nv = 48": ({"nv": 48, "drift_diffusion": "finite-volume"}, "error_v"),  # 1 to 1.6
    "finite volumes, nv = 96": ({"nv": 96, "drift_diffusion": "finite-volume"}, "error_v"),
    "strang, h = 0.5": ({"time_step": 0.5, "stepping": "strang"}, "error_time"),  # 1.1
    "strang, h = 0.25": ({"time_step": 0.25, "stepping": "strang"}, "error_time"),  # 1.4
}


@pytest.mark.parametrize("case", FOLLOW_CASES)
def test_operator_6(case: str) -> None:
    grid, part = FOLLOW_CASES[case]
    assert TOO_LOW < ratio(scene_of(FOLLOW, {"grid": grid}), part) < TOO_HIGH


@pytest.mark.parametrize(
    ("grid", "part"),
    [
        ({"velocity_window": NARROW[0]}, "error_window"),  # 1.5
        ({"nv": 22}, "error_window"),  # 1.5: at the points the spacing in v makes a twentieth of that
        ({"nv": 48, "drift_diffusion": "finite-volume"}, "error_v"),  # 1.06
    ],
)
def test_without_collisions(grid: dict[str, Any], part: str) -> None:
    assert TOO_LOW < ratio(scene_of({"grid": grid}), part) < TOO_HIGH


INELASTIC_CASES = {
    "nv = 32": ({"nv": 32}, "error_v"),  # 1.2
    "nv = 40": ({"nv": 40}, "error_v"),  # 1.1
    "linear, nv = 24": ({"nv": 24, "deposit": "linear"}, "error_v"),  # 0.91
    "linear, nv = 96": ({"nv": 96, "deposit": "linear"}, "error_v"),  # 0.88
    "cubic, nv = 48": ({"nv": 48, "deposit": "cubic"}, "error_v"),  # 1.04
    "nx = 9": ({"nx": 9}, "error_x"),  # 8
    "window": ({"velocity_window": NARROW[12]}, "error_window"),  # 0.43
    "strang, h = 0.5": ({"time_step": 0.5, "stepping": "strang"}, "error_time"),  # 6.3
    "strang, h = 0.1": ({"time_step": 0.1, "stepping": "strang"}, "error_time"),  # 6.8
}


@pytest.mark.parametrize("case", INELASTIC_CASES)
def test_operator_12(case: str, refined: xr.Dataset) -> None:
    grid, part = INELASTIC_CASES[case]
    assert TOO_LOW < ratio(scene_of(INELASTIC, {"grid": grid}), part, refined) < TOO_HIGH


@pytest.mark.parametrize("collisions", ["none", "(6)", "(12)"])
def test_what_rtol_chooses(collisions: str, refined: xr.Dataset) -> None:
    """At rtol = 1e-3 nothing is imposed: the error is below rtol, and so is the estimate; where it is the smaller one, both are
    below rtol/10."""
    table = {"none": {}, "(6)": FOLLOW, "(12)": INELASTIC}[collisions]
    scene = scene_of(table, {"accuracy": {"rtol": 1e-3}})
    error, found = error_and_run(scene, refined if collisions == "(12)" else None)
    estimate = float(found["error_estimate"].max())
    assert error < 1e-3
    assert estimate < 1e-3
    assert estimate > error or error < 1e-4


HARDER = [
    pytest.param({"drift_diffusion": "finite-volume-8"}, id="(6), finite volumes of order 8 from a hot start"),
    pytest.param({"stepping": "strang", "time_step": 0.02}, id="(6), Strang, on nv for finite volumes of order 8"),
    pytest.param({"stepping": "extrapolated", "nx": 5}, id="(6), fewer than 8 points in x"),
    pytest.param(
        {"stepping": "extrapolated", "nv": 32},
        id="(6), extrapolated, given nv: finite volumes in the kernel's place",
        marks=pytest.mark.xfail(
            reason="the steps are too short for dv to resolve the kernel: warned of, not counted", strict=True
        ),
    ),
]


@pytest.mark.parametrize("grid", HARDER)
def test_not_too_small(grid: dict[str, Any]) -> None:
    """Where the error is least like what the estimate looks at."""
    error, found = error_and_run(scene_of(FOLLOW, {"grid": grid}))
    assert float(found["error_estimate"].max()) > TOO_LOW * error or error < 1e-4


@pytest.mark.parametrize("grid", [{"nx": 5}, {"nx": 7}, {"velocity_window": (-3.2, 3.8)}])
def test_operator_12_not_too_small(grid: dict[str, Any], refined: xr.Dataset) -> None:
    """Errors of 2e-3 to 9e-3, of which the estimate says a hundredth to a fifth."""
    error, found = error_and_run(scene_of(INELASTIC, {"grid": grid}), refined)
    assert float(found["error_estimate"].max()) > TOO_LOW * error


FEW_STEPS = [("random", 10), ("random", 15), ("kinds", 26), ("kinds", 50)]
"""(Draw, seed): a few steps each. Before estimates knew of weak collisions, the last two told a fifteenth of
their error and a tenth."""


@pytest.mark.parametrize(("draw", "seed"), FEW_STEPS)
def test_steps_of_operator_12_tell_their_error(draw: str, seed: int) -> None:
    """Against the same grid at steps without error: what they tell is the error of f or more, and no more than 25 times that; and
    the error is no more than 0.6 rtol, which the grid shares."""
    rtol = 1e-4 if (draw, seed) == ("kinds", 26) else 1e-3
    plan = make_plan(random_scene(seed, rtol, INELASTIC_NAME) if draw == "random" else draw_scene(seed, rtol)[1])
    assert plan.stepping == "extrapolated"
    found = judged(plan, truth(plan, assemble(plan).representation.start()))
    assert 1 / 25 < found.over_told < 1, found
    assert found.error < 0.6, found


def test_rounding_that_collisions_amplify_is_told() -> None:
    """R_t = 19, where no grid meets rtol: f errs by 9e-4 of its maximum."""
    scene = Scene.model_validate(
        {
            "model": {"gravity": 1.3, "friction": 0.3, "noise": 0.8},
            "collisions": {"operator": "follow-the-leader", "cross_section": 5.0},
            "pipe": {"length": 47.0},
            "initial": {
                "density": 0.9,
                "modes": [{"mode": 1, "cos": 0.6}, {"mode": 4, "sin": 0.25}],
                "mean_velocity": 0.4,
                "temperature": 0.7,
            },
            "run": {"end_time": 5.0},
            "accuracy": {"rtol": 1e-4},
            "output": {"moments": False, "budgets": False},
        }
    )
    with pytest.warns(UserWarning, match="limited by rounding"):
        run = solve(scene)
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
    off = float(np.abs(run["f"][-1] - truth["f"][-1]).max() / truth["f"][-1].max())
    assert 1e-4 < off < float(run["error_rounding"][-1]) < 300 * off
