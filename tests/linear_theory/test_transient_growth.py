"""Transient growth: no initial state exceeds it, the optimal one reaches it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from kinetic_solver.scene import Scene, SceneError
from kinetic_solver.stability import density_gain, transient_growth
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.hermite import hermite_functions
from kinetic_solver.stability.units import dimensionless

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
