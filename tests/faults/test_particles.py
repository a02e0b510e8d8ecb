"""Particles that are lost, cells with too many of them, ensembles that no machine holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError
from particles import collisions
from particles.plan import make_plan
from particles.simulation import Simulation, simulate

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("operator", [None, FOLLOW], ids=["none", "(6)"])
def test_a_velocity_that_is_not_finite_stops_the_run(
    make_scene: MakeScene, operator: dict[str, object] | None, bad: float
) -> None:
    plan = make_plan(make_scene(collisions=operator, particles={"count": 1000}))
    state = Simulation(plan).state()
    state["v"][0, 17] = bad
    with pytest.raises(RuntimeError, match=r"step 0: places or velocities of particles are not finite"):
        Simulation(plan, state).advance_to(1.0)


def test_more_candidates_than_a_counter_tells_apart(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell, one long step: the count of draws reaches its end, and no draw is used twice."""
    particles = {"count": 40_000, "replicas": 1, "cells": 1, "time_step": 1.5}
    simulation = Simulation(make_plan(make_scene(collisions={**FOLLOW, "cross_section": 400.0}, particles=particles)))
    assert collisions.DRAWS == 2**24
    with pytest.raises(RuntimeError, match=r"candidate pairs in a cell; raise particles\.cells"):
        simulation.advance_to(1.5)


def test_an_ensemble_that_does_not_fit(make_scene: MakeScene) -> None:
    with pytest.raises(
        SceneError, match=r"particles: count = 1000000000000, replicas = 2, cells = 51 need .* GiB, this machine has"
    ):
        make_plan(make_scene(particles={"count": 10**12, "replicas": 2}))


@pytest.mark.parametrize("nx", [1, 2])
def test_a_homogeneous_run_has_no_waves(make_scene: MakeScene, nx: int) -> None:
    run = simulate(make_scene(initial={"modes": []}, grid={"nx": nx}, particles={"count": 100, "replicas": 2}))
    assert "density_mode_real" not in run
    assert run["density"].values == pytest.approx(0.8, rel=1e-12)
