"""The third moment that the closure drops, in an eigenmode of (2) with (6): closed form, eigenfunction, and grid solver."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver import solve, stability
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}


def ratios(scene: Scene, mode: int) -> tuple[complex, complex]:
    """(-(1/ρ)∂q/∂x, -Sq) over -2θ∂u/∂x, all linear, from moments of the slowest branch's eigenfunction about u_h."""
    u_h, sigma = stability.mean_velocity(scene), scene.model.noise
    k = 2 * math.pi * mode / scene.pipe.length
    w, dw = np.linspace(-14, 14, 2801, retstep=True)
    w, dw = w * math.sqrt(sigma), dw * math.sqrt(sigma)
    shape = stability.eigenfunction(scene, mode, 0, u_h + w)
    first, third = complex((shape * w).sum() * dw), complex((shape * w**3).sum() * dw)
    heat = third - 3 * sigma * first  # δq/ρ̄: the third moment about the wave's own velocity
    compression = -2j * k * sigma * first
    return -1j * k * heat / compression, -scene.cross_section * scene.initial.density * heat / compression


@pytest.mark.parametrize("mode", [1, 2, 4])
def test_of_the_eigenfunction(make_scene: MakeScene, mode: int) -> None:
    """-(1/ρ)∂q/∂x is -k*²/2 of the compression, -Sq is ik*R*/2 of it: together k*√(k*² + R*²)/2."""
    scene = make_scene(collisions=FOLLOW, initial={"density": 0.8, "modes": []})
    k = 2 * math.pi * mode / scene.pipe.length * math.sqrt(scene.model.noise) / scene.model.friction
    number = scene.groups.collision_number
    heat, collisions = ratios(scene, mode)
    assert heat == pytest.approx(-k * k / 2, rel=1e-9)
    assert collisions == pytest.approx(0.5j * k * number, rel=1e-9)
    assert abs(heat + collisions) == pytest.approx(k * math.hypot(k, number) / 2, rel=1e-9)


@pytest.mark.parametrize("mode", [1, 2])
def test_of_the_grid_solver(make_scene: MakeScene, mode: int) -> None:
    """Terms of `moment_equations` in a run from the eigenmode of 1e-4: what is quadratic is of that order. Compression and
    friction cancel, so that the temperature changes by what the closure drops alone."""
    scene = make_scene(
        collisions=FOLLOW,
        initial={"density": 0.8, "modes": [], "eigenmodes": [{"mode": mode, "cos": 1e-4}]},
        run={"end_time": 0.4},
        output={"f": False, "moment_equations": True},
        accuracy={"rtol": 1e-8},
    )
    scene = scene.model_copy(update={"model": scene.model.model_copy(update={"gravity": 1.7 * 0.8 * 0.5})})
    assert stability.mean_velocity(scene) == pytest.approx(0, abs=1e-15)  # advection is quadratic there
    last = solve(scene).isel(time=-1)
    k = 2 * math.pi * mode / scene.pipe.length * math.sqrt(scene.model.noise) / scene.model.friction

    def wave(*terms: str) -> complex:
        total = sum(last[f"temperature_rate{term}"].values for term in terms)
        return complex(np.fft.rfft(total)[mode])

    compression = wave("_compression")
    assert wave("_heat_flux") / compression == pytest.approx(-k * k / 2, rel=1e-3)
    assert wave("_collisions") / compression == pytest.approx(0.5j * k * scene.groups.collision_number, rel=1e-3)
    assert abs(wave("_compression", "_friction", "_noise")) < 1e-3 * abs(compression)
    assert wave("") == pytest.approx(wave("_heat_flux", "_collisions"), rel=1e-3)
