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
