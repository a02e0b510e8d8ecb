"""The closed form against the equation it solves, its conservation laws, its limits, and slow twins."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from kinetic_solver import exact, initial
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

MakeScene = Callable[..., Scene]
COLLISIONS = {"operator": "follow-the-leader", "cross_section": 1.7}
OFF = {"mean_velocity": -0.4, "temperature": 0.9}
ROUGH = {
    "velocity_modes": [{"mode": 1, "sin": 0.3}, {"mode": 2, "cos": -0.1}],
    "temperature_modes": [{"mode": 1, "cos": 0.25}],
}
STARTS = {"uniform": {}, "varied": ROUGH}


def points(scene: Scene, nx: int = 48) -> np.ndarray:
    return scene.pipe.length * np.arange(nx) / nx


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("cross_section", [0.0, 1.7])
def test_it_satisfies_the_equation(make_scene: MakeScene, start: str, cross_section: float) -> None:
    """Residual of (2) with (6) by eighth-order differences in t, x and v, relative to the largest term."""
    collisions = {**COLLISIONS, "cross_section": cross_section}
    scene = make_scene(collisions=collisions, initial={**OFF, **STARTS[start]})
    m = scene.model
    first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    second = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
    h, offsets = 0.04, 0.04 * np.arange(-4, 5)
    for t, x, v in ((0.8, 1.0, 0.3), (1.2, 4.4, -0.9), (0.6, 7.7, 1.6)):
        here = exact.Solution(scene, t)
        f = float(here.distribution(x, v)[0, 0])
        rho, u, _, _ = (float(field[0]) for field in here.moments(x))
        in_t = np.array([exact.Solution(scene, t + d).distribution(x, v)[0, 0] for d in offsets])
        in_x = here.distribution(x + offsets, v)[:, 0]
        in_v = here.distribution(x, v + offsets)[0]
        drift = (m.gravity - m.friction * (v + offsets)) * in_v
        terms = [
            first @ in_t / h,
            v * (first @ in_x) / h,
            first @ drift / h,
            -m.noise * m.friction * (second @ in_v) / h**2,
            -cross_section * f * rho * (u - v),
        ]
        assert abs(sum(terms)) < 1e-8 * max(map(abs, terms))


def test_the_homogeneous_state_is_stationary(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=COLLISIONS, initial={"modes": []})
    u_h = (1.3 - 1.7 * 0.8 * 0.5) / 0.7
    rho, u, theta, q = exact.Solution(scene, 2.3).moments(points(scene, 5))
    assert rho == pytest.approx(0.8, rel=1e-14)
    assert u == pytest.approx(u_h, rel=1e-13)
    assert theta == pytest.approx(0.5, rel=1e-12)
    assert q == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize("start", STARTS)
def test_short_times_approach_the_start(make_scene: MakeScene, start: str) -> None:
    scene = make_scene(collisions=COLLISIONS, initial={**OFF, **STARTS[start]})
    x, v = points(scene, 7), np.linspace(-4, 3, 15)
    f0 = exact.Solution(scene, 0.0).distribution(x, v)
    change = [np.abs(exact.Solution(scene, t).distribution(x, v) - f0).max() for t in (2e-4, 1e-4)]
    assert change[1] < 1e-3
    assert change[0] / change[1] == pytest.approx(2, rel=1e-3)


@pytest.mark.parametrize("start", STARTS)
def test_mass_momentum_and_the_maximum_principle(make_scene: MakeScene, start: str) -> None:
    """Mass to 1e-13; dp/dt = gN - γp - S∫ρ²θ dx; for uniform u0, θ0 the density stays within its initial bounds."""
    scene = make_scene(collisions=COLLISIONS, initial={**OFF, **STARTS[start]})
    x = points(scene, 128)
    dx = scene.pipe.length / x.size
    h, first = 0.05, np.array([-1 / 60, 3 / 20, -3 / 4, 0, 3 / 4, -3 / 20, 1 / 60])
    momenta = []
    for t in 1.0 + h * np.arange(-3, 4):
        rho, u, theta, _ = exact.Solution(scene, float(t)).moments(x)
        momenta.append(float((rho * u).sum() * dx))
        assert rho.sum() * dx == pytest.approx(0.8 * 9, rel=1e-13)
        if start == "uniform":
            low, high = initial.density(scene, np.linspace(0, 9, 4001)).min(), initial.density(scene, x).max()
            assert low - 1e-6 <= rho.min() <= rho.max() <= high + 1e-3
    rho, u, theta, _ = exact.Solution(scene, 1.0).moments(x)
    expected = 1.3 * 0.8 * 9 - 0.7 * momenta[3] - 1.7 * float((rho**2 * theta).sum() * dx)
    assert first @ momenta / h == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("noise", [0.5, 0.0])
def test_varied_starts_with_no_variation_are_uniform_starts(make_scene: MakeScene, noise: float) -> None:
    zero = {"velocity_modes": [{"mode": 1, "sin": 0.0}], "temperature_modes": [{"mode": 2, "cos": 0.0}]}
    model = {"gravity": 1.3, "friction": 0.7, "noise": noise}
    x, v = points(make_scene(), 9), np.linspace(-5, 4, 21)
    plain, varied = (
        exact.Solution(make_scene(model=model, collisions=COLLISIONS, initial={**OFF, **more}), 1.1).distribution(x, v)
        for more in ({}, zero)
    )
    assert np.abs(plain - varied).max() < 1e-13 * plain.max()


def test_against_adaptive_quadrature(make_scene: MakeScene) -> None:
    """A slow twin: f and E of the docstring by scipy's quad, one point at a time."""
    scene = make_scene(collisions=COLLISIONS, initial={**OFF, **ROUGH})
    solution = exact.Solution(scene, 1.1)
    k = solution.spread
    e, b = k.decay, k.drift_time
    noise = [[k.displacement_variance, k.covariance], [k.covariance, k.velocity_variance]]

    def at(y: float) -> tuple[float, float, float]:
        return (
            float(initial.density(scene, y)),
            float(initial.mean_velocity(scene, y, -0.4)),
            float(initial.temperature(scene, y, 0.9)),
        )

    def logarithm(y: float) -> float:
        return 1.7 * float(initial.density_integral(scene, y))

    for x, v in ((2.0, 0.4), (6.5, -1.5)):

        def arriving(y: float, x: float = x, v: float = v) -> float:
            rho, u, theta = at(y)
            covariance = theta * np.array([[b * b, b * e], [b * e, e * e]]) + noise
            d = np.array([x - y - u * b - k.displacement_shift, v - k.velocity_shift - u * e])
            exponent = -d @ np.linalg.solve(covariance, d) / 2 + logarithm(y) - logarithm(x)
            return rho * math.exp(exponent) / (2 * math.pi * math.sqrt(np.linalg.det(covariance)))

        def xi(y: float, x: float = x) -> float:
            _, u, theta = at(y)
            return (x - y - u * b - k.displacement_shift) / math.sqrt(theta * b * b + k.displacement_variance)

        def normaliser(y: float) -> float:
            slope = (xi(y + 1e-4) - xi(y - 1e-4)) / 2e-4
            return math.exp(-(xi(y) ** 2) / 2 + logarithm(y) - logarithm(x)) / math.sqrt(2 * math.pi) * -slope  # noqa: B023

        top, bottom = (quad(g, x - 12, x + 12, epsabs=1e-13, limit=400)[0] for g in (arriving, normaliser))
        assert float(solution.distribution(x, v)[0, 0]) == pytest.approx(top / bottom, rel=1e-7)


