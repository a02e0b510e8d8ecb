"""The critical density of the three-moment closure, against the roots of its cubic."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver.scene import Scene
from kinetic_solver.stability import critical_density

MakeScene = Callable[..., Scene]


def growth(scene: Scene, mode: int, density: float) -> float:
    """The largest Re s of the cubic at that density."""
    gamma, sigma = scene.model.friction, scene.model.noise
    k, s = 2 * math.pi * mode / scene.pipe.length, scene.cross_section
    a, c = k * k * sigma, 1j * k * sigma * s * density
    return float(np.roots([1, 3 * gamma, 2 * gamma**2 + 3 * a - 3 * c, 2 * gamma * (a - c)]).real.max())


@pytest.mark.parametrize("mode", [1, 2, 5, 40, 4000])
def test_the_closure_turns_unstable_there(make_scene: MakeScene, mode: int) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    rho_c = critical_density(scene, mode)
    assert growth(scene, mode, 0.999 * rho_c) < 0 < growth(scene, mode, 1.001 * rho_c)


def test_limits(make_scene: MakeScene) -> None:
    """R*_c → 7√3/9 for short waves, (4/3)^(1/4)/√k* for long ones."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    to_group = 1.7 * math.sqrt(0.5) / 0.7
    assert critical_density(scene, 10**6) * to_group == pytest.approx(7 * math.sqrt(3) / 9, rel=1e-10)
    long = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 1.7}, pipe={"length": 1e8}, initial={"modes": []}
    )
    assert critical_density(long) * to_group == pytest.approx((4 / 3) ** 0.25 / math.sqrt(long.groups.wavenumber), rel=1e-3)


def test_inf_where_there_is_none(make_scene: MakeScene) -> None:
    inelastic = {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.5}
    assert critical_density(make_scene()) == critical_density(make_scene(collisions=inelastic)) == math.inf
    with pytest.raises(ValueError, match="mode = 0"):
        critical_density(make_scene(), 0)


@pytest.mark.parametrize(
    ("moments", "wavenumber", "expected"),
    [
        (3, 1.0, 1.4801),
        (5, 1.0, 2.4256),
        (8, 1.0, 3.5951),
        (2, 1e4, 1.0),
        (4, 1e4, 1.634884),
        (5, 1e4, 1.885713),
        (8, 1e4, 2.507493),
    ],
)
def test_closures_with_more_moments_turn_unstable_later(moments: int, wavenumber: float, expected: float) -> None:
    """Parameters unequal; three moments by the generator's eigenvalues as by the cubic."""
    gamma, sigma, cross_section = 0.7, 0.5, 1.9
    length = 2 * math.pi * math.sqrt(sigma) / (gamma * wavenumber)
    scene = Scene.model_validate(
        {
            "model": {"gravity": 1.3, "friction": gamma, "noise": sigma},
            "collisions": {"operator": "follow-the-leader", "cross_section": cross_section},
            "pipe": {"length": length},
            "run": {"end_time": 1.0},
        }
    )
    number = critical_density(scene, 1, moments) * cross_section * math.sqrt(sigma) / gamma
    assert number == pytest.approx(expected, abs=1e-4)


def test_the_generator_reproduces_the_cubic() -> None:
    from kinetic_solver.stability.closure import closure_generator

    for number in (0.4, 1.4, 3.1):
        for k in (0.2, 1.0, 7.0):
            s = np.linalg.eigvals(closure_generator(k, number, 3))
            cubic = np.roots([1, 3, 2 + 3 * k * k - 3j * k * number, 2 * (k * k - 1j * k * number)])
            assert np.abs(np.sort_complex(s) - np.sort_complex(cubic)).max() < 1e-10 * np.abs(cubic).max()
