"""What is known beforehand of errors other than chance."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.compare.recognition import side_of
from kinetic_solver.compare.systematic import CELLS, EXACT, STEP, contact_excess, systematic_parts
from kinetic_solver.stability import structure_factor
from particles.plan import make_plan
from tests.cross_validation.compare.laid_over import FEW, FOLLOW, MakeScene, ensemble, on_the_grid, raw, truth, with_collisions


def test_systematic_parts(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, particles=FEW)
    plan = make_plan(scene)
    run = ensemble(scene)
    assert systematic_parts(truth(scene), scene) == {"closed form": EXACT}
    found = systematic_parts(run, scene)
    assert list(found) == ["step", "cells", "finite N"]
    assert found["step"] == STEP * plan.relative_step**2
    assert found["cells"] == CELLS * plan.relative_width**2
    assert found["finite N"] == contact_excess(scene, plan.cells)
    assert systematic_parts(ensemble(make_scene(particles=FEW)), make_scene(particles=FEW)) == {"exact steps": 0}
    grid = on_the_grid(make_scene(collisions=FOLLOW))
    assert systematic_parts(grid, scene) == {"grid": max(1e-4, float(np.nanmax(grid["error_estimate"])))}
    assert systematic_parts(grid.drop_vars("error_estimate"), scene) == {"grid": 1e-4}
    side = side_of(run, "A")
    assert side.bound == sum(found.values())
    assert side_of(raw(ensemble(make_scene(particles=FEW, output={"particles": True}))), "A").bound == 0


@pytest.mark.parametrize("number", [0.3, 1.0, 2.0])
def test_the_excess_of_pairs_at_contact(make_scene: MakeScene, number: float) -> None:
    """(2/N) Σ (S_m - 1): at least the sum to the wave as long as a cell, within 5 %, and as 1/N."""
    scene = with_collisions(make_scene, number)
    for cells in (1, 20, 50):
        waves = range(1, max(cells, 8) + 1)
        direct = 2 / 1000 * float((structure_factor(scene, waves).values - 1).sum())
        assert 0.999 * direct < contact_excess(scene, cells) < 1.05 * direct
    double = with_collisions(make_scene, number, particles={"count": 2000})
    assert contact_excess(double, 20) == pytest.approx(contact_excess(scene, 20) / 2)
    assert contact_excess(with_collisions(make_scene, number, model={"friction": 0.0}), 20) == 0


@pytest.mark.parametrize(("kind", "least"), [("single-file", 1000), ("dsmc", 400)])
def test_waves_of_pairs_at_contact(make_scene: MakeScene, kind: str, least: int) -> None:
    """Single files see the distance between neighbours, 1000 waves here; 400 cells see 400."""
    scene = with_collisions(
        make_scene, 1.0, particles={"count": 1000, "collisions": kind} | ({"cells": 400} if kind == "dsmc" else {})
    )
    direct = 2 / 1000 * float((structure_factor(scene, range(1, least + 1)).values - 1).sum())
    part = systematic_parts(ensemble(scene), scene)["finite N"]
    assert direct < part < 1.2 * direct


def test_steps_are_those_that_are_taken(make_scene: MakeScene) -> None:
    """Frames cut a longer step short."""
    given = {"count": 1000, "time_step": 50.0}
    plan = make_plan(make_scene(collisions=FOLLOW, particles=given, run={"output_every": 0.5}))
    assert plan.longest_step == 0.5
    assert plan.relative_step == pytest.approx(0.5 * plan.fastest)
