"""Particles drawn from starts other than one Maxwellian, in standard errors."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, exact, initial
from particles import Simulation, simulate
from particles.plan import make_plan

MakeScene = Callable[..., Scene]
BEAMS = [
    {"share": 0.35, "mean_velocity": -1.7, "temperature": 0.2},
    {"share": 0.65, "mean_velocity": 1.4, "temperature": 0.6},
]
PULSE = {"at": 0.9, "width": 0.06, "height": 2.5}


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_beams_and_a_pulse_against_the_closed_form(make_scene: MakeScene, seed: int) -> None:
    """At the start and later."""
    scene = make_scene(
        initial={"modes": [], "beams": BEAMS, "pulse": PULSE},
        run={"end_time": 0.6},
        particles={"count": 30_000, "replicas": 2, "seed": seed},
        output={"particles": True},
    )
    against_the_closed_form(simulate(scene), scene)


def against_the_closed_form(run: xr.Dataset, scene: Scene) -> None:
    """Counts in cells of v and of x at every frame, against the closed form: χ² of independent counts."""
    cells, finer, length = 40, 9, scene.pipe.length
    v = -5.0 + 11.0 / (cells * finer) * (np.arange(cells * finer) + 0.5)
    x = length / (cells * finer) * np.arange(cells * finer)
    truth = exact.solve(scene, x=x, v=v)
    number = run["position"].isel(time=0).size
    for frame in (0, 1):
        drawn, at = run["velocity"].values[frame].ravel(), run["position"].values[frame].ravel()
        # The first place of the closed form is the middle of the first cell.
        at = np.mod(at + length / (2 * cells * finer), length)
        for values, edges, density in (
            (drawn, np.linspace(-5, 6, cells + 1), truth["velocity_distribution"].values[frame] * 11.0),
            (at, np.linspace(0, length, cells + 1), truth["density"].values[frame] * length),
        ):
            expected = number * density.reshape(cells, finer).mean(axis=1) / cells / (0.8 * length)
            seen, counted = np.histogram(values, edges)[0], expected > 20
            z = (seen - expected)[counted] / np.sqrt(expected[counted])
            # 20 to 40 degrees of freedom: four standard deviations of χ².
            assert abs(np.mean(z**2) - 1) < 4 * np.sqrt(2 / counted.sum())


VARIED = {
    "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.4}],
    "mean_velocity": 0.6,
    "temperature": 0.4,
    "velocity_modes": [{"mode": 1, "sin": 0.9}],
    "temperature_modes": [{"mode": 2, "cos": 0.5}],
}
"""A start whose velocities depend on the place."""


def given(scene: Scene) -> tuple[Scene, initial.Given]:
    bare = Scene.model_validate(scene.model_dump(exclude={"initial"}, exclude_none=True))
    return bare, lambda x, v: initial.distribution(scene, x[:, 0], v[0])


@pytest.mark.parametrize("seed", [3, 4, 5])
@pytest.mark.parametrize("start", [VARIED, {"modes": [], "beams": BEAMS, "pulse": PULSE}], ids=["varied", "beams and pulse"])
@pytest.mark.parametrize("as_array", [False, True], ids=["callable", "DataArray"])
def test_from_an_f_of_ones_own(make_scene: MakeScene, start: dict[str, object], seed: int, as_array: bool) -> None:
    particles = {"count": 30_000, "replicas": 2, "seed": seed}
    scene = make_scene(initial=start, run={"end_time": 0.6}, particles=particles, output={"particles": True})
    bare, f = given(scene)
    if as_array:
        x, v = 9.0 / 50 * (np.arange(50) + 0.5), np.linspace(-6.0, 7.0, 150)
        f = xr.DataArray(f(x[:, None], v[None]), {"x": x, "v": v}, ("x", "v"))  # type: ignore[operator]
    against_the_closed_form(simulate(bare, initial=f), scene)


def test_moments_at_every_place(make_scene: MakeScene) -> None:
    """A million particles: the mean and the variance of v in each of 40 cells of x, to standard errors of 0.6 %."""
    scene = make_scene(initial=VARIED, particles={"count": 1_000_000, "replicas": 1})
    bare, f = given(scene)
    ((x, v),) = Simulation(make_plan(bare, own=f)).particles()
    cell = (x / 9.0 * 40).astype(int)
    counts = np.bincount(cell, minlength=40)
    u = initial.mean_velocity(scene, x, 0.6)
    theta = initial.temperature(scene, x, 0.4)
    z = (v - u) / np.sqrt(theta)
    for power, mean, variance in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0)):
        found = np.bincount(cell, z**power, minlength=40) / counts
        deviations = (found - mean) / np.sqrt(variance / counts)
        assert np.abs(deviations).max() < 4.2
        assert 0.5 < np.mean(deviations**2) < 1.7
    edges = 9.0 * np.arange(41) / 40
    expected = 1_000_000 * np.diff(initial.density_integral(scene, edges)) / (0.8 * 9.0)
    deviations = (counts - expected) / np.sqrt(expected)
    assert 0.5 < np.mean(deviations**2) < 1.7


def test_the_same_particles_for_any_number_of_threads(make_scene: MakeScene) -> None:
    bare, f = given(make_scene(initial=VARIED, particles={"count": 30_000, "replicas": 2}))
    plan, states = make_plan(bare, own=f), []
    before = numba.get_num_threads()
    for threads in (1, 2):
        numba.set_num_threads(threads)
        states.append(Simulation(plan).state())
    numba.set_num_threads(before)
    for name in ("x", "v"):
        assert np.array_equal(states[0][name], states[1][name])
    assert not np.array_equal(states[0]["x"][0], states[0]["x"][1])


def test_nobody_in_a_vacuum(make_scene: MakeScene) -> None:
    """f that is 0 over a part of the pipe."""
    bare, _ = given(make_scene(particles={"count": 20_000, "replicas": 1}, accuracy={"rtol": 1e-3}))

    def lump(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.maximum(0.0, np.cos(2 * np.pi * (x - 4.0) / 9.0)) ** 4 * np.exp(-((v - 1) ** 2) / 2)

    ((x, v),) = Simulation(make_plan(bare, own=lump)).particles()
    assert np.abs(x - 4.0).max() < 2.25
    assert np.var(v) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 20_000))


def test_collisions_see_the_waves_of_a_given_start(make_scene: MakeScene) -> None:
    """Cells and steps within a half and twice those of the same start from the scene."""
    follow = {"operator": "follow-the-leader", "cross_section": 0.6}
    for start in (VARIED, {"modes": [], "beams": BEAMS, "pulse": PULSE}):
        scene = make_scene(initial=start, collisions=follow, particles={"count": 100_000, "replicas": 1})
        bare, f = given(scene)
        ours, theirs = make_plan(bare, own=f), make_plan(scene)
        assert 0.4 < ours.cells / theirs.cells < 2.5
        assert 0.4 < ours.time_step / theirs.time_step < 2.5
