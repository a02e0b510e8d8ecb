"""The time that a run will take, foretold from its plan: what a clock says to that is measured by benchmarks.random_kinds."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import pytest

from benchmarks.random_kinds_scenes import draw_scene
from benchmarks.random_scenes import random_scene
from kinetic_solver import Scene, solve
from kinetic_solver.plan import cost, make_plan
from kinetic_solver.plan.cost import in_words
from kinetic_solver.scene import INELASTIC
from kinetic_solver.stepping import Embedded

MakeScene = Callable[..., Scene]
COLLISIONS = {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}


@pytest.mark.parametrize("seed", [1, 2, 5, 8, 9])
def test_steps_under_error_control_are_foretold(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tries included, within a factor of two: R* from 0.5 to 4.7, steps bounded by transport as by collisions."""
    scene = random_scene(seed, 1e-3, INELASTIC)
    assert 1 / 2 < make_plan(scene).expected_steps / tries(scene, monkeypatch) < 2


@pytest.mark.parametrize("seed", [14, 41, 107, 131])
def test_steps_after_a_jump_are_foretold(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Likewise, R* from 0.006 to 3, of a step, of a thin gas and of a vacuum beside a dense one: before, of 40 steps 8."""
    scene = draw_scene(seed, 1e-3)[1]
    assert scene.initial.step is not None
    assert 1 / 2 < make_plan(scene).expected_steps / tries(scene, monkeypatch) < 2


def tries(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> int:
    """Of steps under error control, in a run."""
    tried = []
    onward = Embedded.onward
    monkeypatch.setattr(Embedded, "onward", lambda self, f, h, *more: tried.append(h) or onward(self, f, h, *more))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # where there are too few particles for a temperature
        solve(scene)
    return len(tried)


def test_a_run_costs_what_its_parts_cost(make_scene: MakeScene) -> None:
    """Twice the time takes about twice as long; pairs make (12) dearer by the square of nv; frames are counted."""
    slow = {"collisions": COLLISIONS, "output": {"budgets": False}}

    def seconds(**changes: object) -> float:
        return cost(make_plan(make_scene(**{**slow, **changes}))).seconds

    long, longer = seconds(run={"end_time": 400.0}), seconds(run={"end_time": 800.0})
    assert 1.5 < longer / long < 2.1
    coarse, fine = (cost(make_plan(make_scene(**slow, grid={"nx": 501, "nv": nv}))) for nv in (200, 400))
    assert 3.0 < fine.operations / coarse.operations < 4.1
    assert 2.0 < fine.seconds / coarse.seconds < 4.5
    few, many = (seconds(run={"end_time": 1.5, "output_every": every}) for every in (1.5, 0.0015))
    assert many > 5 * few


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.0123, "0.012 s"), (119.0, "1.2e+02 s"), (600.0, "10 minutes"), (1e6, "12 days")]
)
def test_a_time_in_words(seconds: float, words: str) -> None:
    assert in_words(seconds) == words
