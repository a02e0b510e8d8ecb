"""Runs in scaled velocities: free cooling from Haff's law to its end, beside gravity and friction, with waves, to any depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, solve
from kinetic_solver.dataset import in_velocities
from kinetic_solver.plan import make_plan
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.scene import Model
from kinetic_solver.stability import cooling_state

MakeScene = Callable[..., Scene]
S, RHO, THETA, U = 1.7, 0.8, 0.6, 0.4


def cooling(make_scene: MakeScene, restitution: float, end: float, **changes: Any) -> Scene:
    """`changes` on the scene of a homogeneous gas that cools; none of its numbers is one."""
    tables: dict[str, Any] = {
        "model": {"gravity": 0.3, "friction": 0.0, "noise": 0.0},
        "collisions": {"operator": "inelastic", "cross_section": S, "restitution": restitution},
        "initial": {"density": RHO, "temperature": THETA, "mean_velocity": U, "modes": []},
        "run": {"end_time": end},
        "accuracy": {"rtol": 1e-6},
    }
    return make_scene(**tables | changes)


def time_of(restitution: float, ratio: float) -> float:
    """About when θ/θ0 is this."""
    return (ratio**-0.5 - 1) / (cooling_state(restitution).cooling_rate * S * RHO * math.sqrt(THETA))


def shape(run: xr.Dataset, frame: int = -1) -> tuple[float, float, float]:
    """Mass, mean and a2 of f over scaled velocities."""
    w, f = run["scaled_velocity"].values, run["f"].values[frame, 0]
    dw = w[1] - w[0]
    mass = f.sum() * dw
    mean = w @ f * dw / mass
    variance = (w - mean) ** 2 @ f * dw / mass
    return mass, mean, (w - mean) ** 4 @ f * dw / mass / (3 * variance**2) - 1


def rate_over_haff(run: xr.Dataset, restitution: float, length: float) -> float:
    """From the energy that collisions take at the last frame: dE/dt = -κ Sρ θ^{3/2} ρL."""
    taken = -float(run["energy_rate_collisions"][-1]) / (RHO * length)
    kappa = taken / (S * RHO * float(run["temperature"][-1, 0]) ** 1.5)
    return kappa * math.sqrt(math.pi) / (1 - restitution**2)


# ε: a2, the rate over Haff's, digits known, and how far the gas must cool until these have come: slowly where it is two-peaked.
ENDS = {
    0.0: (0.318313, 1.056542, 6, 1e-12),
    0.3: (0.265054, 1.047619, 6, 1e-12),
    0.5: (0.161018, 1.029364, 6, 1e-12),
    0.7: (-0.02207, 0.99505, 5, 1e-12),
    0.8: (-0.15670, 0.96864, 4, 1e-14),
    0.9: (-0.33683, 0.93321, 5, 1e-24),
}


@pytest.mark.parametrize("restitution", ENDS)
def test_how_cooling_ends(make_scene: MakeScene, restitution: float) -> None:
    a2, rate, digits, ratio = ENDS[restitution]
    # A motion of the whole would bury the energy that collisions take.
    model = {"gravity": 0.0, "friction": 0.0, "noise": 0.0}
    initial = {"density": RHO, "temperature": THETA, "mean_velocity": 0.0, "modes": []}
    scene = cooling(make_scene, restitution, time_of(restitution, ratio), model=model, initial=initial, accuracy={"rtol": 3e-7})
    run = solve(scene)
    assert float(run["temperature"][-1, 0]) == pytest.approx(ratio * THETA, rel=3e-3)
    assert shape(run)[2] == pytest.approx(a2, abs=1.5 * 10.0**-digits)
    assert rate_over_haff(run, restitution, scene.pipe.length) == pytest.approx(rate, abs=1.5 * 10.0**-digits)
    assert shape(run)[2] == pytest.approx(cooling_state(restitution).kurtosis_excess, abs=2e-6)


def test_mass_and_momentum_to_round_off(make_scene: MakeScene) -> None:
    """Of two uneven beams in free fall, down to θ/θ0 = 1e-20: u = u0 + g t."""
    beams = [{"share": 0.3, "mean_velocity": -1.1, "temperature": 0.2}, {"share": 0.7, "mean_velocity": 0.7, "temperature": 0.3}]
    end = time_of(0.5, 1e-20)
    run = solve(cooling(make_scene, 0.5, end, initial={"density": RHO, "beams": beams, "modes": []}))
    u0 = 0.3 * -1.1 + 0.7 * 0.7
    for frame in (0, -1):
        mass, mean, _ = shape(run, frame)
        assert mass == pytest.approx(RHO, rel=1e-9 if frame == 0 else 1e-8)  # sums over a window that cuts f at 1e-9
        assert abs(mean) < 1e-8
    assert run["mass"].values == pytest.approx(run["mass"].values[0], rel=1e-12)
    assert run["mean_velocity"].values[:, 0] == pytest.approx(u0 + 0.3 * run["time"].values, rel=1e-13)
    assert run["velocity_origin"].values == pytest.approx(u0 + 0.3 * run["time"].values, rel=1e-13)
    assert float(run["temperature"][-1, 0]) < 1e-19


def test_haffs_law_at_the_start(make_scene: MakeScene) -> None:
    """θ leaves it as t², by the kurtosis that grows as t: two-sided."""
    run = {"end_time": 1.2, "output_every": 0.04}
    scene = cooling(make_scene, 0.4, 1.2, run=run, accuracy={"rtol": 1e-7}, output={"budgets": False, "f": False})
    run = solve(scene)
    assert "scaled_velocity" in run.dims
    rate = S * RHO * (1 - 0.4**2) / math.sqrt(math.pi) * math.sqrt(THETA)
    off = run["temperature"][:, 0] * (1 + rate * run["time"]) ** 2 / THETA - 1
    once, twice, four = (float(off.sel(time=t, method="nearest")) for t in (0.04, 0.08, 0.16))
    assert abs(once) < 3e-4
    assert twice / once == pytest.approx(4, rel=0.05)
    assert four / twice == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("restitution", [0.2, 0.85])
def test_a_fixed_window_gives_the_same_while_it_resolves(make_scene: MakeScene, restitution: float) -> None:
    """f, θ and u at five times, in the scene's own velocities."""
    end = time_of(restitution, 0.06)
    tables = {
        "run": {"end_time": end, "output_every": end / 4},
        "model": {"gravity": 0.0, "friction": 0.0, "noise": 0.0},
    }
    grid = {"nv": 640, "velocity_window": (U - 4.6, U + 4.6)}
    run = solve(cooling(make_scene, restitution, end, **tables))
    fixed = solve(cooling(make_scene, restitution, end, **tables, grid=grid))
    over_v = in_velocities(run, fixed["v"].values)
    for name in ("f", "velocity_distribution"):
        assert np.abs(over_v[name] - fixed[name]).max() < 4e-6 * fixed[name].max()
    assert run["temperature"].values == pytest.approx(fixed["temperature"].values, abs=1e-6 * THETA)
    assert run["mean_velocity"].values == pytest.approx(fixed["mean_velocity"].values, abs=1e-9)
    assert run["energy_from_collisions"].values == pytest.approx(fixed["energy_from_collisions"].values, abs=1e-5)


