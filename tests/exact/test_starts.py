"""Starts of several beams, and of a pulse in the density: closed form, grid and quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from kinetic_solver import Scene, exact, initial, solve
from kinetic_solver.analysis.describe import describe
from kinetic_solver.exact import Solution
from kinetic_solver.plan import make_plan
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MakeScene = Callable[..., Scene]
BEAMS = {
    "beams": [
        {"share": 0.35, "mean_velocity": -1.7, "temperature": 0.2},
        {"share": 0.65, "mean_velocity": 1.4, "temperature": 0.6},
    ]
}
PULSE = {"modes": [], "pulse": {"at": 0.9, "width": 0.06, "height": 2.5}}
STARTS = {"beams": BEAMS, "pulse": PULSE, "both": {**BEAMS, **PULSE}}


def follow(cross_section: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": cross_section}


def worst(scene: Scene) -> float:
    """max|Δf|/max f over all frames, and the moments' to the same measure."""
    run = solve(scene)
    truth = exact.solve(scene, x=run["x"], v=run["v"])
    for name in ("density", "temperature", "heat_flux"):
        assert float(abs(run[name] - truth[name]).max() / abs(truth[name]).max()) < 10 * scene.accuracy.rtol, name
    return float((abs(run["f"] - truth["f"]).max(["x", "v"]) / truth["f"].max(["x", "v"])).max())


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("cross_section", [0.0, 0.6, 2.0])
def test_the_grid_against_the_closed_form(make_scene: MakeScene, start: str, cross_section: float) -> None:
    run = {"end_time": 1.0, "output_every": 0.5}
    for rtol in (1e-3, 1e-8):
        scene = make_scene(collisions=follow(cross_section), initial=STARTS[start], accuracy={"rtol": rtol}, run=run)
        assert worst(scene) <= rtol


@pytest.mark.parametrize(
    "model",
    [{"noise": 0.0}, {"friction": 0.0}, {"friction": 0.0, "gravity": 0.0, "noise": 0.0}, {"gravity": 40.0}],
    ids=["no noise", "no friction", "free", "strong gravity"],
)
@pytest.mark.parametrize("cross_section", [0.0, 0.6])
def test_in_moving_frames_and_without_noise(make_scene: MakeScene, model: dict[str, float], cross_section: float) -> None:
    scene = make_scene(
        model=model, collisions=follow(cross_section), initial=STARTS["both"], accuracy={"rtol": 1e-5}, run={"end_time": 0.8}
    )
    assert make_plan(scene).reference_frame.moving == (model.get("gravity") != 0.0)
    assert worst(scene) <= 1e-5


def test_in_hermite_functions(make_scene: MakeScene) -> None:
    """Two beams near the homogeneous state's mean velocity: their coefficients in closed form."""
    beams = [
        {"share": 0.4, "mean_velocity": 1.2, "temperature": 0.4},
        {"share": 0.6, "mean_velocity": 2.1, "temperature": 0.55},
    ]
    scene = make_scene(
        collisions=follow(0.3),
        initial={"beams": beams, **PULSE},
        grid={"velocity": "hermite"},
        accuracy={"rtol": 1e-6},
        run={"end_time": 0.7},
    )
    assert worst(scene) <= 1e-6


@pytest.mark.parametrize("cross_section", [0.0, 0.9])
def test_the_closed_form_against_quadrature(make_scene: MakeScene, cross_section: float) -> None:
    """F by sums over every starting place and velocity; E from its period: E(x + L) = E(x) exp(Sρ̄L) and E_x = S∫F dv."""
    scene, time = make_scene(collisions=follow(cross_section), initial=STARTS["both"]), 0.9
    length, s, k = scene.pipe.length, scene.cross_section, transition(scene.model, time)
    y = length * np.arange(-600, 900) / 300
    w = np.linspace(-5.0, 6.5, 700)
    weight = initial.distribution(scene, y, w) * np.exp(s * initial.density_integral(scene, y))[:, None]
    weight *= (y[1] - y[0]) * (w[1] - w[0])
    centre = y[:, None] + w * k.drift_time + k.displacement_shift

    def of_places(x: float) -> np.ndarray:
        """What arrives at x from every starting place and velocity."""
        near = np.exp(-((x - centre) ** 2) / (2 * k.displacement_variance))
        return np.asarray(weight * near / math.sqrt(2 * math.pi * k.displacement_variance))

    points, nx = np.array([0.8, 4.1, 7.9]), 60
    v = np.array([-1.1, 0.3, 1.9])
    variance = k.velocity_variance - k.covariance**2 / k.displacement_variance
    for x in points:
        arriving = of_places(x)
        mean = w * k.decay + k.velocity_shift + k.covariance / k.displacement_variance * (x - centre)
        found = [float((arriving * np.exp(-((u - mean) ** 2) / (2 * variance))).sum()) for u in v]
        found = np.array(found) / math.sqrt(2 * math.pi * variance)
        if s:
            growth = s * scene.initial.density
            # E = exp(Sρ̄x) times what is periodic, so ∫F dv is as well: a trapezoidal sum over one period.
            places = x + length * np.arange(nx) / nx
            periodic = np.array([of_places(p).sum() * math.exp(-growth * (p - x)) for p in places])
            # ∫_x^{x+L} exp(Sρ̄(x' - x)) P(x') dx', P's Fourier sum term by term.
            q = 2j * np.pi * np.fft.fftfreq(nx, length / nx)
            integral = (np.fft.fft(periodic) / nx * math.expm1(growth * length) / (growth + q)).sum().real
            found *= math.expm1(growth * length) / (s * integral)
        truth = Solution(scene, time).distribution([x], v)[0]
        assert found == pytest.approx(truth, rel=1e-8)


