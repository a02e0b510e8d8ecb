"""The grid solver against the closed form: observed orders in the time step and in dv, each from both sides.

ρ0 = 1 + 0.5 cos kx + 0.2 sin 3kx, L = 8π, g = γ = σ = 1, t = 2; errors are max|Δf|/max f.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, exact, solve

MakeScene = Callable[..., Scene]
WINDOWS = {0.3: (-7.5, 7.5), 2.0: (-12.0, 8.0)}


def error(scene: Scene) -> float:
    final = solve(scene).isel(time=-1)
    truth = exact.solve(scene, x=final["x"], v=final["v"]).isel(time=-1)
    return float(abs(final["f"] - truth["f"]).max() / truth["f"].max())


def orders(errors: list[float]) -> list[float]:
    return [math.log2(a / b) for a, b in pairwise(errors)]


def refined(make: MakeScene, number: float, grids: list[dict[str, Any]]) -> list[float]:
    return [error(make(number, accuracy={"rtol": 1e-2}, grid={"velocity_window": WINDOWS[number], **grid})) for grid in grids]


@pytest.mark.parametrize(("number", "nx", "finest"), [(0.3, 63, 4e-6), (2.0, 105, 6e-5)])
def test_second_order_in_the_time_step(standing_scene: MakeScene, number: float, nx: int, finest: float) -> None:
    """With the exact kernel dv and dx cost nothing: what is left is Strang's error."""
    grids = [{"nx": nx, "nv": 256, "time_step": 2 / steps, "stepping": "strang"} for steps in (20, 40, 80, 160)]
    errors = refined(standing_scene, number, grids)
    assert all(1.95 < order < 2.05 for order in orders(errors)), errors
    assert errors[-1] < finest


@pytest.mark.filterwarnings("ignore:the estimated error:UserWarning")  # that the coarsest of the given grids are too coarse
@pytest.mark.parametrize(("number", "nx"), [(0.3, 63), (2.0, 105)])
def test_finite_volumes_are_second_order_in_dv(standing_scene: MakeScene, number: float, nx: int) -> None:
    steps = 400 if number == 0.3 else 800
    grids = [
        {"nx": nx, "nv": nv, "time_step": 2 / steps, "stepping": "strang", "drift_diffusion": "finite-volume"}
        for nv in (96, 192, 384)
    ]
    errors = refined(standing_scene, number, grids)
    assert all(1.85 < order < 2.1 for order in orders(errors)), errors


@pytest.mark.parametrize("number", [0.3, 2.0])
def test_spectral_in_x_and_v(standing_scene: MakeScene, number: float) -> None:
    """Coarse and fine grids differ by round-off once they resolve f: against the finest, at the same step."""
    scene = standing_scene(
        number,
        accuracy={"rtol": 1e-1},
        grid={"velocity_window": WINDOWS[number], "time_step": 0.1, "nx": 189, "nv": 270, "stepping": "strang"},
    )
    fine = solve(scene).isel(time=-1)["f"].values
    top = fine.max()

    def coarse(nx: int, nv: int) -> float:
        grid = scene.grid.model_copy(update={"nx": nx, "nv": nv})
        f = solve(scene.model_copy(update={"grid": grid})).isel(time=-1)["f"].values
        return float(np.abs(f - fine[:: 189 // nx, 270 // nv // 2 :: 270 // nv]).max() / top)

    assert coarse(63, 270) < {0.3: 1e-13, 2.0: 1e-6}[number]
    assert coarse(189, 90) < 1e-11