def test_friction_is_a_change_of_time(make_scene: MakeScene) -> None:
    """Without noise θ(t) = exp(-2γt) θ_free((1 - exp(-γt))/γ), and the shape is the same."""
    gamma, end = 0.7, 9.0
    drifted = -math.expm1(-gamma * end) / gamma
    with_friction = solve(cooling(make_scene, 0.1, end, model={"gravity": 0.3, "friction": gamma, "noise": 0.0}))
    free = solve(cooling(make_scene, 0.1, drifted))
    theta, of_free = (float(run["temperature"][-1, 0]) for run in (with_friction, free))
    assert theta == pytest.approx(math.exp(-2 * gamma * end) * of_free, rel=2e-6)
    assert shape(with_friction)[2] == pytest.approx(shape(free)[2], abs=1e-5)
    terminal = 0.3 / gamma
    assert float(with_friction["mean_velocity"][-1, 0]) == pytest.approx(
        terminal + (U - terminal) * math.exp(-gamma * end), rel=1e-12
    )


def test_budgets_close(make_scene: MakeScene) -> None:
    """In free fall, and with friction, though the last steps pass most of the time."""
    for gamma in (0.0, 0.7):
        run = solve(cooling(make_scene, 0.3, 9.0, model={"gravity": 0.3, "friction": gamma, "noise": 0.0}))
        for name in ("momentum", "energy"):
            size = float(np.abs(run[name]).max() + np.abs(run[f"{name}_from_gravity"]).max())
            assert abs(float(run[f"{name}_residual"][-1])) < 1e-6 * size


