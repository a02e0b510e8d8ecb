"""A run of the grid that was stopped and resumed has the bits of one that went through: every scheme, wherever it was stopped."""

from __future__ import annotations

import dataclasses
import io
import itertools
import json
import warnings
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from kinetic_solver.dataset import Frame
from kinetic_solver.dataset.trees import pack, unpack
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.scene import Scene
from kinetic_solver.solver import checkpoint, integrate
from kinetic_solver.solver.loop import March
from kinetic_solver.solver.report import Report

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.9}
STRONG = {"operator": "follow-the-leader", "cross_section": 6.0}
INELASTIC = {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}
RUN = {"end_time": 1.5, "output_every": 0.5}
BEAMS = [
    {"share": 0.3, "mean_velocity": -2.0, "temperature": 0.02},
    {"share": 0.7, "mean_velocity": 1.5, "temperature": 0.3},
]
WARM = {"mean_velocity": -0.4, "temperature": 0.9}
COARSE = {"rtol": 1e-3}
STRANG: dict[str, Any] = {"grid": {"stepping": "strang", "time_step": 0.05}, "accuracy": COARSE}

CASES: dict[str, dict[str, Any]] = {
    "no collisions": {},
    "(6), exact steps": {"collisions": FOLLOW},
    "(12), homogeneous": {"collisions": INELASTIC, "initial": {"modes": []}},
    "(12), homogeneous, of many points": {"collisions": INELASTIC, "initial": {"modes": [], "beams": BEAMS}},
    "(6), local gauge": {"collisions": STRONG, "initial": {"modes": [{"mode": 1, "cos": 0.8}]}},
    "(6), frames closer than steps": {"collisions": FOLLOW, "run": {"end_time": 0.3, "output_every": 0.02}},
    "(6), Strang": {"collisions": FOLLOW, **STRANG},
    "(6), extrapolated": {"collisions": FOLLOW, "grid": {"stepping": "extrapolated"}},
    "(6), given steps": {"collisions": FOLLOW, "grid": {"stepping": "extrapolated", "time_step": 0.04}},
    "(6), Hermite": {"collisions": FOLLOW, "grid": {"velocity": "hermite"}},
    "(6), a step in the density": {
        "collisions": FOLLOW,
        "initial": {"modes": [], "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}},
        "accuracy": COARSE,
    },
    "(12)": {"collisions": INELASTIC},
    "(12), about the homogeneous state": {"collisions": INELASTIC, "grid": {"stepping": "exponential"}},
    "(12), no budgets": {"collisions": INELASTIC, "output": {"budgets": False}},
    "(12), Strang": {"collisions": INELASTIC, **STRANG},
    "(12), Hermite": {"collisions": INELASTIC, "grid": {"velocity": "hermite"}},
    "(12), cooling in a moving frame": {
        "model": {"friction": 0.3, "noise": 0.0},
        "collisions": INELASTIC,
        "initial": {"temperature": 1.1, "mean_velocity": 0.3},
        "accuracy": COARSE,
    },
    "(12), in scaled velocities": {
        "model": {"friction": 0.0, "noise": 0.0},
        "collisions": INELASTIC,
        "initial": {"temperature": 1.1, "mean_velocity": 0.3, "modes": []},
        "run": {"end_time": 60.0, "output_every": 20.0},
        "accuracy": COARSE,
    },
    "(6), no friction": {
        "model": {"friction": 0.0},
        "collisions": FOLLOW,
        "initial": {"temperature": 1.1, "mean_velocity": 0.3},
        "accuracy": COARSE,
    },
    "(12), a grid that shrinks": {
        "collisions": INELASTIC,
        "initial": {"mean_velocity": -0.4, "temperature": 8.0},
        "run": {"end_time": 3.0, "output_every": 1.0},
        "accuracy": COARSE,
    },
}
MOST = 4
"""Places at which each run is stopped, the first and the last step among them."""


class Frames:
    """Keeps what it is handed."""

    def __init__(self) -> None:
        self.all: list[tuple[float, Frame]] = []

    def record(self, time: float, frame: Frame) -> None:
        self.all.append((time, frame))

    def close(self, stopped: str | None = None, report: Any = None) -> None: ...


class Stopped(Exception):
    pass


def through_a_file(tree: Any) -> Any:
    arrays: list[np.ndarray] = []
    text = json.dumps(pack(tree, arrays))
    stream = io.BytesIO()
    np.savez(stream, *arrays)
    stream.seek(0)
    with np.load(stream) as file:
        read = [file[f"arr_{n}"] for n in range(len(arrays))]
    return unpack(json.loads(text), read, {kind.__name__: kind for kind in checkpoint.TYPES})


def straight(plan: Plan) -> tuple[Frames, Report, int]:
    frames, counter = Frames(), itertools.count()
    report = integrate(plan, frames, after_step=lambda march: next(counter) and None)
    return frames, report, next(counter)


def in_two_parts(plan: Plan, where: int) -> tuple[Frames, Report]:
    """Stopped at the first step from `where` on whose state may be kept; frames after the last that it knows are dropped."""
    frames, taken, counter = Frames(), [], itertools.count(1)

    def stop(march: March) -> None:
        if next(counter) >= where and (found := checkpoint.snapshot(march)) is not None:
            taken.append(through_a_file(found))
            raise Stopped

    with pytest.raises(Stopped):
        integrate(plan, frames, after_step=stop)
    assert len(frames.all) == taken[0]["frame"] + 1
    return frames, integrate(plan, frames, state=taken[0])


def same(a: Frames, b: Frames) -> None:
    assert [time for time, _ in a.all] == [time for time, _ in b.all]
    for (time, one), (_, other) in zip(a.all, b.all, strict=True):
        assert one.keys() == other.keys()
        for group in one:
            assert one[group].keys() == other[group].keys()
            for name in one[group]:
                assert np.array_equal(one[group][name], other[group][name], equal_nan=True), (time, name)


def holds(plan: Plan, most: int = MOST) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        frames, report, looks = straight(plan)
        for where in sorted({int(n) for n in np.linspace(1, looks, most)}):
            found, again = in_two_parts(plan, where)
            same(found, frames)
            assert again == report


@pytest.mark.parametrize("case", CASES)
def test_resumed_runs_have_the_same_bits(make_scene: MakeScene, case: str) -> None:
    holds(make_plan(make_scene(**{"run": RUN, **CASES[case]})))


@pytest.mark.parametrize("lack", [{"nx": 0.3}, {"nv": 0.5}, {"window": 0.5}], ids=str)
@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_so_have_those_whose_grid_grows(make_scene: MakeScene, collisions: dict[str, Any], lack: dict[str, float]) -> None:
    plan = make_plan(make_scene(collisions=collisions, initial=WARM, run=RUN))
    grid, window = plan.grid, lack.get("window", 1.0)
    middle, half = (grid.low + grid.high) / 2, (grid.high - grid.low) / 2 * window
    nx, nv = max(9, int(grid.nx * lack.get("nx", 1.0)) | 1), int(grid.nv * lack.get("nv", 1.0) * window)
    poor = dataclasses.replace(grid, nx=nx, nv=nv, low=middle - half, high=middle + half)
    holds(dataclasses.replace(plan, grid=poor))


@pytest.mark.parametrize("stepping", [STRANG, {}], ids=["Strang", "chosen"])
@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_on_another_number_of_threads(make_scene: MakeScene, collisions: dict[str, Any], stepping: dict[str, Any]) -> None:
    plan = make_plan(make_scene(collisions=collisions, run=RUN, **stepping))
    frames, _, looks = straight(plan)
    one = numba.get_num_threads()
    numba.set_num_threads(2)
    try:
        found, _ = in_two_parts(plan, looks // 2)
    finally:
        numba.set_num_threads(one)
    same(found, frames)


def test_a_state_that_fails_its_checks_is_not_kept(make_scene: MakeScene) -> None:
    """Between judgements the state of the moment is judged first, and nothing is said or changed by that."""
    plan = make_plan(make_scene(collisions=INELASTIC, run=RUN, **STRANG))
    spoilt: list[bool] = []

    def look(march: March) -> None:
        if not march.judged and not spoilt:
            assert checkpoint.snapshot(march) is not None
            now = march.now
            march.now = dataclasses.replace(now, f=-now.f)
            assert checkpoint.snapshot(march) is None
            march.now = now
            assert march.monitor.warned == {}
            spoilt.append(True)

    with_looks, without = Frames(), Frames()
    integrate(plan, with_looks, after_step=look)
    integrate(plan, without)
    assert spoilt
    same(with_looks, without)


def test_a_stop_does_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no state is fit to be kept, as while a run looks for a grid that holds f, it stops all the same, after PATIENCE."""
    from types import SimpleNamespace

    from kinetic_solver.errors import RunUnfinished
    from kinetic_solver.methods import interruption

    clock = [100.0]
    monkeypatch.setattr(interruption, "monotonic", lambda: clock[0])
    done: list[str] = []
    recorder = SimpleNamespace(settle=lambda: done.append("settled"), sync=lambda: done.append("synced"))
    checkpoint = SimpleNamespace(save=lambda time, tree: done.append("saved"))
    asked = SimpleNamespace(stop="SIGTERM", keep=False, heeded=False)
    keeper = interruption.Keeper(checkpoint, recorder, None, asked, began=90.0)  # type: ignore[arg-type]
    keeper.look(1.0, lambda: None)
    clock[0] += 0.9 * interruption.PATIENCE
    keeper.look(1.2, lambda: None)
    assert "synced" not in done
    clock[0] += 0.2 * interruption.PATIENCE
    with pytest.raises(RunUnfinished, match=r"stopped at t = 1\.3 by SIGTERM, looking for a grid that holds f") as caught:
        keeper.look(1.3, lambda: None)
    assert (caught.value.by, done[-1]) == ("SIGTERM", "synced")
    assert "saved" not in done