def test_without_noise_beams_add_up(make_scene: MakeScene) -> None:
    """Free flight: f(x, v, t) = f0(x - vt, v)."""
    scene = make_scene(model={"friction": 0.0, "gravity": 0.0, "noise": 0.0}, initial=STARTS["both"])
    x, v = np.array([0.4, 5.0]), np.array([-1.9, 0.2, 1.1])
    f = Solution(scene, 0.7).distribution(x, v)
    for i, j in np.ndindex(2, 3):
        assert f[i, j] == pytest.approx(initial.distribution(scene, x[i : i + 1] - 0.7 * v[j], v[j : j + 1])[0, 0], rel=1e-12)


@pytest.mark.parametrize("pulse", [(0.9, 0.06, 2.5), (0.0, 0.4, -0.6), (0.5, 1e-3, 400.0)])
def test_the_integral_of_a_pulse(make_scene: MakeScene, pulse: tuple[float, float, float]) -> None:
    """Against quadrature, any real y; its mean is the scene's, on any grid to round-off."""
    scene = make_scene(initial={"modes": [], "pulse": dict(zip(("at", "width", "height"), pulse, strict=True))})
    at, width, _ = pulse
    for y in (-14.3, -2.0, 1e-9, 0.4, 8.9, 9.0, 31.7):
        peaks = [9.0 * (at + m + side * width) for m in range(-3, 5) for side in (-3, 0, 3)]
        wanted = sum(
            quad(lambda z: float(initial.density(scene, z)), a, b, epsabs=1e-13, epsrel=1e-12)[0]
            for a, b in zip([min(y, 0.0), *inside(peaks, y)], [*inside(peaks, y), max(y, 0.0)], strict=True)
        )
        assert initial.density_integral(scene, y) == pytest.approx(math.copysign(wanted, y), rel=1e-11, abs=1e-13)
    for nx in (1, 3, 8, 65):
        assert initial.resolved_density(scene, 9.0 / nx * np.arange(nx)).mean() == pytest.approx(0.8, rel=1e-14)
    fine = 9.0 / 8192 * np.arange(8192)
    assert initial.resolved_density(scene, fine) == pytest.approx(initial.density(scene, fine), rel=1e-10)


def inside(places: list[float], y: float) -> list[float]:
    return sorted(p for p in places if min(y, 0.0) < p < max(y, 0.0))


def test_moments_of_beams_at_the_start(make_scene: MakeScene) -> None:
    scene = make_scene(initial=STARTS["both"])
    v = np.linspace(-9, 9, 2000)
    dv = v[1] - v[0]
    f = initial.distribution(scene, np.array([1.3]), v)[0]
    density = f.sum() * dv
    mean = (v * f).sum() * dv / density
    wanted = [density, mean, ((v - mean) ** 2 * f).sum() * dv / density, ((v - mean) ** 3 * f).sum() * dv]
    assert np.ravel(Solution(scene, 0.0).moments([1.3])) == pytest.approx(wanted, rel=1e-12)
    u, theta = initial.start_state(scene)
    assert [u, theta] == pytest.approx(wanted[1:3], rel=1e-12)


def test_rules_see_the_narrowest_beam_and_all_of_them(make_scene: MakeScene) -> None:
    plans = []
    for theta in (0.2, 0.05):
        beams = [{**BEAMS["beams"][0], "temperature": theta}, BEAMS["beams"][1]]
        plans.append(make_plan(make_scene(initial={"beams": beams}, run={"end_time": 0.1})))
    coarse, fine = (plan.grid for plan in plans)
    assert coarse.dv / fine.dv == pytest.approx(2.0, rel=0.1)
    tail = plans[0].scales.tail
    assert coarse.low <= -1.7 - tail * math.sqrt(0.2)
    assert coarse.high >= 1.4 + tail * math.sqrt(0.6)


def test_one_beam_is_the_maxwellian(make_scene: MakeScene) -> None:
    beam = {"share": 1.0, "mean_velocity": 0.3, "temperature": 0.4}
    one, other = make_scene(initial={"beams": [beam]}), make_scene(initial={"mean_velocity": 0.3, "temperature": 0.4})
    assert np.array_equal(solve(one)["f"], solve(other)["f"])


def test_a_given_nx_that_leaves_out_waves_of_a_pulse(make_scene: MakeScene) -> None:
    """Warned of, and the estimated error is about the error: what is left out."""
    scene = make_scene(initial=STARTS["pulse"], grid={"nx": 11}, run={"end_time": 0.1})
    with (
        pytest.warns(UserWarning, match=r"grid\.nx = 11: leaves out waves of the start that carry 0\.0"),
        pytest.warns(UserWarning, match=r"exceeds accuracy\.rtol = 0\.0001; it is limited by the waves in x \(grid\.nx\)"),
    ):
        run = solve(scene)
    truth = exact.solve(scene, x=run["x"], v=run["v"])
    error = float(abs(run["f"] - truth["f"]).isel(time=-1).max() / truth["f"].isel(time=-1).max())
    assert error / 8 < float(run["error_estimate"][-1]) < 8 * error
    assert run["mass"].values == pytest.approx(0.8 * 9.0, rel=1e-5)


def test_in_words(make_scene: MakeScene) -> None:
    rows = dict(dict(describe(make_scene(initial=STARTS["both"]), on_the_grid=False))["Start"])
    assert rows["beam, 0.35 of all"] == "mean velocity -1.7, temperature 0.2"
    assert rows["pulse"] == "at 0.9 L, standard deviation 0.06 L, height 2.5 times the background"