def test_waves_in_a_cooling_gas(make_scene: MakeScene) -> None:
    """A density wave and a temperature wave, against a fixed window: every field at every frame."""
    waves = {"density": RHO, "temperature": THETA, "mean_velocity": U, "modes": [{"mode": 1, "cos": 0.2}],
             "temperature_modes": [{"mode": 2, "sin": 0.1}]}  # fmt: skip
    tables = {"initial": waves, "run": {"end_time": 6.0, "output_every": 2.0}, "accuracy": {"rtol": 1e-4}, "output": {"nx": 33}}
    run = solve(cooling(make_scene, 0.3, 6.0, **tables))
    assert run["f"].dims == ("time", "x", "scaled_velocity")
    grid = {"nv": 360, "velocity_window": (-4.4, 7.0)}
    fixed = solve(cooling(make_scene, 0.3, 6.0, **tables, grid=grid))
    over_v = in_velocities(run, fixed["v"].values)
    for name in ("f", "density", "temperature"):
        assert np.abs(over_v[name] - fixed[name]).max() < 2e-4 * fixed[name].max()
    assert np.abs(run["mean_velocity"] - fixed["mean_velocity"]).max() < 2e-4
    assert run["mass"].values == pytest.approx(run["mass"].values[0], rel=1e-12)
    assert np.abs(run["momentum_residual"].values).max() < 1e-10


def test_when_it_is_chosen(make_scene: MakeScene) -> None:
    """Where a gas becomes much slower, and nothing is said of the grid; the plan says why."""
    plan = make_plan(cooling(make_scene, 0.5, 20.0))
    assert plan.output.scaled
    assert plan.reasons["reference_frame"].startswith("the frame's velocities shrink with the gas")
    for changes in (
        {"run": {"end_time": 0.1}},
        {"model": {"gravity": 0.3, "friction": 0.7, "noise": 0.5}},
        {"collisions": {"operator": "inelastic", "cross_section": S, "restitution": 1.0}},
        {"grid": {"nv": 64}},
        {"grid": {"velocity_window": (-9.0, 12.0)}},
    ):
        assert not make_plan(cooling(make_scene, 0.5, 20.0, **changes)).output.scaled
    shown = make_plan(cooling(make_scene, 0.5, 20.0, output={"velocity_window": [-5.0, 9.0]}))
    assert shown.reference_frame.cooling > 0
    assert not shown.output.scaled


@pytest.mark.parametrize("gamma", [0.0, 0.7])
def test_the_frame(gamma: float) -> None:
    """X' = U, U' = g - γU, λ' = -γλ - κλ²/exp(-γt), s' = λ, and back from the clock to the time."""
    frame = ReferenceFrame(Model(gravity=0.3, friction=gamma, noise=0.0), moving=True, start=0.4, cooling=1.3)
    t, h = 1.7, 1e-4
    before, now, after = (frame.place(frame.clock(t + step)) for step in (-h, 0.0, h))
    assert now.time == pytest.approx(t, rel=1e-14)
    assert (after.position - before.position) / (2 * h) == pytest.approx(now.velocity, rel=1e-7)
    assert (after.velocity - before.velocity) / (2 * h) == pytest.approx(0.3 - gamma * now.velocity, rel=1e-6)
    slowing = -gamma * now.scale - 1.3 * now.scale**2
    assert (after.scale - before.scale) / (2 * h) == pytest.approx(slowing, rel=1e-6)
    assert (frame.clock(t + h) - frame.clock(t - h)) / (2 * h) == pytest.approx(now.scale, rel=1e-7)


@pytest.mark.parametrize(("gamma", "time"), [(0.0, 3.0), (0.7, 1e-4), (0.7, 1.5), (0.7, 40.0)])
def test_what_the_frame_has_travelled(gamma: float, time: float) -> None:
    """X and ∫U²/2 dt, by quadrature."""
    frame = ReferenceFrame(Model(gravity=0.3, friction=gamma, noise=0.0), moving=True, start=0.4, cooling=1.3)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u = np.array([frame.place(frame.clock(t)).velocity for t in (time * (nodes + 1) / 2).tolist()])
    expected = time / 2 * weights @ u, time / 4 * weights @ u**2
    assert frame.travelled(time) == pytest.approx(expected, rel=1e-12)


def test_as_long_for_every_e_fold() -> None:
    """A time ten times as long takes as much more of the clock, however late."""
    frame = ReferenceFrame(Model(gravity=0.0, friction=0.0, noise=0.0), moving=True, cooling=0.9)
    clocks = [frame.clock(10.0**n) for n in range(3, 12)]
    assert np.diff(clocks) == pytest.approx(math.log(10) / 0.9, rel=2e-3)
