"""The grid solver as a whole: conservation, budgets, moment equations, and that a scene pays only for what it holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, exact, solve
from kinetic_solver.plan import make_plan
from kinetic_solver.solver import integrate

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
INELASTIC = {"operator": "inelastic", "cross_section": 1.2, "restitution": 0.4}
OPERATORS = [FOLLOW, INELASTIC, None]


@pytest.mark.parametrize(
    "scheme",
    [
        {},
        {"drift_diffusion": "finite-volume-8"},
        {"stepping": "strang", "drift_diffusion": "finite-volume"},
        {"stepping": "extrapolated"},
        {"velocity": "hermite"},
        {"velocity": "hermite", "stepping": "extrapolated"},
    ],
    ids=str,
)
@pytest.mark.parametrize("operator", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_mass_over_ten_thousand_steps(make_scene: MakeScene, operator: dict[str, Any], scheme: dict[str, str]) -> None:
    scene = make_scene(
        collisions=operator,
        run={"end_time": 1000.0, "output_every": 250.0},
        grid={"nx": 9, "nv": 32, "velocity_window": (-6.0, 8.0), "time_step": 0.1, **scheme},
        accuracy={"rtol": 1e-1},
        output={"f": False, "budgets": False},
    )
    assert make_plan(scene).expected_steps == 10_000
    mass = solve(scene)["mass"].values
    assert mass.size == 5
    assert np.abs(mass / mass[0] - 1).max() < 1e-12


@pytest.mark.parametrize("operator", OPERATORS)
def test_totals_obey_their_equations_and_the_budgets_close(make_scene: MakeScene, operator: dict[str, Any] | None) -> None:
    """dp/dt = gN - γp and dE/dt = gp - 2γE + σγN, plus what collisions take."""
    scene = make_scene(
        collisions=operator,
        initial={"mean_velocity": -0.5, "temperature": 0.7, "velocity_modes": [{"mode": 1, "sin": 0.4}]},
        run={"end_time": 1.5, "output_every": 0.05},
        output={"f": False, "budgets": True},
    )
    run = solve(scene)
    for name in ("mass", "momentum", "energy"):
        assert float(abs(run[f"{name}_residual"]).max()) < 1e-5 * float(abs(run["energy"]).max()), name
    g, gamma, sigma = 1.3, 0.7, 0.5
    assert run["momentum_rate_gravity"].values == pytest.approx(g * run["mass"].values)
    assert run["momentum_rate_friction"].values == pytest.approx(-gamma * run["momentum"].values)
    assert run["energy_rate_gravity"].values == pytest.approx(g * run["momentum"].values)
    assert run["energy_rate_friction"].values == pytest.approx(-2 * gamma * run["energy"].values)
    assert run["energy_rate_noise"].values == pytest.approx(gamma * sigma * run["mass"].values)
    # The rates, integrated over time by Simpson's rule, are the changes: neither was computed from the other.
    for name in ("momentum", "energy"):
        rate = sum(run[v].values for v in run.data_vars if str(v).startswith(f"{name}_rate"))
        change = float(run[name][-1] - run[name][0])
        simpson = 0.05 / 3 * (rate[0] + rate[-1] + 4 * rate[1:-1:2].sum() + 2 * rate[2:-1:2].sum())
        assert simpson == pytest.approx(change, abs=1e-4)
    if operator is INELASTIC:
        assert float(abs(run["momentum_from_collisions"]).max()) < 1e-12
        n, p0 = float(run["mass"][0]), float(run["momentum"][0])
        decay = np.exp(-gamma * run["time"].values)
        assert run["momentum"].values == pytest.approx(p0 * decay + g * n / gamma * (1 - decay), abs=1e-5)
        assert np.all(run["energy_rate_collisions"].values < 0)
    if operator is None:
        assert not run["energy_from_collisions"].values.any()


@pytest.mark.parametrize("operator", OPERATORS)
def test_moment_equations_close_with_the_heat_flux_and_not_without(
    make_scene: MakeScene, operator: dict[str, Any] | None
) -> None:
    scene = make_scene(
        collisions=operator, run={"end_time": 1.0}, output={"f": False, "moment_equations": True}, accuracy={"rtol": 1e-7},
        grid={"nx": 63, "nv": 128, "velocity_window": (-7.0, 8.0), "time_step": 0.05},
    )  # fmt: skip
    final = solve(scene).isel(time=-1)
    for field in ("density", "mean_velocity", "temperature"):
        residual = float(abs(final[f"{field}_rate_residual"]).max())
        assert residual < 1e-9, field
        assert residual < 1e-8 * float(abs(final[f"{field}_rate"]).max()), field
    neglected = float(abs(final["temperature_rate_heat_flux"]).max())
    assert neglected > 0.1 * float(abs(final["temperature_rate"]).max())


def test_moment_equations_give_the_true_time_derivatives(make_scene: MakeScene) -> None:
    """The rates of (3)-(5) against differences in time of the closed form's moments."""
    scene = make_scene(
        collisions=FOLLOW, run={"end_time": 1.0}, output={"moment_equations": True},
        grid={"nx": 45, "nv": 256, "velocity_window": (-7.0, 8.0), "time_step": 0.02},
    )  # fmt: skip
    final = solve(scene).isel(time=-1)
    h = 1e-3
    before, after = (exact.Solution(scene, 1.0 + shift).moments(final["x"].values) for shift in (-h, h))
    for name, early, late in zip(("density", "mean_velocity", "temperature"), before, after, strict=False):
        slope = (late - early) / (2 * h)
        assert final[f"{name}_rate"].values == pytest.approx(slope, abs=2e-4 * np.abs(slope).max())


