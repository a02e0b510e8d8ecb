"""(12): the homogeneous state, the spectrum about it and its uncertainty, against independent methods and reference values."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver.scene import Scene
from kinetic_solver.stability import eigenfunction, homogeneous_distribution, kinetic_rates
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stability.inelastic import InelasticFlow, _discretisation, inelastic_flow

MakeScene = Callable[..., Scene]
PLACES = [(0.0, 1.0), (0.5, 1.0), (0.5, 10.0), (0.9, 100.0)]


@pytest.mark.parametrize(
    ("restitution", "number", "theta", "a2"),
    [
        (0.0, 1.0, 0.680434, 0.048159),
        (0.5, 1.0, 0.733296, 0.019940),
        (0.5, 1.347, 0.679406, 0.023459),
        (0.5, 10.0, 0.299769, 0.044325),
        (0.9, 100.0, 0.181439, -0.061548),
    ],
)
def test_homogeneous_states(make_scene: MakeScene, restitution: float, number: float, theta: float, a2: float) -> None:
    flow = inelastic_flow(restitution, number)
    base = flow._base
    kurtosis = float(base.w**4 @ base.f) * base.dv / (3 * flow.temperature**2) - 1
    assert flow.temperature == pytest.approx(theta, abs=1e-6)
    assert kurtosis == pytest.approx(a2, abs=1e-6)
    collisions = {"operator": "inelastic", "cross_section": number, "restitution": restitution}
    scene = make_scene(model={"friction": 1.0, "noise": 1.0}, initial={"density": 1.0}, collisions=collisions)
    other = homogeneous_state(scene)  # velocity points and a deposit of collision products: another method
    assert other is not None
    assert flow.temperature == pytest.approx(other.temperature, rel=1e-9)
    assert kurtosis == pytest.approx(other.kurtosis_excess, abs=1e-8)


@pytest.mark.parametrize(("restitution", "number", "expected"), [(0.5, 1.0, 0.5604), (0.5, 10.0, 0.1441), (0.9, 1.0, 0.8274)])
def test_the_slow_mode_diffuses(restitution: float, number: float, expected: float) -> None:
    """-Re s/k² at k = 0.02, and for k → 0 the compressibility d(ρθ_h)/dρ."""
    flow = inelastic_flow(restitution, number)

    def rate(k: float) -> float:
        return -float(flow.rates(k, 1)[0][0].real) / k**2

    def pressure(change: float) -> float:
        return (1 + change) * inelastic_flow(restitution, number * (1 + change)).temperature

    assert rate(0.02) == pytest.approx(expected, abs=5e-5)
    h = 0.01
    slope = (8 * (pressure(h) - pressure(-h)) - (pressure(2 * h) - pressure(-2 * h))) / (12 * h)
    extrapolated = (4 * rate(0.02) - rate(0.04)) / 3
    assert extrapolated == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize(("restitution", "number"), PLACES)
@pytest.mark.parametrize("wavenumber", [0.1, 1.0])
def test_hermite_functions_have_the_same_spectrum(restitution: float, number: float, wavenumber: float) -> None:
    """A second discretisation, which shares the homogeneous state alone."""
    flow = inelastic_flow(restitution, number)
    s, _ = flow.rates(wavenumber, 3)
    other = np.linalg.eigvals(flow.equations(wavenumber).generator(wavenumber))
    for value in s:
        assert np.abs(other - value).min() < 2e-7 * (1 + abs(value))


Function = Callable[[np.ndarray], np.ndarray]


def pairs(centre: float, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faster a, slower b and weights for ∬_{a>b} (a - b) · da db: Gauss and Legendre in a - b, trapezoidal in a + b."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    r = 11 * width * (nodes + 1)[:, None]
    middle = centre + width * np.linspace(-9, 9, 121)[None, :]
    return middle + r / 2, middle - r / 2, 11 * width * weights[:, None] * r * (0.15 * width)


@pytest.mark.parametrize(("restitution", "number"), PLACES)
def test_the_linear_operator_is_the_weak_form(restitution: float, number: float) -> None:
    """∫φ δC = S∬_{a>b} [f(a)δ(b) + δ(a)f(b)] r Δφ, by quadrature for a test function and a disturbance; conservation."""
    grid = _discretisation(restitution, number, 6.0, 44.0)
    w, f, dv = grid.w, grid.f, grid.dv
    scale = math.sqrt(float(w**2 @ f) * dv)
    disturbance = f * np.sin(w / scale + 0.3)
    rate = grid.linear_collisions(f) @ disturbance
    a, b, weights = pairs(0.0, scale)
    f_a, f_b, d_a, d_b = (grid.interpolate(values, w).real for values in (f, disturbance) for w in (a, b))

    def phi(y: np.ndarray) -> np.ndarray:
        return np.cos(1.3 * y / scale + 0.2) * np.exp(-(y**2) / (8 * scale**2))

    alpha = (1 - restitution) / 2
    change = phi(b + alpha * (a - b)) + phi(a - alpha * (a - b)) - phi(a) - phi(b)
    expected = number * np.sum(weights * (f_a * d_b + d_a * f_b) * change)
    size = np.abs(rate).sum() * dv
    assert float(phi(w) @ rate) * dv == pytest.approx(expected, abs=3e-8 * size)
    assert abs(rate.sum() * dv) < 1e-12 * size
    assert abs(w @ rate * dv) < 1e-10 * scale * size


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9])
def test_the_equation_itself(make_scene: MakeScene, restitution: float) -> None:
    """In the scene's units and frame, unequal parameters: f_h is stationary and the eigenfunctions obey the linearised (2), both
    tested with functions φ(v), collisions as pairs."""
    cross, mode = 2.3, 2
    scene = make_scene(collisions={"operator": "inelastic", "cross_section": cross, "restitution": restitution})
    m, rho, k = scene.model, scene.initial.density, 2 * math.pi * mode / scene.pipe.length
    u, width = m.gravity / m.friction, math.sqrt(m.noise)
    v = u + width * np.linspace(-9, 9, 241)
    dv = v[1] - v[0]
    a, b, weights = pairs(u, 0.8 * width)
    alpha = (1 - restitution) / 2
    after = (b + alpha * (a - b), a - alpha * (a - b))
    f, f_a, f_b = (rho * homogeneous_distribution(scene, place) for place in (v, a, b))
    assert f.sum() * dv == pytest.approx(rho, rel=1e-10)
    assert v @ f * dv == pytest.approx(rho * u, rel=1e-10)
    tests: list[tuple[Function, Function, Function]] = [
        (lambda y: np.ones_like(y), lambda y: 0 * y, lambda y: 0 * y),
        (lambda y: y, lambda y: np.ones_like(y), lambda y: 0 * y),
        (lambda y: y**2, lambda y: 2 * y, lambda y: 2 * np.ones_like(y)),
        (lambda y: y**3, lambda y: 3 * y**2, lambda y: 6 * y),
        (lambda y: np.cos(2 * y), lambda y: -2 * np.sin(2 * y), lambda y: -4 * np.cos(2 * y)),
    ]
    rates = kinetic_rates(scene, mode, 3)[0]
    waves = [tuple(rho * eigenfunction(scene, mode, branch, place) for place in (v, a, b)) for branch in range(3)]
    for phi, slope, curvature in tests:
        linear = (m.gravity - m.friction * v) * slope(v) + m.noise * m.friction * curvature(v)
        change = cross * weights * (phi(after[0]) + phi(after[1]) - phi(a) - phi(b))
        assert linear @ f * dv + np.sum(change * f_a * f_b) == pytest.approx(0.0, abs=1e-9)
        for s, (wave, wave_a, wave_b) in zip(rates, waves, strict=True):
            right = (linear - 1j * k * v * phi(v)) @ wave * dv + np.sum(change * (f_a * wave_b + wave_a * f_b))
            assert s * (phi(v) @ wave) * dv == pytest.approx(right, abs=1e-8 * np.abs(wave).sum() * dv)
    assert [wave[0].sum() * dv for wave in waves] == pytest.approx([rho] * 3, rel=1e-8)


@pytest.mark.parametrize("wavenumber", [0.02, 0.5, 2.0])
def test_elastic_particles_do_not_collide(wavenumber: float) -> None:
    """ε = 1: s_n = -n - k², within the uncertainty."""
    s, uncertainty = inelastic_flow(1.0, 3.0).rates(wavenumber, 3)
    assert (np.abs(s + np.arange(3) + wavenumber**2) <= uncertainty).all()


@pytest.mark.parametrize(
    ("restitution", "number", "wavenumber"), [(0.0, 1.0, 2.0), (0.5, 0.1, 6.0), (0.9, 1.0, 6.0), (0.5, 300.0, 1.0)]
)
def test_the_uncertainty_is_honest(restitution: float, number: float, wavenumber: float) -> None:
    flow = InelasticFlow(restitution, number)
    s, uncertainty = flow.rates(wavenumber, 2)
    for points, digits in ((1.25, 44.0), (1.1, 56.0)):
        finer = _discretisation(restitution, number, points * flow._at(wavenumber).points, digits)
        other = np.linalg.eigvals(finer.generator(wavenumber))
        for value, error in zip(s, uncertainty, strict=True):
            assert np.abs(other - value).min() <= 3 * error + 1e-13


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9, 0.99])
def test_no_wave_grows(restitution: float) -> None:
    """A finding, not a theorem: docs/stability_details.md has the larger scan of benchmarks/linear_theory.py."""
    unknown = 0
    for number in (0.1, 1.0, 10.0, 100.0, 300.0):
        flow = inelastic_flow(restitution, number)
        for wavenumber in (0.02, 0.25, 1.0, 4.0, 8.0):
            s, uncertainty = flow.rates(wavenumber, 1)
            unknown += not np.isfinite(uncertainty[0])
            assert np.isinf(uncertainty[0]) or s[0].real + uncertainty[0] < 0
    assert unknown <= 1  # of nearly elastic particles, few collisions and short waves


def test_waves_beyond_resolution_are_not_guessed() -> None:
    s, uncertainty = inelastic_flow(0.5, 1.0).rates(30.0, 2)
    assert np.isnan(s).all()
    assert np.isinf(uncertainty).all()
