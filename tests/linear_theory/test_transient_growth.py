"""Transient growth: no initial state exceeds it, the optimal one reaches it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability import density_gain, transient_growth
from kinetic_solver.stability.amplification import growth_times
from kinetic_solver.stability.closure import closure_generator
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.follow_leader import _enough_functions
from kinetic_solver.stability.inelastic import _discretisation, inelastic_flow
from kinetic_solver.stability.units import dimensionless
from kinetic_solver.theory.hermite import hermite_functions

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 2.6}
INELASTIC = {"operator": "inelastic", "cross_section": 20.0, "restitution": 0.4}


@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_the_optimal_state_grows_most(make_scene: MakeScene, collisions: dict[str, Any]) -> None:
    scene = make_scene(collisions=collisions)
    flow, units = flow_of(scene)
    k = dimensionless(scene, 1)
    equations = flow.equations(k)
    growth = transient_growth(scene)
    best = int(growth["gain"].values.argmax())
    t, gain = units.gamma * growth["time"].values[best], growth["gain"].values[best]
    propagator = expm(t * equations.generator(k))
    # Project the optimal state, as points in v, on Hermite functions: ∫δf φ_n dv.
    y = units.velocity(growth["v"].values) / math.sqrt(flow.temperature)
    state = growth["optimal_real"].values + 1j * growth["optimal_imag"].values
    dv = growth["v"].values[1] - growth["v"].values[0]
    start = hermite_functions(y, np.ones(y.size), equations.count)[:30] @ state * dv
    start = np.append(start, np.zeros(equations.count - 30))
    assert np.linalg.norm(start) == pytest.approx(1.0, abs=2e-4)
    assert np.linalg.norm(propagator @ start) ** 2 == pytest.approx(gain, rel=1e-3)
    random = np.random.default_rng(3).normal(size=(equations.count, 200)) * np.exp(-0.3 * np.arange(equations.count))[:, None]
    grown = np.linalg.norm(propagator @ random, axis=0) ** 2 / np.linalg.norm(random, axis=0) ** 2
    assert grown.max() < gain
    assert gain > 1


def test_density_gain_is_part_of_it(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW)
    growth = transient_growth(scene, 2)
    closed = density_gain(scene, 2, growth["time"].values)
    assert growth["density_gain"].values == pytest.approx(closed, rel=1e-9, abs=1e-12)
    assert (closed <= growth["gain"].values * (1 + 1e-9)).all()
    assert growth["gain"].values[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("mode", "number"), [(1, 1.3), (3, 2.2)])
def test_enough_functions(make_scene: MakeScene, mode: int, number: float) -> None:
    """G of (6) to 1e-6: with twice as many Hermite functions it is the same."""
    cross = number * 0.7 / math.sqrt(0.5) / 0.8
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": cross})
    times = np.array([0.3, 1.0, 2.5, 6.0])
    k = dimensionless(scene, mode)
    twice = closure_generator(k, number, 2 * _enough_functions(k, number))
    expected = [np.linalg.norm(expm(0.7 * t * twice), 2) ** 2 for t in times]
    assert transient_growth(scene, mode, times)["gain"].values == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize(("restitution", "number", "wavenumber"), [(0.3, 5.0, 1.0), (0.9, 300.0, 4.0), (0.0, 100.0, 0.25)])
def test_density_gain_on_velocity_points(restitution: float, number: float, wavenumber: float) -> None:
    """(12) in Hermite functions against velocity points: the norm of the linear form δf(0) → ∫δf(t) dv."""
    flow, grid = inelastic_flow(restitution, number), _discretisation(restitution, number, 6.0, 44.0)
    times = np.array([0.0, 0.1, 0.7, 3.0])
    maxwellian = np.exp(-(grid.w**2) / (2 * flow.temperature)) / math.sqrt(2 * math.pi * flow.temperature)
    forms = [expm(t * grid.generator(wavenumber)).sum(axis=0) for t in times]
    expected = [float(np.sum(np.abs(form) ** 2 * maxwellian)) * grid.dv for form in forms]
    assert flow.density_gain(wavenumber, times) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("cross", [0.6, 3.1, 6.0])
@pytest.mark.parametrize("length", [2.0, 9.0, 600.0])
def test_the_times_take_in_the_largest_growth(make_scene: MakeScene, cross: float, length: float) -> None:
    """√G_ρ's maximum over `growth_times` is that over a hundred times as many, to 2e-3."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": cross}, pipe={"length": length})
    fine = density_gain(scene, 1, growth_times(scene, 1, 20_000))
    assert math.sqrt(density_gain(scene).max()) == pytest.approx(math.sqrt(fine.max()), rel=2e-3)


def test_nothing_grows_without_collisions(make_scene: MakeScene) -> None:
    growth = transient_growth(make_scene())
    assert growth["gain"].values.max() <= 1 + 1e-12
    assert density_gain(make_scene()).max() <= 1 + 1e-12


def test_beyond_reach_is_said(make_scene: MakeScene) -> None:
    """Too many moments for R* = 19; the density's growth is known all the same."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 24.0})
    with pytest.raises(SceneError, match=r"512 moments do not resolve transient growth"):
        transient_growth(scene)
    with pytest.raises(SceneError, match=r"model.friction = 0"):
        density_gain(make_scene(model={"friction": 0.0}))
    gain = density_gain(scene)
    assert math.isfinite(gain.max())
    assert gain.max() > 1e100