def test_without_collisions_each_frame_is_one_exact_step(make_scene: MakeScene) -> None:
    steps = []
    scene = make_scene(run={"end_time": 6.0, "output_every": 2.0}, accuracy={"rtol": 1e-10})
    run = solve(scene, progress=lambda time, end: steps.append((time, end)))
    assert steps == [(2.0, 6.0), (4.0, 6.0), (6.0, 6.0)]
    truth = exact.solve(scene, x=run["x"], v=run["v"])
    assert float(abs(run["f"] - truth["f"]).max()) < 1e-10 * float(truth["f"].max())
    for name in ("density", "mean_velocity", "temperature", "heat_flux"):
        assert run[name].values == pytest.approx(truth[name].values, abs=1e-8), name


@pytest.mark.parametrize("operator", [FOLLOW, INELASTIC])
def test_a_homogeneous_scene_has_one_x_and_the_extended_one_agrees(make_scene: MakeScene, operator: dict[str, Any]) -> None:
    changes = {"collisions": operator, "initial": {"modes": [], "temperature": 0.2}, "output": {"budgets": False}}
    # A homogeneous run with (12) would choose another method than an extended one.
    stepping = {"stepping": "extrapolated"} if operator is INELASTIC else {}
    one = solve(make_scene(**changes, grid=stepping))
    assert one.sizes["x"] == 1
    many = solve(make_scene(**changes, grid={"nx": 9, **stepping}))
    assert many.sizes["x"] == 9
    assert np.abs(many["f"].values - one["f"].values).max() < 1e-13 * float(one["f"].max())