@pytest.mark.parametrize("start", STARTS)
def test_moments_agree_with_sums_over_f(make_scene: MakeScene, start: str) -> None:
    scene = make_scene(collisions=COLLISIONS, initial={**OFF, **STARTS[start]})
    x, v = points(scene, 6), np.linspace(-13, 10, 300)
    solution, dv = exact.Solution(scene, 0.9), v[1] - v[0]
    f = solution.distribution(x, v)
    rho, u, theta, q = solution.moments(x)
    c = v - u[:, None]
    assert f.sum(axis=1) * dv == pytest.approx(rho, rel=1e-12)
    assert f @ v * dv == pytest.approx(rho * u, abs=1e-12)
    assert (f * c**2).sum(axis=1) * dv == pytest.approx(rho * theta, rel=1e-12)
    assert (f * c**3).sum(axis=1) * dv == pytest.approx(q, abs=1e-12)


def test_small_friction_joins_no_friction(make_scene: MakeScene) -> None:
    x, v = points(make_scene(), 5), np.linspace(-4, 5, 31)

    def at(friction: float) -> np.ndarray:
        model = {"gravity": 1.3, "friction": friction, "noise": 0.5}
        return exact.Solution(make_scene(model=model, collisions=COLLISIONS, initial=OFF), 1.0).distribution(x, v)

    f0 = at(0.0)
    far, near = np.abs(at(2e-6) - f0).max(), np.abs(at(1e-6) - f0).max()
    assert near < 1e-5
    assert far / near == pytest.approx(2, rel=1e-2)


def test_without_noise_f_follows_characteristics(make_scene: MakeScene) -> None:
    """The limit of weak noise, approached linearly."""
    x, v = points(make_scene(), 4), np.linspace(-1, 3, 21)

    def at(noise: float) -> np.ndarray:
        model = {"gravity": 1.3, "friction": 0.7, "noise": noise}
        return exact.Solution(make_scene(model=model, collisions=COLLISIONS, initial=OFF), 1.0).distribution(x, v)

    f0 = at(0.0)
    far, near = np.abs(at(2e-4) - f0).max(), np.abs(at(1e-4) - f0).max()
    assert near < 5e-3 * f0.max()
    assert far / near == pytest.approx(2, rel=1e-2)


