"""hydrodynamics.solve: rtol met, the dataset, what stops, what is refused."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import hydrodynamics
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError, SolverStopped
from kinetic_solver.hydrodynamics import refinement
from kinetic_solver.hydrodynamics.closure import ClosurePass
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
Twin = Callable[[Scene, int], Array]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 2.3, "restitution": 0.4}


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("collisions", [FOLLOW, INELASTIC], ids=["(6)", "(12)"])
def test_rtol_is_met_while_the_flow_is_smooth(
    make_scene: MakeScene, primitive_twin: Twin, collisions: dict[str, Any], rtol: float
) -> None:
    """In the maximum norm, against the spectral twin; the estimate in the attributes is no less than a third of the error."""
    scene = make_scene(collisions=collisions, accuracy={"rtol": rtol}, run={"end_time": 1.0})
    run = hydrodynamics.solve(scene)
    nx = run.sizes["x"]
    waves = np.fft.rfft(primitive_twin(scene, 161), axis=1, norm="forward")
    rho, u, theta = np.fft.irfft(np.pad(waves, ((0, 0), (0, nx // 2 + 1 - waves.shape[1]))), n=nx, axis=1, norm="forward")
    errors = (
        np.abs(run["density"][-1] - rho).max() / rho.max(),
        np.abs(run["mean_velocity"][-1] - u).max() / max(np.abs(u).max(), math.sqrt(theta.max())),
        np.abs(run["temperature"][-1] - theta).max() / theta.max(),
    )
    assert max(errors) < rtol
    assert max(errors) < 3 * run.attrs["error_maximum_norm"]
    assert run.attrs["flow"] == "smooth"


def test_with_jumps_the_error_is_in_L1_and_said_so(make_scene: MakeScene) -> None:
    changes = {"initial": {"modes": [], "step": {"from": 0.2, "to": 0.6, "ratio": 3.0}}, "run": {"end_time": 0.8}}
    scene = make_scene(collisions=FOLLOW, accuracy={"rtol": 6e-3}, **changes)
    run = hydrodynamics.solve(scene)
    fine = ClosurePass(scene, 2048, math.inf)
    fine.advance(0.0, 0.8)
    rho = fine.frame(0.8).fields[0]
    error = float(np.abs(run["density"][-1].values - rho[:: 2048 // run.sizes["x"]]).mean() / rho.max())
    assert run.attrs["flow"] == "jumps"
    assert run.attrs["jumps_from"] == 0
    assert error < run.attrs["error_L1"] <= 6e-3
    assert np.abs(run["mass"] / (0.8 * 9.0) - 1).max() < 1e-13


def test_the_dataset(make_scene: MakeScene) -> None:
    scene = make_scene(
        collisions=FOLLOW, run={"end_time": 0.7, "output_every": 0.3}, output={"scalars": 0.1, "moments": True}, grid={"nx": 96}
    )
    run = hydrodynamics.solve(scene)
    assert run["density"].dims == ("time", "x")
    assert run["time"].values.tolist() == pytest.approx([0, 0.3, 0.6, 0.7])
    assert run.sizes == {"time": 4, "x": 96, "bounds": 2, "time_scalars": 8}
    assert not {"f", "v", "velocity_distribution"} & set(run.variables)
    rho, u, theta = (run[name].values for name in ("density", "mean_velocity", "temperature"))
    dx = 9.0 / 96
    at = run["time_scalars"].values.searchsorted(0.6 - 1e-9)
    assert run["energy"].values[at] == pytest.approx((rho[2] * (u[2] ** 2 + theta[2])).sum() * dx / 2, rel=1e-12)
    assert run["momentum"].values[at] == pytest.approx((rho[2] * u[2]).sum() * dx, rel=1e-12)
    assert (run["heat_flux"] == 0).all()
    assert run.attrs["method"] == "hydrodynamics"
    assert int(run["status"]) == 1


def test_a_given_grid_is_kept_and_what_it_misses_is_said(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, grid={"nx": 32}, accuracy={"rtol": 1e-7})
    with pytest.warns(
        UserWarning, match=r"the error is about .* in the maximum norm \(accuracy.rtol = 1e-07\); raise grid.nx or accuracy.rtol"
    ):
        run = hydrodynamics.solve(scene)
    assert run.sizes["x"] == 32


def test_what_jumps_leave_out_of_reach_is_said(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """With jumps 1e-7 would take years: the run settles for less, soon."""
    monkeypatch.setattr(refinement, "SETTLE", 1e5)
    step = {"initial": {"modes": [], "step": {"from": 0.2, "to": 0.6, "ratio": 3.0}}, "run": {"end_time": 0.2}}
    with pytest.warns(UserWarning, match=r"in L1 from t = 0 on, with jumps \(accuracy.rtol = 1e-07\); raise accuracy.rtol"):
        run = hydrodynamics.solve(make_scene(collisions=FOLLOW, accuracy={"rtol": 1e-7}, **step))
    assert 512 <= int(run.attrs["points"]) <= 2048


def test_homogeneous_scenes_take_one_point(make_scene: MakeScene) -> None:
    """Velocity and temperature relax in closed form: θ - σ as e^{-2γt}."""
    start = {"initial": {"modes": [], "mean_velocity": -1.0, "temperature": 1.9}, "accuracy": {"rtol": 1e-9}}
    run = hydrodynamics.solve(make_scene(**start))
    assert run.sizes["x"] == 1
    assert float(run["temperature"][-1, 0]) == pytest.approx(0.5 + 1.4 * math.exp(-2 * 0.7 * 1.5), rel=1e-12)
    follow = hydrodynamics.solve(make_scene(**start, collisions=FOLLOW))
    # u' = g - γu - Sρθ, by its own integral
    t, rate = 1.5, 1.7 * 0.8
    terminal = (1.3 - rate * 0.5) / 0.7
    e = math.exp(-0.7 * t)
    u = terminal + (-1.0 - terminal) * e - rate * 1.4 * (e - e * e) / 0.7
    assert float(follow["mean_velocity"][-1, 0]) == pytest.approx(u, abs=1e-8)


def test_free_cooling_of_the_closure_is_haffs_law(make_scene: MakeScene) -> None:
    """(12) without friction and noise, at rest: θ = θ0/(1 + Cρ√θ0 t)², where collisions alone set the steps."""
    scene = make_scene(
        model={"gravity": 0.0, "friction": 0.0, "noise": 0.0},
        collisions=INELASTIC,
        initial={"modes": [], "mean_velocity": 0.3, "temperature": 1.9},
        run={"end_time": 20.0},
        accuracy={"rtol": 1e-7},
    )
    c = 2.3 * (1 - 0.4**2) / math.sqrt(math.pi)
    found = hydrodynamics.solve(scene)["temperature"].values[-1, 0]
    assert found == pytest.approx(1.9 / (1 + c * 0.8 * math.sqrt(1.9) * 20.0) ** 2, rel=1e-6)


def test_a_runaway_stops_with_one_line_and_keeps_its_frames(make_scene: MakeScene) -> None:
    """R* = 2.4 and a long wave: shocks heat the gas, collisions drive what is hot, and nothing stops it."""
    scene = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 2.97},
        pipe={"length": 15.0},
        run={"end_time": 30.0, "output_every": 0.25},
        grid={"nx": 128},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(SolverStopped, match="runs away") as stop:
            hydrodynamics.solve(scene)
    assert "\n" not in str(stop.value)
    run = stop.value.dataset
    assert int(run["status"]) == 2
    assert 3 < run.sizes["time"] < 120
    assert np.isfinite(run["density"]).all()
    assert (run["density"] > 0).all()
    assert (run["temperature"] > 0).all()


@pytest.mark.parametrize("number", [1.0, 10.0, 100.0])
def test_operator_12_has_no_growth_at_any_density(number: float) -> None:
    """The paper expects the behaviour of (6). In its own equations, with (14) corrected, every wave decays, large ones too."""
    scene = Scene.model_validate(
        {
            "model": {"gravity": 0.3, "friction": 0.7, "noise": 0.6},
            "collisions": {"operator": "inelastic", "cross_section": number * 0.7 / math.sqrt(0.6) / 0.9, "restitution": 0.5},
            "pipe": {"length": 8.0},
            "initial": {"density": 0.9, "modes": [{"mode": 1, "cos": 0.3}, {"mode": 4, "sin": 0.2}]},
            "run": {"end_time": 60.0, "output_every": 20.0},
            "grid": {"nx": 96},
            "accuracy": {"rtol": 3e-2},
        }
    )
    contrast = hydrodynamics.solve(scene)["density"].std("x").values
    assert contrast[-1] < 0.4 * contrast[0]
    assert (np.diff(contrast) < 0).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"initial": {"modes": [], "file": "state.nc"}}, "initial.file"),
        ({"initial": {"modes": [], "eigenmodes": [{"mode": 1, "cos": 0.1}]}}, "initial.eigenmodes"),
        ({"initial": {"modes": [], "step": {"from": 0.2, "to": 0.6, "ratio": 0.0}}}, "initial.step.ratio = 0"),
        ({"initial": {"modes": [{"mode": 1, "cos": 1.0}]}}, "initial.modes: the density falls to"),
        ({"collisions": INELASTIC, "hydrodynamics": {"moments": 5}}, "hydrodynamics.moments"),
        ({"model": {"noise": 0.0}, "hydrodynamics": {"moments": 5}}, "model.noise = 0"),
    ],
)
def test_refusals(make_scene: MakeScene, changes: dict[str, Any], message: str) -> None:
    scene = make_scene(**changes)
    if "file" in changes.get("initial", {}):
        scene = Scene.model_validate({"pipe": {"length": 9.0}, "run": {"end_time": 1.0}, "initial": {"file": "state.nc"}})
    with pytest.raises(SceneError, match=message) as error:
        hydrodynamics.solve(scene)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(12))
def test_any_scene_stays_positive_and_keeps_its_mass_or_stops(seed: int) -> None:
    """Both operators and none, without friction or noise and with much, cold starts, streams that cross, steps of 1:1000."""
    rng = np.random.default_rng(seed)
    mean = float(10 ** rng.uniform(-3, 3))
    strength = float(10 ** rng.uniform(-1, 1.5)) / mean
    operators = (
        None,
        {"operator": "follow-the-leader", "cross_section": strength},
        {"operator": "inelastic", "cross_section": strength, "restitution": float(rng.uniform(0, 1))},
    )
    start: dict[str, Any] = {"density": mean, "temperature": float(10 ** rng.uniform(-4, 1)), "mean_velocity": rng.normal(0, 5)}
    if seed % 2:
        start["step"] = {"from": 0.3, "to": 0.6, "ratio": float(10 ** rng.uniform(-3, 3))}
    else:
        start["modes"] = [{"mode": 2, "cos": float(rng.uniform(-0.99, 0.99))}]
        start["velocity_modes"] = [{"mode": 1, "sin": float(rng.normal(0, 3))}]
    data = {
        "model": {
            "gravity": float(rng.normal(0, 30)),
            "friction": float(rng.choice([0, 0.1, 50])),
            "noise": float(rng.choice([0, 0.01, 20])),
        },
        "pipe": {"length": float(10 ** rng.uniform(0, 2))},
        "initial": start,
        "run": {"end_time": 0.4},
        "grid": {"nx": 48},
        "accuracy": {"rtol": 0.1},
    }
    scene = Scene.model_validate({**data, "collisions": operators[seed % 3]})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            run = hydrodynamics.solve(scene)
        except SolverStopped as stop:
            run = stop.dataset
    if "stopped" in run.attrs:
        assert "runs away" in run.attrs["stopped"]
        assert scene.operator == "follow-the-leader"
    assert np.isfinite(run["mean_velocity"]).all()
    assert (run["density"] > 0).all()
    assert (run["temperature"] > 0).all()
    assert np.abs(run["mass"] / run["mass"][0] - 1).max() < 1e-11
