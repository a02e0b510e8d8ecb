"""A hydrodynamic run that was stopped and resumed has the bits of one that went through, wherever it was stopped."""

from __future__ import annotations

import itertools
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinetic_solver.dataset import Frame
from kinetic_solver.dataset.trees import pack, unpack
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics import FrameStore, Plan, Run, integrate, make_plan
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}
CASES: dict[str, dict[str, Any]] = {
    "(6)": {"collisions": FOLLOW, "accuracy": {"rtol": 1e-8}, "run": {"end_time": 0.5, "output_every": 0.2}},
    "(12)": {"collisions": INELASTIC, "output": {"scalars": 0.1}, "run": {"end_time": 0.5, "output_every": 0.2}},
    "a step": {
        "collisions": FOLLOW,
        "initial": {"modes": [], "step": {"from": 0.2, "to": 0.6, "ratio": 3.0}},
        "run": {"end_time": 0.2, "output_every": 0.05},
        "accuracy": {"rtol": 6e-3},
    },
    "a given grid": {"collisions": FOLLOW, "grid": {"nx": 64, "time_step": 0.05}, "accuracy": {"rtol": 1e-2}},
    "an odd grid": {"grid": {"nx": 33}},
    "homogeneous": {"collisions": FOLLOW, "initial": {"modes": [], "mean_velocity": -1.0, "temperature": 1.9}},
    "that runs away": {
        "collisions": {"operator": "follow-the-leader", "cross_section": 2.97},
        "pipe": {"length": 15.0},
        "run": {"end_time": 30.0, "output_every": 1.5},
        "grid": {"nx": 64},
    },
    "M moments": {"collisions": FOLLOW, "hydrodynamics": {"moments": 5}, "run": {"end_time": 1.5, "output_every": 0.3}},
    "M moments, more waves": {
        "collisions": {"operator": "follow-the-leader", "cross_section": 4.0},
        "hydrodynamics": {"moments": 8},
        "accuracy": {"rtol": 1e-7},
    },
    "M moments, a given step": {"hydrodynamics": {"moments": 4}, "grid": {"time_step": 0.03}, "run": {"end_time": 0.5}},
}
MOST = 6
"""Places at which each run is stopped, the first and the last among them."""


class Stopped(Exception):
    pass


class Frames:
    """Keeps what it is handed."""

    def __init__(self) -> None:
        self.all: list[tuple[float, Frame]] = []

    def record(self, time: float, frame: Frame) -> None:
        self.all.append((time, frame))

    def close(self, stopped: str | None = None, report: Any = None) -> None: ...


def end(plan: Plan, frames: Frames, after_step: Callable[[Run], None], state: Any | None, store: FrameStore) -> Any:
    """What a run reports, or why it could not go on."""
    with warnings.catch_warnings(action="ignore"):
        try:
            return integrate(plan, frames, None, after_step, state, store)
        except SolverStopped as stop:
            return str(stop)
        finally:
            store.close()


def there_and_back(state: Any) -> Any:
    arrays: list[np.ndarray] = []
    return unpack(json.loads(json.dumps(pack(state, arrays))), [array.copy() for array in arrays], {})


@pytest.mark.parametrize("case", CASES)
def test_resumed_bits(make_scene: MakeScene, tmp_path: Path, case: str) -> None:
    plan = make_plan(make_scene(**CASES[case]))
    straight, calls = Frames(), itertools.count(1)
    expected = end(plan, straight, lambda run: next(calls) and None, None, FrameStore(tmp_path / "straight"))
    last = next(calls) - 1
    assert last >= 2
    for place in sorted({*np.linspace(1, last, MOST).round().astype(int).tolist()}):
        frames, kept, calls = Frames(), [], itertools.count(1)

        def stop(run: Run, place: int = place, kept: list[Any] = kept, calls: Any = calls) -> None:
            if next(calls) == place:
                kept.append(there_and_back(run.snapshot()))
                raise Stopped

        with pytest.raises(Stopped):
            end(plan, frames, stop, None, FrameStore(tmp_path / "stopped"))
        report = end(plan, frames, lambda run: None, kept[0], FrameStore(tmp_path / "stopped"))
        assert report == expected
        assert len(frames.all) == len(straight.all) > 1
        for (time, found), (wanted_time, wanted) in zip(frames.all, straight.all, strict=True):
            assert time == wanted_time
            assert found.keys() == wanted.keys()
            for group in wanted:
                for name in wanted[group]:
                    assert np.array_equal(found[group][name], wanted[group][name]), (place, time, name)


def test_the_cases_are_what_they_say(make_scene: MakeScene) -> None:
    """Several passes, one that runs away, waves that are added on the way."""
    said = {}
    for case in ("(6)", "a step", "that runs away", "M moments", "M moments, more waves"):
        plan = make_plan(make_scene(**CASES[case]))
        said[case] = end(plan, Frames(), lambda run: None, None, FrameStore())
    assert int(said["(6)"]["points"]) > 256
    assert said["a step"]["flow"] == "jumps"
    assert "runs away" in said["that runs away"]
    assert int(said["M moments, more waves"]["waves"]) > 16