def test_large_and_tiny_collision_numbers(make_scene: MakeScene) -> None:
    x, v = points(make_scene(), 6), np.linspace(-30, 8, 200)
    for cross_section in (20.0, 8.0):
        f = exact.Solution(make_scene(collisions={**COLLISIONS, "cross_section": cross_section}), 3.0).distribution(x, v)
        assert np.isfinite(f).all()
        assert f.min() >= 0
    tiny = exact.Solution(make_scene(collisions={**COLLISIONS, "cross_section": 1e-13}, initial=OFF), 1.0)
    none = exact.Solution(make_scene(initial=OFF), 1.0)
    assert np.abs(tiny.distribution(x, v) - none.distribution(x, v)).max() < 1e-12


def test_a_density_step(make_scene: MakeScene) -> None:
    """Mass, and the limit of no collisions against the error function."""
    step = {"density": 0.8, "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}, **OFF}
    base = make_scene(collisions=COLLISIONS).model_dump(by_alias=True, exclude_none=True)
    scene = Scene.model_validate({**base, "initial": step})
    x = points(scene, 512)
    rho, *_ = exact.Solution(scene, 1.0).moments(x)
    assert rho.mean() == pytest.approx(0.8, rel=1e-12)
    free = Scene.model_validate({**base, "initial": step, "collisions": None})
    solution = exact.Solution(free, 1.0)
    s = solution.spread
    width = math.sqrt(2 * (0.9 * s.drift_time**2 + s.displacement_variance))
    moved = -0.4 * s.drift_time + s.displacement_shift
    outer = 0.8 / (1 + 2 * 0.3)
    for point in (0.3, 2.5, 6.1):
        expected = outer
        for n in range(-3, 4):
            left, right = 9 * (n + 0.2) + moved, 9 * (n + 0.5) + moved
            expected += outer * (math.erf((point - left) / width) - math.erf((point - right) / width))
        assert float(solution.moments(point)[0][0]) == pytest.approx(expected, rel=1e-13)


def test_density_integral_and_pointwise_conventions(make_scene: MakeScene) -> None:
    scene = make_scene(initial={**OFF, **ROUGH})
    stepped = make_scene().model_dump(by_alias=True, exclude_none=True)
    stepped["initial"] = {"density": 0.8, "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}}
    for s in (scene, Scene.model_validate(stepped)):
        for a in (-11.3, -0.2, 3.3, 20.7):
            places = sorted({0.0, a, *(j for n in range(-3, 4) for j in (9 * (n + 0.2), 9 * (n + 0.5)))})
            inside = [p for p in places if min(a, 0) <= p <= max(a, 0)]
            total = sum(quad(lambda y, s=s: float(initial.density(s, y)), p, q, epsrel=1e-12)[0]
                        for p, q in itertools.pairwise(inside))  # fmt: skip
            assert float(initial.density_integral(s, a)) == pytest.approx(math.copysign(total, a), rel=1e-10)
    k = 2 * math.pi / 9
    assert float(initial.mean_velocity(scene, 2.0, 0.5)) == pytest.approx(
        0.5 + 0.3 * math.sin(2 * k) - 0.1 * math.cos(4 * k), rel=1e-14
    )
    assert float(initial.temperature(scene, 2.0, 0.5)) == pytest.approx(0.5 * (1 + 0.25 * math.cos(2 * k)), rel=1e-14)


def test_scenes_without_a_closed_form_are_refused(make_scene: MakeScene) -> None:
    inelastic = {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5}
    with pytest.raises(SceneError, match="no closed form"):
        exact.solve(make_scene(collisions=inelastic))


def test_the_dataset(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=COLLISIONS, run={"end_time": 1.0, "output_every": 0.5})
    dataset = exact.solve(scene)
    assert dict(dataset["f"].sizes) == {"time": 3, "x": 64, "v": 128}
    dv = float(dataset["v"][1] - dataset["v"][0])
    assert dataset["f"].sum("v").values * dv == pytest.approx(dataset["density"].values, rel=1e-6)
    again = exact.solve(scene, x=dataset["x"], v=dataset["v"])
    assert np.array_equal(again["v"], dataset["v"])
    assert np.array_equal(again["x"], dataset["x"])
    assert np.abs(again["f"].values - dataset["f"].values).max() < 1e-12
    with pytest.raises(ValueError, match="x: must be uniform over one period"):
        exact.solve(scene, x=[0.0, 1.0, 3.0])
    with pytest.raises(ValueError, match="v: must be uniform"):
        exact.solve(scene, v=[0.0, 1.0, 3.0])