def test_nothing_is_computed_that_is_not_asked_for(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("computed without need")

    for name in ("writer.moment_equations", "writer.moments", "loop.Ledger"):
        monkeypatch.setattr(f"kinetic_solver.solver.{name}", refuse)
    quiet = {"moments": False, "budgets": False}
    run = solve(make_scene(collisions=INELASTIC, run={"end_time": 0.2}, output=quiet))
    assert set(run.data_vars) >= {"f", "mass"}
    assert "density" not in run


def test_two_runs_give_the_same_bits(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, output={"budgets": False})
    first, second = solve(scene), solve(scene)
    assert np.array_equal(first["f"], second["f"])
    # What is written beside f does not change f.
    talkative = scene.model_copy(update={"output": type(scene.output)(budgets=False, moment_equations=True)})
    assert np.array_equal(solve(talkative)["f"], first["f"])


def test_positive_where_transport_allows_it(make_scene: MakeScene) -> None:
    """Homogeneous: every substep is positive, so f is, from two cold beams at a rough tolerance."""
    scene = make_scene(
        collisions=INELASTIC, initial={"modes": [], "temperature": 0.02}, grid={"deposit": "linear"}, accuracy={"rtol": 1e-2}
    )
    run = solve(scene)
    assert float(run["f"].min()) >= 0
    assert float(run["minimum_of_f"].min()) >= 0


@pytest.mark.parametrize("operator", [FOLLOW, INELASTIC])
def test_minimum_of_f_stays_above_minus_rtol(make_scene: MakeScene, operator: dict[str, Any]) -> None:
    for rtol in (1e-2, 1e-4):
        run = solve(make_scene(collisions=operator, accuracy={"rtol": rtol}, run={"end_time": 1.5, "output_every": 0.1}))
        assert float(run["minimum_of_f"].min()) >= -rtol


def test_free_cooling_starts_as_haff_says(make_scene: MakeScene) -> None:
    """θ0/(1 + S(1 - ε²)ρ√θ0 t/√π)²: exact to first order in t, since a Maxwellian cools at that rate; then the gas leaves it."""
    restitution, theta0, rho = 0.4, 0.9, 0.8
    scene = make_scene(
        model={"gravity": 0.0, "friction": 0.0, "noise": 0.0},
        collisions=INELASTIC,
        initial={"modes": [], "temperature": theta0},
        run={"end_time": 0.4, "output_every": 0.1},
        grid={"nv": 161, "velocity_window": (-8.0, 8.0), "time_step": 0.01, "deposit": "quintic"},
    )
    run = solve(scene)
    t, theta = run["time"].values, run["temperature"].values[:, 0]
    haff = theta0 / (1 + 1.2 * (1 - restitution**2) * rho * math.sqrt(theta0 / math.pi) * t) ** 2
    departure = theta / haff - 1
    assert abs(departure[1]) < 0.01 * (1 - theta[1] / theta0)
    orders = np.log2(departure[2:] / departure[1:-1]) / np.log2(t[2:] / t[1:-1])
    assert np.all((orders > 1.5) & (orders < 2.2)), orders  # second order in t
    assert run["mass"].values == pytest.approx(float(run["mass"][0]), rel=1e-13)


def test_even_nx_and_odd_nx_agree(standing_scene: MakeScene) -> None:
    grids = [{"nx": nx, "nv": 128, "velocity_window": (-8.0, 8.0), "time_step": 0.1} for nx in (64, 128)]
    coarse, fine = (solve(standing_scene(0.3, grid=grid))["f"].values[-1] for grid in grids)
    assert np.abs(coarse - fine[::2]).max() < 1e-12


def test_a_restart_from_a_file_continues_the_run(make_scene: MakeScene, tmp_path: Path) -> None:
    grid = {"nx": 27, "nv": 108, "velocity_window": (-6.0, 7.0), "time_step": 0.05}
    quiet = {"budgets": False}
    whole = make_scene(collisions=FOLLOW, grid=grid, run={"end_time": 1.0}, output=quiet)
    solve(make_scene(collisions=FOLLOW, grid=grid, run={"end_time": 0.5}, output=quiet)).to_netcdf(tmp_path / "half.nc")
    second = Scene.model_validate(
        {**whole.model_dump(exclude_none=True), "initial": {"file": str(tmp_path / "half.nc"), "density": 0.8},
         "run": {"end_time": 0.5}}
    )  # fmt: skip
    f = solve(second)["f"].values[-1]
    assert np.abs(f - solve(whole)["f"].values[-1]).max() < 1e-9
    # Where the scene names no grid the run chooses one, and writes at the file's places and velocities, and perhaps at more.
    unnamed = solve(second.model_copy(update={"grid": type(second.grid)(time_step=0.05)}))
    v = np.linspace(-6, 7, 108, endpoint=False) + 6.5 / 108
    assert np.abs(unnamed["f"].isel(time=-1).sel(v=v, method="nearest", tolerance=1e-9).values - f).max() < 1e-6
    # On another grid: interpolated.
    other = second.model_copy(update={"grid": second.grid.model_copy(update={"nx": 45, "nv": 144})})
    run = solve(other)
    truth = exact.solve(whole, x=run["x"], v=run["v"]).isel(time=-1)
    assert float(abs(run["f"].isel(time=-1) - truth["f"]).max()) < 1e-3 * float(truth["f"].max())


def test_frames_arrive_as_they_are_made(make_scene: MakeScene) -> None:
    scene = make_scene(run={"end_time": 1.0, "output_every": 0.5}, output={"moments": 0.25, "f": 1.0})
    seen: list[tuple[float, set[str]]] = []

    class Listener:
        def record(self, time: float, frame: Any) -> None:
            seen.append((time, set(frame)))

        def close(self, stopped: str | None = None) -> None: ...

    integrate(make_plan(scene), Listener())
    assert [time for time, _ in seen] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [("f" in groups, "scalars" in groups) for _, groups in seen] == [
        (True, True), (False, False), (False, True), (False, False), (True, True)]  # fmt: skip
