"""The moving frame: its formulae one by one, and runs in it against the closed form, a run at rest, and the laws of motion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, exact, solve
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions import FollowLeader, Inelastic
from kinetic_solver.operators.collisions.protocol import CollisionOperator
from kinetic_solver.operators.moments import totals
from kinetic_solver.plan import make_plan
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.scene import Model

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.9}
INELASTIC = {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}
FAR = {"mean_velocity": -6.0, "temperature": 0.6}
"""Many √θ from every terminal velocity below."""
RUN = {"end_time": 1.5, "output_every": 0.5}
CLOSED = {"none": {}, "(6)": {"collisions": FOLLOW}}
MODELS = {
    "gravity": Model(gravity=9.0, friction=0.7, noise=0.5),
    "no noise": Model(gravity=1.3, friction=0.7, noise=0.0),
    "no friction": Model(gravity=1.3, friction=0.0, noise=0.5),
    "neither": Model(gravity=1.3, friction=0.0, noise=0.0),
}


def in_a_moving_frame(scene: Scene) -> xr.Dataset:
    assert make_plan(scene).reference_frame.moving
    return solve(scene)


def of_f(run: xr.Dataset, truth: xr.Dataset) -> float:
    """The largest difference over max f after time 0."""
    return float((abs(run["f"] - truth["f"]).max(("x", "v")) / truth["f"].max(("x", "v")))[1:].max())


def of_moments(run: xr.Dataset, truth: xr.Dataset) -> dict[str, float]:
    """The largest difference of every field after time 0 over its scale, a power of √θ0."""
    rho, c = float(truth["density"].max()), math.sqrt(FAR["temperature"])
    scales = {"density": rho, "mean_velocity": c, "temperature": c**2, "heat_flux": rho * c**3}
    return {name: float(abs(run[name] - truth[name])[1:].max()) / scale for name, scale in scales.items()}


@pytest.mark.parametrize("collisions", CLOSED)
@pytest.mark.parametrize("model", MODELS)
def test_runs_against_the_closed_form(make_scene: MakeScene, model: str, collisions: str) -> None:
    """f on the run's own x and v, and moments, in every frame: f to rtol, u and ρ too; powers of v weigh f's tail: 10 rtol for
    the moments of second and third order (measured: 2e-5)."""
    scene = make_scene(model=MODELS[model].model_dump(), initial=FAR, run=RUN, **CLOSED[collisions])
    run = in_a_moving_frame(scene)
    assert run.sizes["time"] == 4
    assert run["x"].values == pytest.approx(scene.pipe.length * np.arange(run.sizes["x"]) / run.sizes["x"], rel=1e-15)
    truth = exact.solve(scene, x=run["x"], v=run["v"])
    assert of_f(run, truth) < 1e-4
    found = of_moments(run, truth)
    assert max(found["density"], found["mean_velocity"]) < 1e-4, found
    assert max(found.values()) < 1e-3, found


@pytest.mark.parametrize("noise", [0.5, 0.0])
def test_operator_12_against_a_run_at_rest(make_scene: MakeScene, noise: float) -> None:
    """The same scene in a window that was given, so at rest; both to rtol. Momentum obeys p' = gN - γp, to what rtol leaves."""
    scene = make_scene(model={"gravity": 6.0, "noise": noise}, initial=FAR, run=RUN, collisions=INELASTIC)
    moving = in_a_moving_frame(scene)
    window = {"velocity_window": (-12.0, 8.0), "nv": 320, "nx": moving.sizes["x"]}
    at_rest = scene.model_copy(update={"grid": scene.grid.model_copy(update=window)})
    assert not make_plan(at_rest).reference_frame.moving
    found = of_moments(moving, solve(at_rest))
    assert max(found["density"], found["mean_velocity"]) < 2e-4, found
    assert max(found.values()) < 2e-3, found
    t, mass = moving["time"], float(moving["mass"][0])
    decay = np.exp(-0.7 * t)
    p = float(moving["momentum"][0]) * decay + 6.0 * mass * (1 - decay) / 0.7
    assert moving["momentum"].values == pytest.approx(p.values, abs=1e-5 * 6.0 * mass)


