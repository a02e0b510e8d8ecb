"""Every path that a scene can name gives the same f to its rtol; what does not go together is refused in one line."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from kinetic_solver import Scene, SolverStopped, exact, solve
from kinetic_solver.errors import SceneError
from kinetic_solver.plan import make_plan

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
INELASTIC = {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.4}
START = {
    "mean_velocity": 0.6,
    "temperature": 0.4,
    "velocity_modes": [{"mode": 1, "sin": 0.2}],
    "temperature_modes": [{"mode": 2, "cos": 0.15}],
}
CHANGES = {"initial": START, "run": {"end_time": 0.8}, "output": {"budgets": False}}
POINTS = [
    {"velocity": "points", **stepping, **drift_diffusion}
    for stepping in ({}, {"stepping": "exact"}, {"stepping": "extrapolated"}, {"stepping": "strang"})
    for drift_diffusion in ({}, {"drift_diffusion": "finite-volume-8"}, {"drift_diffusion": "finite-volume"})
]
HERMITE = [{"velocity": "hermite", **stepping} for stepping in ({}, {"stepping": "exact"}, {"stepping": "extrapolated"})]
PATHS = [*POINTS, *HERMITE]
WITHOUT_EXACT = [path for path in PATHS if path.get("stepping") != "exact"]


def name(path: dict[str, str]) -> str:
    return " ".join(path.values())


def tolerance(path: dict[str, str]) -> float:
    """Second order, in dv or in time, is dear at the finer one."""
    return 1e-3 if path.get("drift_diffusion") == "finite-volume" or path.get("stepping") == "strang" else 1e-5


def error(run: Any, truth: np.ndarray) -> float:
    return float(np.abs(run["f"].values[-1] - truth).max() / truth.max())


@pytest.mark.parametrize("path", PATHS, ids=name)
@pytest.mark.parametrize("operator", [FOLLOW, None], ids=["(6)", "none"])
def test_against_the_closed_form(make_scene: MakeScene, operator: dict[str, Any] | None, path: dict[str, str]) -> None:
    rtol = tolerance(path)
    scene = make_scene(collisions=operator, grid=path, accuracy={"rtol": rtol}, **CHANGES)
    run = solve(scene)
    truth = exact.Solution(scene, 0.8).distribution(run["x"].values, run["v"].values)
    assert error(run, truth) <= rtol


@functools.cache
def interpolant(scene: Scene) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The final f at any x, v: trigonometric in x, a quintic spline in v."""
    run = solve(scene)
    f, old_v, nx = run["f"].values[-1], run["v"].values, run.sizes["x"]
    k = 2 * np.pi / scene.pipe.length * np.arange(nx // 2 + 1)
    modes = np.fft.rfft(f, axis=0) / nx * np.where(k == 0, 1, 2)[:, None]  # nx is odd

    def at(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        spline = make_interp_spline(old_v, (np.exp(1j * np.outer(x, k)) @ modes).real, k=5, axis=1)
        return np.where((v > old_v[0]) & (v < old_v[-1]), spline(np.clip(v, old_v[0], old_v[-1])), 0.0)

    return at


@pytest.mark.parametrize("path", WITHOUT_EXACT, ids=name)
def test_operator_12_against_a_fine_run(make_scene: MakeScene, path: dict[str, str]) -> None:
    """The fine run is on velocity points; it and the runs in Hermite functions share no discretisation in v."""
    fine = {"nx": 105, "nv": 270, "velocity_window": (-5.5, 6.5), "deposit": "quintic"}
    truth = interpolant(make_scene(collisions=INELASTIC, grid=fine, accuracy={"rtol": 1e-7}, **CHANGES))
    rtol = tolerance(path)
    run = solve(make_scene(collisions=INELASTIC, grid=path, accuracy={"rtol": rtol}, **CHANGES))
    assert error(run, truth(run["x"].values, run["v"].values)) <= rtol


VOLUMES = {"drift_diffusion": "finite-volume-8"}
HOT = {"initial": {"mean_velocity": 0.2, "temperature": 1.1}}  # more than twice the noise


@pytest.mark.parametrize(
    ("key", "changes"),
    [
        ("grid.velocity = 'hermite'", {"grid": {**HERMITE[0], "stepping": "strang"}}),
        ("grid.velocity = 'hermite'", {"grid": {**HERMITE[0], "drift_diffusion": "kernel"}}),
        ("grid.velocity = 'hermite'", {"grid": {**HERMITE[0], "drift_diffusion": "finite-volume"}}),
        ("grid.velocity = 'hermite'", {"grid": HERMITE[0], "model": {"friction": 0.0}}),
        ("grid.velocity = 'hermite'", {"grid": HERMITE[0], "model": {"noise": 0.0}}),
        ("grid.velocity = 'hermite'", {"grid": HERMITE[0], **HOT}),
        ("grid.velocity = 'hermite'", {"grid": {**HERMITE[0], "nv": 64}, **HOT}),
        ("grid.drift_diffusion = 'finite-volume'", {"grid": {"drift_diffusion": "finite-volume"}, "model": {"noise": 0.0}}),
        ("grid.drift_diffusion = 'finite-volume-8'", {"grid": VOLUMES, "model": {"friction": 0.0}}),
    ],
    ids=str,
)
@pytest.mark.parametrize("operator", [FOLLOW, INELASTIC, None], ids=["(6)", "(12)", "none"])
def test_what_does_not_go_together(
    make_scene: MakeScene, operator: dict[str, Any] | None, key: str, changes: dict[str, Any]
) -> None:
    with pytest.raises(SceneError) as caught:
        solve(make_scene(collisions=operator, **changes))
    message = str(caught.value)
    assert message.startswith(key)
    assert "\n" not in message
    assert "points" in message or "kernel" in message  # what is allowed


def test_operator_12_has_no_exact_step(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match=r"^grid\.stepping = 'exact': .*allowed: 'extrapolated', 'strang'$"):
        solve(make_scene(collisions=INELASTIC, grid={"stepping": "exact"}))


@pytest.mark.parametrize("number", [3.0, 5.0])
@pytest.mark.parametrize("time_step", [0.5, 2.0])
@pytest.mark.filterwarnings("always")
def test_a_given_step_is_accurate_or_complained_of(standing_scene: MakeScene, number: float, time_step: float) -> None:
    """However long: a result that misses rtol must not come without a word."""
    scene = standing_scene(number, grid={"time_step": time_step})
    wrong, words = math.inf, ""
    with warnings.catch_warnings(record=True) as caught:
        try:
            run = solve(scene)
            wrong = error(run, exact.Solution(scene, 2.0).distribution(run["x"].values, run["v"].values))
        except (SceneError, SolverStopped) as stop:
            words = str(stop)
    words += " ".join(str(warning.message) for warning in caught)
    assert wrong <= scene.accuracy.rtol or "time_step" in words, (wrong, words)


@pytest.mark.parametrize("operator", [FOLLOW, None], ids=["(6)", "none"])
def test_hermite_output_is_point_values_and_their_moments(make_scene: MakeScene, operator: dict[str, Any] | None) -> None:
    scene = make_scene(collisions=operator, grid=HERMITE[0], accuracy={"rtol": 1e-6}, **CHANGES)
    whole = make_plan(scene).whole
    run = solve(scene.replace(**{"output.nx": whole.nx, "output.nv": whole.nv}))
    x, v = run["x"].values, run["v"].values
    assert np.diff(v) == pytest.approx(np.full(v.size - 1, v[1] - v[0]))
    for frame, time in enumerate((0.0, 0.8)):
        state, f = exact.Solution(scene, time), run["f"].values[frame]
        truth = state.distribution(x, v)
        assert np.abs(f - truth).max() < 1e-6 * truth.max()
        moments = state.moments(x)
        for key, expected in zip(("density", "mean_velocity", "temperature", "heat_flux"), moments, strict=True):
            assert run[key].values[frame] == pytest.approx(expected, abs=1e-5), key
        dx, dv = scene.pipe.length / x.size, v[1] - v[0]
        assert run["density"].values[frame] == pytest.approx(f.sum(axis=1) * dv, rel=1e-12)
        assert run["velocity_distribution"].values[frame] == pytest.approx(f.sum(axis=0) * dx, rel=1e-12, abs=1e-15)
        mass, momentum, energy = (float(run[key][frame]) for key in ("mass", "momentum", "energy"))
        rho, u, theta, _ = moments
        assert mass == pytest.approx(0.8 * 9.0, rel=1e-6)
        assert momentum == pytest.approx((rho * u).sum() * dx, rel=1e-5)
        assert energy == pytest.approx((rho * (u**2 + theta)).sum() * dx / 2, rel=1e-5)
