"""M Hermite moments: against an independent discretisation and the closed form, order in time, rtol, blow-up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import exact, hydrodynamics
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.hierarchy import Hierarchy
from kinetic_solver.hydrodynamics.spectral import SpectralRun
from kinetic_solver.scene import Scene
from kinetic_solver.stability import truncated_run

MakeScene = Callable[..., Scene]
START = {
    "mean_velocity": 0.9,
    "temperature": 0.4,
    "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}],
    "velocity_modes": [{"mode": 1, "sin": 0.1}],
    "temperature_modes": [{"mode": 2, "cos": 0.1}],
}


def scene_of(make_scene: MakeScene, number: float, moments: int, rtol: float = 1e-6, **changes: Any) -> Scene:
    """At R* = `number`."""
    return make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": number * 0.7 / np.sqrt(0.5) / 0.8},
        hydrodynamics={"moments": moments},
        accuracy={"rtol": rtol},
        **{"initial": START, **changes},
    )


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("moments", [3, 6, 11])
def test_rtol_is_met(make_scene: MakeScene, moments: int, rtol: float) -> None:
    """In the maximum norm, against Fourier transforms and DOP853 on all moments at once."""
    scene = scene_of(make_scene, 1.1, moments, rtol)
    run, twin = hydrodynamics.solve(scene), truncated_run(scene, moments, 64, 1e-12)
    fourfold = slice(None, None, run.sizes["x"] // 64)
    for name in ("density", "mean_velocity", "temperature"):
        truth = twin[name].values
        assert np.abs(run[name].values[:, fourfold] - truth).max() < rtol * np.abs(truth).max()
    assert np.abs(run["mass"] / (0.8 * 9.0) - 1).max() < 1e-13


def test_steps_are_of_order_five(make_scene: MakeScene) -> None:
    scene = scene_of(make_scene, 1.1, 6, grid={"nx": 33})
    run = SpectralRun(hydrodynamics.make_plan(scene))
    start = run.state

    def end(count: int) -> np.ndarray:
        run.state = start
        for _ in range(count):
            run.state, _ = run._attempt(1.2 / count)
        return run.state

    truth = end(48)
    errors = [np.abs(end(count) - truth).max() for count in (3, 6, 12)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ((orders > 4.5) & (orders < 5.7)).all(), (orders, errors)


@pytest.mark.parametrize(("number", "best"), [(0.5, 1e-9), (1.2, 1e-9), (2.0, 1e-9)])
def test_many_moments_become_the_kinetic_equation(make_scene: MakeScene, number: float, best: float) -> None:
    """The density's error against the closed form falls exponentially with M."""
    errors = []
    for moments in (6, 12, 24, 32):
        scene = scene_of(make_scene, number, moments, 1e-9)
        run = hydrodynamics.solve(scene)
        truth = exact.Solution(scene, 1.5).moments(run["x"].values[::4])
        errors.append(float(np.abs(run["density"].values[-1, ::4] - truth[0]).max() / truth[0].max()))
    assert errors[0] > 20 * errors[1] > 400 * errors[2]
    assert errors[3] < best
    assert np.abs(run["heat_flux"].values[-1, ::4] - truth[3]).max() < 1e-6


def test_three_moments_are_not_the_closure(make_scene: MakeScene) -> None:
    """They agree to first order in the waves: their difference is of second."""
    apart = []
    for size in (0.02, 0.01, 0.005):
        start = {"modes": [{"mode": 1, "cos": size}], "velocity_modes": [{"mode": 1, "sin": size}]}
        runs = [
            hydrodynamics.solve(scene_of(make_scene, 0.9, 3, 1e-8, initial=start).model_copy(update=changes))
            for changes in ({}, {"hydrodynamics": make_scene().hydrodynamics})
        ]
        apart.append(float(np.abs(runs[0]["density"][-1] - runs[1]["density"][-1]).max()))
    orders = np.log2(np.array(apart[:-1]) / apart[1:])
    assert ((orders > 1.8) & (orders < 2.2)).all(), (orders, apart)
    assert apart[0] > 1e-6


