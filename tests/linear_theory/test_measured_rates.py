"""Growth rates measured in a run: as uncertain as they say, from every kind of run and start."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, solve
from kinetic_solver.analysis.measured_rates import measured_lines, measured_rates, mode_amplitudes
from kinetic_solver.stability import kinetic_rates, structure_factor

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.4}


def deviation(measured: xr.Dataset) -> np.ndarray:
    s = measured["growth_rate"].values + 1j * measured["frequency"].values
    return np.abs(s - (measured["kinetic_growth_rate"].values + 1j * measured["kinetic_frequency"].values))


@pytest.mark.parametrize("collisions", [None, FOLLOW, INELASTIC], ids=["none", "(6)", "(12)"])
@pytest.mark.parametrize(
    "start",
    [
        {"modes": [{"mode": 1, "cos": 1e-4}, {"mode": 2, "sin": 1e-4}]},
        {"modes": [], "velocity_modes": [{"mode": 1, "cos": 1e-4}], "temperature_modes": [{"mode": 2, "sin": 1e-4}]},
    ],
    ids=["density", "velocity and temperature"],
)
def test_within_its_uncertainty(make_scene: MakeScene, collisions: dict[str, Any] | None, start: dict[str, Any]) -> None:
    """Runs perturbed as in (10): density, velocity, temperature."""
    few = {"velocity": "hermite", "nv": 24, "nx": 9} if collisions is INELASTIC else {}
    scene = make_scene(
        collisions=collisions,
        pipe={"length": 17.0},
        initial=start,
        grid=few,
        run={"end_time": 25.0, "output_every": 0.5},
        output={"f": False, "budgets": False},
        accuracy={"rtol": 1e-6},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # far out in v 24 functions miss rtol; no mode needs what is there
        measured = measured_rates(solve(scene), [1, 2])
    assert (deviation(measured) <= measured["uncertainty"].values).all()
    assert (measured["uncertainty"].values <= [1e-3, 1e-2] * np.abs(measured["kinetic_growth_rate"].values)).all()


def test_particles_noise(make_scene: MakeScene) -> None:
    """A decaying wave in noise of theory's variance and correlation time, 200 ensembles: errors are what is said of them."""
    start = {"density": 0.8, "modes": [{"mode": 1, "cos": 0.2}]}
    scene = make_scene(
        collisions=FOLLOW, pipe={"length": 17.0}, initial=start, run={"end_time": 12.0}, particles={"count": 10**6}
    )
    s = kinetic_rates(scene, 1)[0][0]
    spread = math.sqrt(float(structure_factor(scene, 1)[0]) / 1e6)
    t, x = np.arange(0, 12.01, 0.1), np.arange(16) * 17.0 / 16
    generator, step = np.random.default_rng(5), np.exp(s * 0.1)
    pulls = []
    for _ in range(200):
        kicks = generator.normal(size=(t.size, 2)) @ [1, 1j] * spread / math.sqrt(2)
        noise = np.empty(t.size, dtype=complex)
        noise[0] = kicks[0]
        for n in range(1, t.size):
            noise[n] = step * noise[n - 1] + math.sqrt(1 - abs(step) ** 2) * kicks[n]
        wave = 0.1 * np.exp(s * t) + noise
        density = 0.8 * (1 + 2 * (wave[:, None] * np.exp(2j * np.pi * x / 17.0)).real)
        run = xr.Dataset({"density": (("time", "x"), density)}, {"time": t, "x": x})
        run.attrs = {"method": "particles", "scene": scene.model_dump_json(by_alias=True, exclude_none=True)}
        measured = measured_rates(run, 1)
        pulls.append(deviation(measured)[0] / float(measured["uncertainty"][0]))
    # |Δs| of a complex normal error is below its standard deviation with probability 1 - 1/e, and below 3 of them almost always.
    assert np.mean(np.array(pulls) < 1) > 0.63
    assert np.mean(np.array(pulls) < 3) > 0.99


def test_amplitudes(make_scene: MakeScene) -> None:
    run = solve(make_scene(run={"end_time": 0.1}))
    c = mode_amplitudes(run)[0]
    assert np.abs(c[:3] - [1, 0.2, -0.1j]).max() < 1e-12


def test_not_measurable(make_scene: MakeScene) -> None:
    """Beyond the grid, at rounding, or with too few frames: NaN, and the table says so."""
    start = {"modes": [{"mode": 1, "cos": 1e-5}]}
    scene = make_scene(collisions=FOLLOW, grid={"nx": 9}, run={"end_time": 2.0, "output_every": 0.2}, initial=start)
    measured = measured_rates(solve(scene), [1, 3, 7])
    assert np.isnan(measured["growth_rate"].values[1:]).all()
    assert "not measurable" in measured_lines(measured)[-1]
    few = solve(make_scene(collisions=FOLLOW, run={"end_time": 0.2}))
    assert np.isnan(measured_rates(few, 1)["growth_rate"].values).all()


def test_refusals(make_scene: MakeScene) -> None:
    homogeneous = solve(make_scene(initial={"modes": []}))
    with pytest.raises(SceneError, match=r"no density over x"):
        measured_rates(homogeneous)
    with pytest.raises(SceneError, match=r"no scene"):
        measured_rates(xr.Dataset({"density": (("time", "x"), np.ones((2, 4)))}))
