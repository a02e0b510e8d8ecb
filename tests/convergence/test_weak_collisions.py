"""Collisions so weak that they change nothing: (6) is as accurate as without them, from any start, by any number."""

from __future__ import annotations

from typing import Any

import pytest

from kinetic_solver import Scene, exact, solve

STARTS: dict[str, dict[str, Any]] = {
    "a wave": {"modes": [{"mode": 1, "cos": 0.3}]},
    "a step": {"step": {"from": 0.2, "to": 0.5, "ratio": 3.0}},
}


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("cross_section", [1e-100, 1e-12, 1e-5])
def test_weak_collisions_of_operator_6(start: str, cross_section: float) -> None:
    """W = exp(SΦ) is 1 to round-off, and 1/S of what rounding leaves of it is no density: rtol is kept, and the estimate is no
    less than the error."""
    scene = Scene.model_validate(
        {
            "model": {"gravity": 1.3, "friction": 0.7, "noise": 1.7},
            "collisions": {"operator": "follow-the-leader", "cross_section": cross_section},
            "pipe": {"length": 11.0},
            "initial": {"density": 1.2, "mean_velocity": 0.3, "temperature": 0.9, **STARTS[start]},
            "run": {"end_time": 1.9, "output_every": 0.95},
            "accuracy": {"rtol": 1e-5},
        }
    )
    run = solve(scene)
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
    error = max(float(abs(run["f"] - truth["f"])[n].max() / truth["f"][n].max()) for n in (1, 2))
    assert error <= float(run["error_estimate"].max()) <= scene.accuracy.rtol