def test_the_heat_flux_is_the_third_central_moment(make_scene: MakeScene) -> None:
    """Of f as its Hermite functions say, summed over v; energy and momentum are the sums of the fields."""
    scene = scene_of(make_scene, 0.8, 5)
    hierarchy = Hierarchy(scene, 5)
    state = SpectralRun(hydrodynamics.make_plan(scene)).state
    rng = np.random.default_rng(2)
    state = state + 0.01 * (rng.random(state.shape) + 1j * rng.random(state.shape)) * (np.arange(state.shape[0]) < 3)[:, None]
    state[0] = state[0].real
    rho, u, theta, heat = hierarchy.fields(state, 33)
    w = np.linspace(-12, 12, 2001)
    a = np.fft.irfft(state, n=33, axis=0, norm="forward")
    a[:, 0] += 0.8
    functions = np.array([np.polynomial.hermite_e.hermeval(w, np.eye(5)[n]) for n in range(5)])
    f = (a / np.sqrt([1, 1, 2, 6, 24])) @ functions * np.exp(-(w**2) / 2) / np.sqrt(2 * np.pi)
    v, dw = hierarchy.mean_velocity + np.sqrt(0.5) * w, w[1] - w[0]
    assert np.allclose(rho, f.sum(axis=1) * dw, rtol=1e-12)
    assert np.allclose(rho * u, f @ v * dw, rtol=1e-11)
    assert np.allclose(rho * theta, [(f[i] * (v - u[i]) ** 2).sum() * dw for i in range(33)], rtol=1e-11)
    assert np.allclose(heat, [(f[i] * (v - u[i]) ** 3).sum() * dw for i in range(33)], atol=1e-12)
    totals = hierarchy.totals(state)
    assert np.allclose(totals, 9.0 * np.array([rho.mean(), (rho * u).mean(), 0.5 * (rho * (u**2 + theta)).mean()]), rtol=1e-12)


def test_growth_beyond_what_can_be_resolved_stops_with_one_line(make_scene: MakeScene) -> None:
    """M = 4 above its critical density: waves steepen, and more of them are taken until there are too many."""
    scene = scene_of(make_scene, 2.6, 4, 1e-3, run={"end_time": 60.0, "output_every": 2.0})
    with pytest.raises(SolverStopped, match="the hierarchy of 4 moments grows beyond what") as stop:
        hydrodynamics.solve(scene)
    assert "\n" not in str(stop.value)
    run = stop.value.dataset
    assert 1 <= run.sizes["time"] < 31
    assert np.isfinite(run["density"]).all()
    calm = hydrodynamics.solve(scene_of(make_scene, 2.6, 24, 1e-3, run={"end_time": 60.0}))
    assert float(np.ptp(calm["density"].values[-1])) < 1e-3


def test_given_waves_and_steps_are_kept(make_scene: MakeScene) -> None:
    run = hydrodynamics.solve(scene_of(make_scene, 0.6, 5, grid={"nx": 25, "time_step": 0.2}))
    assert run.sizes["x"] == 25
    assert run.attrs["waves"] == "12"
    finer = hydrodynamics.solve(scene_of(make_scene, 0.6, 5))
    assert np.abs(run["density"].values[-1, 0] - finer["density"].values[-1, 0]) < 1e-5


def test_without_collisions_the_hierarchy_is_one_exact_step(make_scene: MakeScene) -> None:
    scene = make_scene(initial=START, hydrodynamics={"moments": 40}, run={"end_time": 1.5}, accuracy={"rtol": 1e-9})
    run = hydrodynamics.solve(scene)
    truth = exact.Solution(scene, 1.5).moments(run["x"].values)[0]
    assert np.abs(run["density"].values[-1] - truth).max() < 1e-9
