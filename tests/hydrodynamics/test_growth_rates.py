"""What waves do in runs of the closure and of M moments, against the cubic and the spectrum of M moments, on both sides of
ρ_c."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.hydrodynamics import AMPLITUDE, hierarchy_rate, measured, started
from kinetic_solver import hydrodynamics
from kinetic_solver.scene import Scene
from kinetic_solver.stability import closure_rates, critical_density

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}


def rate_of(run: Any, mode: int, guess: complex) -> complex:
    return measured(run["time"].values, run["density"].values, mode, guess)


@pytest.mark.parametrize("mode", [1, 2, 5, 8])
@pytest.mark.parametrize(("factor", "sign"), [(0.9, -1), (1.1, 1)])
def test_the_closure_follows_the_cubic_on_both_sides_of_its_critical_density(
    make_scene: MakeScene, mode: int, factor: float, sign: int
) -> None:
    """|Δs| ≤ 1e-6 |Re s|, though Re s is a few per cent of the frequency."""
    density = factor * critical_density(make_scene(collisions=FOLLOW), mode)
    scene, s = started(make_scene(collisions=FOLLOW, initial={"density": density}, run={"end_time": 0.3}), mode, 160)
    assert s == pytest.approx(closure_rates(scene, mode)[0], rel=1e-12)
    found = rate_of(hydrodynamics.solve(scene), mode, s)
    assert abs(found - s) < 1e-6 * abs(s.real)
    assert np.sign(found.real) == sign == np.sign(s.real)


@pytest.mark.parametrize("number", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("mode", [1, 4])
def test_operator_12_decays_as_its_cubic_says(make_scene: MakeScene, number: float, mode: int) -> None:
    density = number * 0.7 / math.sqrt(0.5) / 2.3
    scene, s = started(make_scene(collisions=INELASTIC, initial={"density": density}, run={"end_time": 0.3}), mode, 160)
    assert np.abs(closure_rates(scene, mode) - s).min() < 1e-9 * abs(s)
    assert s.real < 0
    assert abs(rate_of(hydrodynamics.solve(scene), mode, s) - s) < 1e-6 * abs(s.real)


@pytest.mark.parametrize("moments", [3, 4, 7, 12])
@pytest.mark.parametrize(("factor", "sign"), [(0.9, -1), (1.1, 1)])
def test_m_moments_follow_their_spectrum(make_scene: MakeScene, moments: int, factor: float, sign: int) -> None:
    """Modes 1 to 8 of the density, each at its own critical density of M moments, from the wave itself."""
    for mode in (1, 3, 8):
        density = factor * critical_density(make_scene(collisions=FOLLOW), mode, moments)
        initial = {"density": density, "modes": [{"mode": mode, "cos": AMPLITUDE}]}
        scene = make_scene(
            collisions=FOLLOW, initial=initial, hydrodynamics={"moments": moments}, run={"end_time": 0.7}, accuracy={"rtol": 1e-8}
        )
        found, s = hierarchy_rate(scene, mode)
        assert abs(found - s) < 1e-6 * abs(s.real)
        assert np.sign(found.real) == sign
