"""What waves do in runs of the closure and of M moments, against the cubic and the spectrum of M moments, on both sides of
ρ_c."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import hydrodynamics
from kinetic_solver.hydrodynamics.spectral import SpectralRun
from kinetic_solver.scene import INELASTIC, Scene
from kinetic_solver.stability import closure_rates, critical_density
from kinetic_solver.stability.closure import closure_generator, closure_temperature

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
RESTING = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}
AMPLITUDE = 1e-5
"""Relative, of the density: what it drives nonlinearly is 1e-10 of itself."""


def eigenvector(scene: Scene, mode: int) -> tuple[complex, np.ndarray]:
    """(s, (δρ/ρ̄, δu, δθ/θ)) of the wave that grows fastest: (3)-(5) linearised as printed, by a matrix and not by the cubic."""
    g, gamma, sigma, s = scene.model.gravity, scene.model.friction, scene.model.noise, scene.cross_section
    rho, k = scene.initial.density, 2 * math.pi * mode / scene.pipe.length
    if scene.operator == INELASTIC:
        c = s * (1 - scene.restitution**2) / math.sqrt(math.pi)
        theta = closure_temperature(gamma, sigma, c * rho)
        u, drag = g / gamma, 0.0
    else:
        theta, c, drag = sigma, 0.0, s
        u = (g - s * rho * sigma) / gamma
    rates = np.array(
        [
            [-1j * k * u, -1j * k * rho, 0],
            [-1j * k * theta / rho - drag * theta, -1j * k * u - gamma, -1j * k - drag * rho],
            [-2 * c * theta**1.5, -2j * k * theta, -1j * k * u - 2 * gamma - 3 * c * rho * math.sqrt(theta)],
        ]
    )
    values, vectors = np.linalg.eig(rates)
    fastest = int(values.real.argmax())
    vector = vectors[:, fastest] / vectors[0, fastest]
    return values[fastest], np.array([1.0, rho * vector[1], rho * vector[2] / theta])


def started(scene: Scene, mode: int, points: int) -> tuple[Scene, complex]:
    """The scene with its mode's fastest wave, on so many points a wavelength, in steps a fifth of those that would be stable."""
    s, (_, u, theta) = eigenvector(scene, mode)

    def wave(z: complex) -> list[dict[str, Any]]:
        return [{"mode": mode, "cos": AMPLITUDE * z.real, "sin": -AMPLITUDE * z.imag}]

    data = scene.model_dump(by_alias=True, exclude_none=True)
    state = {"density": scene.initial.density, "modes": wave(1.0), "velocity_modes": wave(u), "temperature_modes": wave(theta)}
    if scene.operator == INELASTIC:
        c = scene.cross_section * (1 - scene.restitution**2) / math.sqrt(math.pi) * scene.initial.density
        state["temperature"] = closure_temperature(scene.model.friction, scene.model.noise, c)
    nx = points * mode + 1
    data |= {"initial": state, "grid": {"nx": nx, "time_step": 0.1 * scene.pipe.length / nx}}
    return Scene.model_validate(data), s


def measured(run: Any, mode: int, guess: complex) -> complex:
    """s between the first frame and the last; the guess tells how often the wave went round."""
    c = np.fft.rfft(run["density"].values, axis=1)[:, mode]
    x, time = run["x"].values, float(run["time"][-1])
    assert x[0] == 0
    return guess + complex(np.log(c[-1] / c[0] * np.exp(-guess * time))) / time


@pytest.mark.parametrize("mode", [1, 2, 5, 8])
@pytest.mark.parametrize(("factor", "sign"), [(0.9, -1), (1.1, 1)])
def test_the_closure_follows_the_cubic_on_both_sides_of_its_critical_density(
    make_scene: MakeScene, mode: int, factor: float, sign: int
) -> None:
    """|Δs| ≤ 1e-6 |Re s|, though Re s is a few per cent of the frequency."""
    density = factor * critical_density(make_scene(collisions=FOLLOW), mode)
    scene, s = started(make_scene(collisions=FOLLOW, initial={"density": density}, run={"end_time": 0.3}), mode, 160)
    assert s == pytest.approx(closure_rates(scene, mode)[0], rel=1e-12)
    found = measured(hydrodynamics.solve(scene), mode, s)
    assert abs(found - s) < 1e-6 * abs(s.real)
    assert np.sign(found.real) == sign == np.sign(s.real)


@pytest.mark.parametrize("number", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("mode", [1, 4])
def test_operator_12_decays_as_its_cubic_says(make_scene: MakeScene, number: float, mode: int) -> None:
    density = number * 0.7 / math.sqrt(0.5) / 2.3
    scene, s = started(make_scene(collisions=RESTING, initial={"density": density}, run={"end_time": 0.3}), mode, 160)
    assert np.abs(closure_rates(scene, mode) - s).min() < 1e-9 * abs(s)
    assert s.real < 0
    assert abs(measured(hydrodynamics.solve(scene), mode, s) - s) < 1e-6 * abs(s.real)


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
        k, u_h = 2 * math.pi * mode / 9.0, (1.3 - 1.7 * density * 0.5) / 0.7
        values, vectors = np.linalg.eig(
            closure_generator(k * math.sqrt(0.5) / 0.7, 1.7 * density * math.sqrt(0.5) / 0.7, moments)
        )
        fastest = int(values.real.argmax())
        s = 0.7 * values[fastest] - 1j * k * u_h
        plan = hydrodynamics.make_plan(scene)
        run = SpectralRun(plan)
        run.state[:] = 0
        run.state[mode] = AMPLITUDE * density * vectors[:, fastest] / vectors[0, fastest]
        frames, _ = run.frames()
        c = np.fft.rfft(frames.fields[:, 0], axis=1)[:, mode]
        found = s + complex(np.log(c[-1] / c[0] * np.exp(-s * 0.7))) / 0.7
        assert abs(found - s) < 1e-6 * abs(s.real)
        assert np.sign(found.real) == sign
