"""Operator (6) where nothing depends on x: against the closed form, in windows over which a tilt spans more than doubles hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, exact, solve

BEAMS = [{"share": 0.4, "mean_velocity": 0.35, "temperature": 0.3}, {"share": 0.6, "mean_velocity": 0.6, "temperature": 2.4}]


def scene_of(friction: float, cross_section: float, end: float, **initial: Any) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 0.3, "friction": friction, "noise": 1.3},
            "pipe": {"length": 4.0},
            "initial": {"density": 1.2, **initial},
            "run": {"end_time": end},
            "collisions": {"operator": "follow-the-leader", "cross_section": cross_section},
        }
    )


@pytest.mark.parametrize("initial", [{"mean_velocity": 0.4, "temperature": 1.9}, {"beams": BEAMS}], ids=["one", "two beams"])
@pytest.mark.parametrize(("friction", "cross_section", "end"), [(0.0, 6.0, 2.2), (0.05, 2.0, 4.0), (0.7, 6.0, 4.0)])
def test_exact_to_a_hundredth_of_rtol(initial: dict[str, Any], friction: float, cross_section: float, end: float) -> None:
    """Of f; the mean velocity falls by up to 24 thermal ones."""
    scene = scene_of(friction, cross_section, end, **initial)
    run = solve(scene)
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
    assert float(abs(run["f"] - truth["f"]).max() / truth["f"].max()) < 1e-2 * scene.accuracy.rtol
    drop = float(run["mean_velocity"][0, 0] - run["mean_velocity"][-1, 0])
    assert drop > 5 * np.sqrt(1.3)


@pytest.mark.parametrize("waves", [(), ({"mode": 1, "cos": 0.3},)], ids=["one place", "waves"])
def test_what_no_double_holds_is_refused(waves: tuple[dict[str, Any], ...]) -> None:
    """The flow would come from 42 standard deviations below the mean: f there is exp(-880), and all of it was lost unseen."""
    with pytest.raises(SceneError, match=r"what is 42 standard deviations from the mean, and a double holds 37\.6; allowed: "):
        solve(scene_of(0.05, 6.0, 4.0, mean_velocity=0.4, temperature=2.0, modes=waves))
