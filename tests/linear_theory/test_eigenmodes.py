"""Runs from an eigenmode: the grid solver's s(k) against the spectrum, which shares nothing with it; and what is refused."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError

from kinetic_solver import Scene, SceneError, exact, solve
from kinetic_solver.compare import measured_rates, mode_amplitudes
from kinetic_solver.stability import eigenfunction, homogeneous_distribution, kinetic_rates

GAMMA, SIGMA, RHO = 0.7, 0.5, 0.8
WEIGHT = {"follow-the-leader": {}, "inelastic": {"restitution": 0.5}}


def make(operator: str, number: float, mode: int, amplitude: float = 1e-6, **changes: Any) -> Scene:
    """A wave of k* = 0.25 n in one eigenmode, until it has decayed by exp(-4) or for a time of 10."""
    decay = GAMMA * (0.25 * mode) ** 2
    end = min(4 / decay, 10.0)
    data: dict[str, Any] = {
        "model": {"gravity": 1.3, "friction": GAMMA, "noise": SIGMA},
        "pipe": {"length": 8 * math.pi * math.sqrt(SIGMA) / GAMMA},
        "initial": {"density": RHO, "eigenmodes": [{"mode": mode, "cos": amplitude}]},
        "collisions": {"operator": operator, "cross_section": number * GAMMA / math.sqrt(SIGMA) / RHO, **WEIGHT[operator]},
        "run": {"end_time": end, "output_every": end / 40},
        "output": {"f": False, "budgets": False},
        "accuracy": {"rtol": 1e-8},
    }
    for key, value in changes.items():
        data[key] = {**data.get(key, {}), **value}
    return Scene.model_validate(data)


def deviation(measured: xr.Dataset) -> float:
    """|Δs| over the predicted |Re s|."""
    s = complex(measured["growth_rate"][0], measured["frequency"][0])
    return abs(s - complex(measured["kinetic_growth_rate"][0], measured["kinetic_frequency"][0])) / abs(
        float(measured["kinetic_growth_rate"][0])
    )


@pytest.mark.parametrize("number", [0.5, 1.347, 2.0, 4.0])
@pytest.mark.parametrize("mode", range(1, 9))
def test_follow_the_leader_to_1e_8(number: float, mode: int) -> None:
    measured = measured_rates(solve(make("follow-the-leader", number, mode)), mode)
    assert deviation(measured) <= 1e-8


@pytest.mark.parametrize(
    ("grid", "worst"),
    [
        ({"velocity": "hermite", "nv": 64}, 1e-8),
        ({"velocity": "hermite", "nv": 64, "stepping": "extrapolated"}, 1e-8),
        ({"stepping": "extrapolated"}, 1e-7),
    ],
    ids=["Hermite functions", "Hermite functions, collisions split off", "points, collisions split off"],
)
def test_every_path_has_the_same_rate(grid: dict[str, Any], worst: float) -> None:
    scene = make("follow-the-leader", 1.347, 3, grid=grid)
    assert deviation(measured_rates(solve(scene), 3)) <= worst


@pytest.mark.parametrize("mode", range(1, 5))
@pytest.mark.parametrize(("restitution", "number"), [(0.5, 1.0), (0.9, 1.0), (0.9, 10.0)])
def test_inelastic_to_1e_6(restitution: float, number: float, mode: int) -> None:
    """Hermite functions: few suffice, since no wave needs what is far out in v, of which the run warns."""
    scene = make(
        "inelastic",
        number,
        mode,
        1e-5,
        collisions={"restitution": restitution},
        accuracy={"rtol": 1e-7},
        grid={"velocity": "hermite", "nv": 24 if number == 1 else 40},
        run={"end_time": 3.0, "output_every": 0.1},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        measured = measured_rates(solve(scene), mode)
    assert deviation(measured) <= 1e-8


def test_inelastic_on_velocity_points() -> None:
    """The other representation, with collisions by quadrature: what rtol chooses of its own accord."""
    scene = make("inelastic", 1.0, 1, amplitude=1e-4, accuracy={"rtol": 1e-7}, run={"end_time": 2.0, "output_every": 0.1})
    assert deviation(measured_rates(solve(scene), 1)) <= 1e-6


@pytest.mark.parametrize("branch", [1, 2])
def test_faster_branches(branch: int) -> None:
    """They decay by nγ faster, and stay themselves until the slowest one, fed by rounding, takes over."""
    wave = {"eigenmodes": [{"mode": 2, "branch": branch, "cos": 1e-6}]}
    scene = make("follow-the-leader", 1.347, 2, initial=wave, run={"end_time": 1.0, "output_every": 0.5})
    run = solve(scene)
    s = kinetic_rates(scene, 2, 3)[0][branch]
    c = mode_amplitudes(run)[:, 2]
    assert np.abs(np.log(c[1:] / c[0]) / run["time"].values[1:] - s).max() <= 1e-8 * abs(s)


@pytest.mark.parametrize("operator", ["follow-the-leader", "inelastic"])
def test_f_keeps_the_shape_of_the_eigenfunction(operator: str) -> None:
    amplitude = 1e-3
    scene = make(
        operator, 1.0, 2, amplitude, output={"f": True}, run={"end_time": 1.0, "output_every": 1.0}, accuracy={"rtol": 1e-7}
    )
    run = solve(scene)
    v, x = run["v"].values, run["x"].values
    s = kinetic_rates(scene, 2)[0][0]
    k = 4 * math.pi / scene.pipe.length
    wave = np.exp(1j * k * x + s)[:, None] * eigenfunction(scene, 2, 0, v)
    expected = RHO * (homogeneous_distribution(scene, v) + amplitude * wave.real)
    # Quadratic terms, of amplitude², are left out of linear theory.
    assert np.abs(run["f"].values[-1] - expected).max() <= 10 * amplitude**2 * expected.max()


def test_gravity_only_moves_the_frame() -> None:
    """A frame that moves, and one at rest: the same amplitude; the phase goes with u_h."""
    runs = [solve(make("follow-the-leader", 1.0, 2, model={"gravity": g})) for g in (0.0, 60.0)]
    sizes = [np.abs(mode_amplitudes(run)[:, 2]) for run in runs]
    assert np.abs(sizes[0] / sizes[1] - 1).max() < 1e-8


@pytest.mark.parametrize(
    ("initial", "model", "message"),
    [
        ({"modes": [{"mode": 1, "cos": 0.1}]}, {}, "eigenmodes are given together with modes; allowed: with density alone"),
        ({"temperature": 1.0}, {}, "eigenmodes are given together with temperature"),
        ({}, {"noise": 0.0}, r"model.noise = 0 have none; allowed: both above 0"),
        ({"eigenmodes": [{"mode": 1, "cos": 1.5}]}, {}, "eigenmodes make the density negative"),
        ({"eigenmodes": [{"mode": 1, "branch": -1}]}, {}, "greater than or equal to 0"),
    ],
)
def test_scenes_that_are_refused(initial: dict[str, Any], model: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        make("follow-the-leader", 1.0, 1, initial=initial, model=model)


def test_starts_that_are_refused() -> None:
    large = make("follow-the-leader", 1.0, 1, amplitude=0.5)
    with pytest.raises(SceneError, match=r"initial.eigenmodes: amplitude 0.5 makes f negative; allowed here: 0\.\d+ or less"):
        solve(large)
    with pytest.raises(SceneError, match=r"branch = 0 of mode 32 is not resolved"):
        solve(make("inelastic", 0.1, 32, collisions={"restitution": 0.99}))
    with pytest.raises(SceneError, match=r"initial.eigenmodes: have no closed form"):
        exact.solve(make("follow-the-leader", 1.0, 1))


def test_a_scene_written_by_a_run_can_be_read() -> None:
    scene = make("follow-the-leader", 1.0, 1)
    assert Scene.model_validate_json(scene.model_dump_json(by_alias=True, exclude_none=True)) == scene