def test_friction_without_noise_is_a_clock(make_scene: MakeScene) -> None:
    """(12) with gravity and friction against (12) alone, run to s = (1 - exp(-γt))/γ on a given grid: ρ moved by X, u and θ
    scaled by λ and λ². Nothing of moving_frame.py is used: γ = 0.7, g = 1.3, u0 = -6, t = 1.5."""
    gamma, g, u0, t = 0.7, 1.3, FAR["mean_velocity"], 1.5
    decay = math.exp(-gamma * t)
    clock = (1 - decay) / gamma
    position = u0 * clock + g / gamma * (t - clock)
    velocity = u0 * decay + g / gamma * (1 - decay)
    scene = make_scene(model={"noise": 0.0}, initial=FAR, run={"end_time": t}, collisions=INELASTIC)
    moved = in_a_moving_frame(scene).isel(time=-1)
    nx = moved.sizes["x"]
    free = make_scene(
        model={"gravity": 0.0, "friction": 0.0, "noise": 0.0},
        initial={**FAR, "mean_velocity": 0.0},
        run={"end_time": clock},
        collisions=INELASTIC,
        grid={"nx": nx, "nv": 64, "velocity_window": (-4.5, 4.5)},
    )
    frictionless = solve(free).isel(time=-1)

    def at_x(name: str) -> np.ndarray:
        waves = np.exp(-2j * np.pi * np.arange(nx // 2 + 1) * position / scene.pipe.length)
        return np.fft.irfft(np.fft.rfft(frictionless[name].values) * waves, n=nx)

    assert moved["density"].values == pytest.approx(at_x("density"), abs=1e-4)
    assert moved["mean_velocity"].values == pytest.approx(velocity + decay * at_x("mean_velocity"), abs=1e-4)
    assert moved["temperature"].values == pytest.approx(decay**2 * at_x("temperature"), abs=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_the_frames_formulae(model: str) -> None:
    """Clock and place are inverse; by fourth-order differences X' = U, U' = g - γU, ds/dt = λ and λ' = -γλ."""
    m = MODELS[model]
    frame = ReferenceFrame(m, moving=True, start=-2.0)
    h, weights = 0.01, np.array([1, -8, 0, 8, -1]) / (12 * 0.01)
    for time in (0.3, 1.4, 5.0):
        place = frame.place(frame.clock(time))
        assert place.time == pytest.approx(time, rel=1e-13)
        clocks = np.array([frame.clock(time + h * n) for n in range(-2, 3)])
        around = [frame.place(float(clock)) for clock in clocks]
        assert weights @ [p.position for p in around] == pytest.approx(place.velocity, rel=1e-7)
        assert weights @ [p.velocity for p in around] == pytest.approx(m.gravity - m.friction * place.velocity, rel=1e-7)
        assert weights @ clocks == pytest.approx(place.scale, rel=1e-7)
        # Only where friction is taken out does the scale change.
        friction = m.friction if m.noise == 0 else 0.0
        assert weights @ [p.scale for p in around] == pytest.approx(-friction * place.scale, rel=1e-7, abs=1e-12)
    start = frame.place(0.0)
    assert (start.time, start.position, start.velocity, start.scale) == (0.0, 0.0, -2.0, 1.0)


def test_a_frame_at_rest_is_the_laboratory(make_scene: MakeScene) -> None:
    frame = ReferenceFrame(MODELS["no noise"])
    place = frame.place(0.8)
    assert (place.time, place.position, place.velocity, place.scale) == (0.8, 0.0, 0.0, 1.0)
    assert frame.clock(0.8) == 0.8
    scene = make_scene()
    assert frame.scene(scene) is scene


def follow_leader(v: np.ndarray) -> CollisionOperator:
    return FollowLeader(v, 0.7)


def inelastic(v: np.ndarray) -> CollisionOperator:
    return Inelastic(v, 0.7, 0.4, "linear")


@pytest.mark.parametrize("operator", [follow_leader, inelastic])
def test_totals_and_rates_against_direct_sums(operator: Callable[[np.ndarray], CollisionOperator]) -> None:
    """F on a grid over w, and f = F/λ on the same points v = U + λw: sums over f are what Place makes of sums over F. Round-off:
    the discrete operators depend on differences of velocity only, and in proportion."""
    place = ReferenceFrame(MODELS["no noise"], moving=True, start=-2.0).place(0.6)
    inner = PhaseSpaceGrid(3, 40, 9.0, -4.0, 5.0)
    low, high = place.velocity + place.scale * inner.low, place.velocity + place.scale * inner.high
    outer = PhaseSpaceGrid(3, 40, 9.0, low, high)
    moving = np.random.default_rng(5).uniform(0, 1, (3, 40)) * np.exp(-((inner.v - 0.4) ** 2))
    f = moving / place.scale
    assert place.totals(totals(inner, moving)) == pytest.approx(totals(outer, f), rel=1e-13)
    _, p, energy = totals(inner, operator(inner.v).rate(moving))
    _, *rates = totals(outer, operator(outer.v).rate(f))
    assert place.rates((p, energy)) == pytest.approx(rates, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("collisions", [None, FOLLOW, INELASTIC])
def test_budgets_close(make_scene: MakeScene, model: str, collisions: dict[str, Any] | None) -> None:
    """In the laboratory, at several times: mass to round-off, the residuals within 1e-4 of what the terms move, rtol; and rates
    are what the totals do, by the equations for p and E."""
    m = MODELS[model]
    run = in_a_moving_frame(make_scene(model=m.model_dump(), initial=FAR, run=RUN, collisions=collisions))
    mass = float(run["mass"][0])
    assert abs(run["mass_residual"]).max() < 1e-12 * mass
    for kind in ("momentum", "energy"):
        moved = sum(float(abs(run[name]).max()) for name in run if str(name).startswith(f"{kind}_from_"))
        assert abs(run[f"{kind}_residual"]).max() < 1e-4 * moved, kind
    assert run["momentum_rate_gravity"].values == pytest.approx(m.gravity * mass, rel=1e-12)
    assert run["energy_rate_gravity"].values == pytest.approx(m.gravity * run["momentum"].values, rel=1e-12)
    assert run["momentum_rate_friction"].values == pytest.approx(-m.friction * run["momentum"].values, rel=1e-12)


def test_where_nothing_needs_it_the_frame_is_at_rest(make_scene: MakeScene) -> None:
    assert not make_plan(make_scene(collisions=FOLLOW)).reference_frame.moving
    assert not make_plan(make_scene(model={"gravity": 0.0, "friction": 0.0}, collisions=FOLLOW)).reference_frame.moving
    fast = {"model": {"gravity": 9.0}, "initial": FAR, "collisions": FOLLOW}
    assert make_plan(make_scene(**fast)).reference_frame.moving
    for given in ({"nv": 90}, {"velocity_window": (-12.0, 20.0)}):
        plan = make_plan(make_scene(**fast, grid=given))
        assert not plan.reference_frame.moving
        assert plan.grid == dataclasses.replace(plan.whole, nx=plan.grid.nx)
    assert not make_plan(make_scene(**fast, output={"moment_equations": True})).reference_frame.moving


@pytest.mark.parametrize("collisions", CLOSED)
def test_gravity_costs_no_velocities(make_scene: MakeScene, collisions: str) -> None:
    """From rest to g/γ = 100√σ: the solver's nv is that of g = 0, the output's is not; and f still meets rtol at every point."""
    start = {"mean_velocity": 0.0, "temperature": 0.5}
    fall, stay = (
        make_scene(model={"gravity": gravity}, initial=start, run=RUN, **CLOSED[collisions])
        for gravity in (100 * math.sqrt(0.5) * 0.7, 0.0)
    )
    plan = make_plan(fall)
    assert plan.reference_frame.moving
    assert plan.grid.nv <= make_plan(stay).grid.nv + 3
    assert plan.output.nv > 4 * plan.grid.nv
    run = solve(fall)
    assert of_f(run, exact.solve(fall, x=run["x"], v=run["v"])) < 1e-4
