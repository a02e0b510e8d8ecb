"""(12): the homogeneous state, the spectrum about it and its uncertainty, against independent methods and reference values."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver.homogeneous import homogeneous_state
from kinetic_solver.scene import Scene
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
    assert flow.temperature == pytest.approx(other.temperature, rel=1e-7)


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


@pytest.mark.parametrize(("restitution", "number"), PLACES)
def test_the_linear_operator_is_the_weak_form(restitution: float, number: float) -> None:
    """∫φ δC = S∬_{a>b} [f(a)δ(b) + δ(a)f(b)] r Δφ, by plain quadrature for a test function and a disturbance; conservation."""
    grid = _discretisation(restitution, number, 6.0, 44.0)
    w, f, dv = grid.w, grid.f, grid.dv
    scale = math.sqrt(float(w**2 @ f) * dv)
    disturbance = f * np.sin(w / scale + 0.3)
    rate = grid.linear_collisions(f) @ disturbance
    a, b = w[:, None], w[None, :]
    r, alpha = np.abs(a - b), (1 - restitution) / 2
    faster, slower = np.maximum(a, b), np.minimum(a, b)

    def phi(y: np.ndarray) -> np.ndarray:
        return np.cos(1.3 * y / scale) * np.exp(-(y**2) / (8 * scale**2))

    change = phi(slower + alpha * r) + phi(faster - alpha * r) - phi(a) - phi(b)
    # Both orders of a pair are in the sum: a half; the bracket vanishes as r² at r = 0, so the trapezoidal rule is of order dv⁴.
    expected = number * np.sum(f[:, None] * disturbance[None, :] * r * change) * dv**2
    assert float(phi(w) @ rate) * dv == pytest.approx(expected, rel=3e-4, abs=1e-9 * number)
    size = np.abs(rate).sum() * dv
    assert abs(rate.sum() * dv) < 1e-12 * size
    assert abs(w @ rate * dv) < 1e-10 * scale * size


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
    """A finding, not a theorem: docs/stability.md has the larger scan of benchmarks/linear_theory.py."""
    for number in (0.1, 1.0, 10.0, 300.0):
        flow = InelasticFlow(restitution, number)
        for wavenumber in (0.02, 0.5, 2.0, 8.0):
            if flow.resolves(wavenumber):
                s, uncertainty = flow.rates(wavenumber, 1)
                assert s[0].real + uncertainty[0] < 0


def test_waves_beyond_resolution_are_not_guessed() -> None:
    s, uncertainty = inelastic_flow(0.5, 1.0).rates(30.0, 2)
    assert np.isnan(s).all()
    assert np.isinf(uncertainty).all()
