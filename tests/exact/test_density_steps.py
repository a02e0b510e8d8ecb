"""Jumps in the initial density, and frames too early for the kernel on the run's own velocity points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, exact, initial, solve

MakeScene = Callable[..., Scene]
STEP = {"modes": [], "step": {"from": 0.2, "to": 0.45, "ratio": 3.0}}


def follow(cross_section: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": cross_section}


def worst(scene: Scene) -> float:
    """max|Δf|/max f over all frames but the first."""
    run = solve(scene).isel(time=slice(1, None))
    truth = exact.solve(scene, x=run["x"], v=run["v"]).isel(time=slice(1, None))
    return float((abs(run["f"] - truth["f"]).max(["x", "v"]) / truth["f"].max(["x", "v"])).max())


@pytest.mark.parametrize("cross_section", [0.0, 0.6, 2.0])
@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_a_step_against_the_closed_form(make_scene: MakeScene, cross_section: float, rtol: float) -> None:
    scene = make_scene(
        collisions=follow(cross_section), initial=STEP, run={"end_time": 1.5, "output_every": 0.5}, accuracy={"rtol": rtol}
    )
    assert worst(scene) <= rtol
    mass = solve(scene)["mass"].values
    assert np.abs(mass / mass[0] - 1).max() < 1e-12
    assert mass[0] == pytest.approx(0.8 * 9.0, rel=rtol)  # but for what lies beyond the window


def test_the_grid_carries_exact_waves_of_a_step(make_scene: MakeScene) -> None:
    """Fourier coefficients against sums over a million samples, whose own error is 1e-6 of the jump; the mean to round-off."""
    scene = make_scene(initial=STEP)
    x = 9.0 / 45 * np.arange(45)
    waves = np.fft.rfft(initial.resolved_density(scene, x)) / 45
    many = np.fft.rfft(initial.density(scene, 9.0 / 1_000_000 * np.arange(1_000_000))) / 1_000_000
    assert np.abs(waves - many[: waves.size]).max() < 3e-6
    assert waves[0].real == pytest.approx(0.8, rel=1e-15)


def test_what_is_shown_at_time_0_is_the_step_itself(make_scene: MakeScene) -> None:
    run = solve(make_scene(collisions=follow(0.6), initial=STEP, run={"end_time": 0.5}, accuracy={"rtol": 1e-2}))
    outer = 0.8 / (1 + 2 * 0.25)
    assert set(np.round(run["density"].values[0] / outer, 2)) == {1.0, 3.0}


def test_a_step_is_refused_where_it_cannot_be_resolved(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match=r"accuracy\.rtol = 1e-05: with initial\.step collisions"):
        solve(make_scene(collisions=follow(0.6), initial=STEP, accuracy={"rtol": 1e-5}))
    with pytest.raises(SceneError, match=r"initial\.step: .* more than 20000 modes at the first frame, t = 1e-05"):
        solve(make_scene(initial=STEP, run={"end_time": 1.0, "output_every": 1e-5}))


@pytest.mark.parametrize("cross_section", [1.2, 6.5])
def test_early_frames(make_scene: MakeScene, cross_section: float) -> None:
    """A fiftieth of the shortest link and on: R* = 1 and 5.3, both gauges."""
    scene = make_scene(
        collisions=follow(cross_section), run={"end_time": 0.3, "output_every": 0.01}, accuracy={"rtol": 1e-5},
        output={"budgets": False},
    )  # fmt: skip
    assert worst(scene) <= 1e-5
