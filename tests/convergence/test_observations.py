"""What watches a run sees one state at a time: that of the step just taken, on the grid it was taken on."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, exact, solve
from kinetic_solver.dataset import MemoryRecorder
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.solver import integrate
from kinetic_solver.solver.adaptation import Change, History, Stop, enlarged, shrunk
from kinetic_solver.solver.monitor import Judgement, Monitor, Problem
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.scheme import assemble

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.9}
INELASTIC = {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5}
HERMITE: dict[str, Any] = {
    "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
    "collisions": INELASTIC,
    "pipe": {"length": 8 * math.pi},
    "initial": {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
    "run": {"end_time": 2.0},
    "grid": {"velocity": "hermite"},
    "accuracy": {"rtol": 1e-6},
}


def with_functions(count: int) -> Plan:
    plan = make_plan(Scene.model_validate(HERMITE))
    return dataclasses.replace(plan, grid=dataclasses.replace(plan.grid, nv=count))


def test_too_few_hermite_functions_are_noticed_in_time() -> None:
    """Started with 23 functions, (12) at rtol = 1e-6 meets it: the coefficients judged within an interval are the present ones.
    (Judged late, the error was 8.6e-6 and the estimate said 3.8e-7.)"""
    plan = with_functions(23)
    recorder = MemoryRecorder(plan.output, plan.scene, plan.schedule)
    report = integrate(plan, recorder)
    found = recorder.dataset()
    fine = {**HERMITE, "accuracy": {"rtol": 1e-8}, "grid": {"velocity": "hermite", "nv": 90, "nx": 105}}
    truth = solve(Scene.model_validate({**fine, "output": {"f": False}}))
    rho = truth["density"].values[-1]
    # Density has no grid in v to differ by; in x the modes of both are compared.
    ours, theirs = np.fft.rfft(found["density"].values[-1]) / found.sizes["x"], np.fft.rfft(rho) / rho.size
    shared = min(ours.size, theirs.size)
    assert 2 * np.abs(ours[:shared] - theirs[:shared]).sum() < 1e-6 * rho.max()
    assert report.error < 1e-6
    assert report.grids.count("×") > 1


@pytest.mark.parametrize("table", [{"collisions": FOLLOW}, {"collisions": INELASTIC}, HERMITE])
def test_what_is_judged_is_what_was_stepped(
    make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch, table: dict[str, Any]
) -> None:
    """f belongs to the state, the state to the scheme's grid; clocks never stand still but where a run goes back."""
    seen: list[Observation] = []
    judge = Monitor.judge

    def spy(self: Monitor, observation: Observation, share: float) -> Judgement:
        seen.append(observation)
        return judge(self, observation, share)

    monkeypatch.setattr(Monitor, "judge", spy)
    scene = make_scene(**table) if table is not HERMITE else Scene.model_validate({**HERMITE, "accuracy": {"rtol": 1e-4}})
    solve(scene)
    assert len(seen) >= 2
    for observation in seen:
        assert np.array_equal(observation.f, observation.scheme.representation.points(observation.state))
        assert observation.f.shape == (observation.grid.nx, observation.grid.nv)
        assert observation.since <= observation.clock
    with pytest.raises(dataclasses.FrozenInstanceError):
        seen[0].clock = 1.0  # type: ignore[misc]


def test_f_within_an_exact_step_is_the_closed_form(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the budgets integrate over an exact step is f at times at which nothing is written."""
    steps: list[Observation] = []
    finite = Monitor.finite
    monkeypatch.setattr(Monitor, "finite", lambda self, seen: (steps.append(seen), finite(self, seen))[1])
    scene = make_scene(collisions=FOLLOW, initial={"mean_velocity": -0.4, "temperature": 0.6})
    solve(scene)
    last = steps[-1]
    assert last.within is not None
    grid = last.grid
    for part in (0.3, 0.8):
        clock = last.since + part * (last.clock - last.since)
        truth = exact.Solution(scene, clock).distribution(grid.x, grid.v)
        assert np.abs(last.within(clock) - truth).max() < 1e-4 * truth.max()


def test_adaptation_is_a_function(make_scene: MakeScene) -> None:
    """The same plan, problem and history give the same answer, and none of them is changed."""
    plan = make_plan(make_scene(collisions=INELASTIC, initial={"mean_velocity": -0.4, "temperature": 0.9}))
    history = History(plan.grid)
    problem = Problem("nx", 1e-3, "t = 0.5", "waves; raise grid.nx")
    first, second = (enlarged(plan, problem, history, exact=False) for _ in range(2))
    assert isinstance(first, Change)
    assert isinstance(second, Change)
    assert first.plan.grid == second.plan.grid
    assert first.plan.grid.nx > plan.grid.nx
    assert (first.plan.grid.nv, first.plan.grid.low) == (plan.grid.nv, plan.grid.low)
    assert history.tried == ()
    assert first.history.tried == (("nx", 1e-3),)
    given = plan.with_inner(plan.inner.model_copy(update={"grid": plan.inner.grid.model_copy(update={"nx": plan.grid.nx})}))
    assert enlarged(given, problem, history, exact=False) == Stop("t = 0.5: waves; raise grid.nx")
    # What was once too small is not made smaller.
    scheme = assemble(plan)
    seen = Observation.of(scheme, 1e-3, scheme.representation.start(), since=0.999e-3)
    settled = dataclasses.replace(history, tried=(("nx", 1.0), ("nv", 1.0), ("low", 1.0)))
    assert shrunk((seen,), settled) is None
