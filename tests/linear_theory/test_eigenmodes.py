"""Runs from an eigenmode: the grid solver's s(k) against the spectrum, which shares nothing with it; and what is refused."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, solve
from kinetic_solver.analysis.certification import certify
from kinetic_solver.analysis.describe import describe
from kinetic_solver.analysis.measured_rates import measured_rates, mode_amplitudes
from kinetic_solver.initial import eigenmode_state, start_state
from kinetic_solver.plan import make_plan
from kinetic_solver.solver.representation import make_representation
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
    scene = make("follow-the-leader", 1.347, 3, grid=grid, run={"end_time": 4.0, "output_every": 0.25})
    assert deviation(measured_rates(solve(scene), 3)) <= worst


@pytest.mark.parametrize(
    ("restitution", "number", "modes"),
    [(0.5, 1.0, (1, 4)), (0.5, 2.0, (2, 3)), (0.9, 1.0, (2, 3)), (0.9, 4.0, (1, 4))],
)
def test_inelastic_to_1e_8(restitution: float, number: float, modes: tuple[int, int]) -> None:
    """Hermite functions, as many as rtol asks for; two waves a run, of which neither is a product of the others."""
    scene = make(
        "inelastic",
        number,
        modes[0],
        initial={"eigenmodes": [{"mode": mode, "cos": 1e-4} for mode in modes]},
        collisions={"restitution": restitution},
        accuracy={"rtol": 5e-9},  # of max f, of which the waves are 1e-4
        grid={"velocity": "hermite"},
        run={"end_time": 3.0, "output_every": 0.5},
    )
    measured = measured_rates(solve(scene), modes)
    for mode in modes:
        assert deviation(measured.sel(mode=[mode])) <= 1e-8


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


def test_without_collisions() -> None:
    """Waves do not couple then: the rate is that of a wave of any amplitude."""
    scene = make("follow-the-leader", 0.0, 3, amplitude=0.4)
    assert deviation(measured_rates(solve(scene), 3)) <= 1e-8


@pytest.mark.parametrize("velocity", ["points", "hermite"])
def test_before_the_kernel_is_resolved(velocity: str) -> None:
    """Frames before the first exact step that the velocity points resolve are made on denser ones, from the eigenmode there."""
    scene = make(
        "follow-the-leader", 2.0, 4, 1e-6, run={"end_time": 0.8, "output_every": 0.02}, grid={"nv": 70, "velocity": velocity}
    )
    plan = make_plan(scene)
    assert velocity == "hermite" or plan.shortest_step > 2 * plan.times[1]
    assert deviation(measured_rates(solve(scene), 4)) <= 1e-8


@pytest.mark.parametrize(("operator", "error"), [("follow-the-leader", 1e-12), ("inelastic", 1e-8)])
def test_the_start_in_hermite_functions_is_that_on_points(operator: str, error: float) -> None:
    """Coefficients of the point values, which for (12) are known to a rounding error that grows in the tails; and the density is
    that of `modes`, sines included."""
    waves = [{"mode": 1, "cos": 0.01, "sin": 0.02}, {"mode": 3, "branch": 1, "sin": -0.003}]
    scene = make(operator, 1.0, 1, initial={"eigenmodes": waves}, grid={"velocity": "hermite", "nv": 140})
    plan = make_plan(scene)
    representation = make_representation(plan)
    state = representation.start()
    f = eigenmode_state(plan.inner, plan.grid.x, plan.grid.v, start_state(plan.inner)[0])
    assert np.abs(representation.points(state) - f).max() <= error * f.max()
    phase = 2 * math.pi * plan.grid.x / scene.pipe.length
    density = RHO * (1 + 0.01 * np.cos(phase) + 0.02 * np.sin(phase) - 0.003 * np.sin(3 * phase))
    assert np.abs(state[:, 0] - density).max() <= error


@pytest.mark.parametrize(
    ("operator", "number", "branch", "amplitude"),
    [("follow-the-leader", 0.5, 0, 9e-3), ("follow-the-leader", 4.0, 2, 9e-4), ("inelastic", 1.0, 1, 0.1)],
)
def test_rtol_chooses_a_grid_for_short_waves(operator: str, number: float, branch: int, amplitude: float) -> None:
    """At k* = 3, nearly as high as f ≥ 0 allows, f has stripes in v from the start, far narrower than its width."""
    scene = make(
        operator,
        number,
        12,
        initial={"eigenmodes": [{"mode": 12, "branch": branch, "sin": amplitude}]},
        accuracy={"rtol": 1e-3},
        run={"end_time": 0.8, "output_every": 0.4},
        output={"f": True, "moments": False},
    )
    run = solve(scene)
    assert ";" not in run.attrs["grids"]
    assert float(certify(scene, run)["certified_error"].max()) <= 1e-3


def test_a_wave_below_rtol_is_not_taken_for_another() -> None:
    run = solve(make("follow-the-leader", 2.0, 8, 1e-6, accuracy={"rtol": 1e-4}, run={"end_time": 0.3, "output_every": 0.1}))
    size = np.abs(mode_amplitudes(run))
    s = kinetic_rates(make("follow-the-leader", 2.0, 8), 8)[0][0]
    assert np.allclose(size[:, 8], 0.5e-6 * np.exp(s.real * run["time"].values), rtol=1e-3)
    assert size[:, 1:8].max() < 1e-9


@pytest.mark.parametrize("gravity", [1.3, 60.0])
def test_gravity_only_moves_the_frame(gravity: float) -> None:
    """In a frame that moves, and in one at rest, as a given nv asks for: the complex amplitude of a wave that gravity carries."""
    short = {"end_time": 0.3, "output_every": 0.05}
    scenes = [
        make("follow-the-leader", 8.0, 4, model={"gravity": gravity}, run=short, accuracy={"rtol": 1e-7}, grid=grid)
        for grid in ({}, {"nv": 100})
    ]
    assert [make_plan(scene).reference_frame.moving for scene in scenes] == [True, False]
    s = kinetic_rates(scenes[0], 4)[0][0]
    for scene in scenes:
        run = solve(scene)
        expected = 0.5e-6 * np.exp(s * run["time"].values)
        assert np.abs(mode_amplitudes(run)[:, 4] / expected - 1).max() < 1e-7


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
    with pytest.raises(SceneError, match=message):
        make("follow-the-leader", 1.0, 1, initial=initial, model=model)


def test_starts_that_are_refused() -> None:
    large = make("follow-the-leader", 1.0, 1, amplitude=0.5)
    with pytest.raises(SceneError, match=r"initial.eigenmodes: amplitude 0.5 makes f negative; allowed here: 0\.\d+ or less"):
        describe(large)
    with pytest.raises(SceneError, match=r"branch = 0 of mode 32 is not resolved"):
        make_plan(make("inelastic", 0.1, 32, collisions={"restitution": 0.99}))
    with pytest.raises(SceneError, match=r"mode = 50 is too short a wave, k√θ/γ = 12.5; allowed: 12 or less"):
        make_plan(make("follow-the-leader", 1.0, 50))
    with pytest.raises(SceneError, match=r"initial.eigenmodes: have no closed form"):
        exact.solve(make("follow-the-leader", 1.0, 1))


@pytest.mark.parametrize("modes", [(1,), (2, 6)])
def test_the_amplitude_that_is_allowed_is_the_largest(modes: tuple[int, ...]) -> None:
    def start(share: float) -> Scene:
        return make("follow-the-leader", 1.347, 1, initial={"eigenmodes": [{"mode": n, "cos": share / n} for n in modes]})

    with pytest.raises(SceneError, match="allowed here") as refused:
        make_plan(start(0.7))
    allowed = float(re.search(r"allowed here: ([0-9.e-]+)", str(refused.value)).group(1)) * modes[0]
    plan = make_plan(start(allowed))
    f = make_representation(plan).start()
    assert f.min() >= -1e-12 * f.max()
    with pytest.raises(SceneError, match="makes f negative"):
        make_plan(start(1.02 * allowed))


def test_describe_names_the_wave() -> None:
    rows = dict(describe(make("inelastic", 1.0, 2, 1e-3)))["Start"]
    s = kinetic_rates(make("inelastic", 1.0, 2), 2)[0][0]
    assert rows == [("eigenmode 2, branch 0", f"relative density 0.001, s = {s:.6g}")]


def test_a_scene_written_by_a_run_can_be_read() -> None:
    scene = make("follow-the-leader", 1.0, 1)
    assert Scene.model_validate_json(scene.model_dump_json(by_alias=True, exclude_none=True)) == scene


def test_a_faster_branch_is_measured_as_itself() -> None:
    wave = {"eigenmodes": [{"mode": 2, "branch": 1, "cos": 1e-3}]}
    scene = make("follow-the-leader", 1.347, 2, initial=wave, run={"end_time": 12.0, "output_every": 0.1})
    measured = measured_rates(solve(scene), [1, 2])
    assert list(measured["branch"].values) == [0, 1]
    second = measured.sel(mode=2)
    s = complex(second["growth_rate"], second["frequency"])
    expected = kinetic_rates(scene, 2, 2)[0][1]
    assert complex(second["kinetic_growth_rate"], second["kinetic_frequency"]) == expected
    assert abs(s - expected) < 1e-3 * abs(expected.real)
