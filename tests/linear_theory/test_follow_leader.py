"""(6): spectrum, eigenfunctions, response and growth in closed form, against matrices and quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

from kinetic_solver.scene import Scene
from kinetic_solver.stability import eigenfunction, homogeneous_distribution, kinetic_rates, mean_velocity
from kinetic_solver.stability.closure import closure_generator
from kinetic_solver.stability.follow_leader import FollowLeaderFlow

MakeScene = Callable[..., Scene]


@pytest.mark.parametrize(("wavenumber", "number"), [(0.3, 0.7), (1.0, 1.5), (0.5, 0.0)])
def test_rates_are_eigenvalues_of_the_generator(wavenumber: float, number: float) -> None:
    s, uncertainty = FollowLeaderFlow(number).rates(wavenumber, 4)
    eigenvalues = np.linalg.eigvals(closure_generator(wavenumber, number, 60))
    for value in s:
        assert np.abs(eigenvalues - value).min() < 1e-9
    assert not uncertainty.any()


@pytest.mark.parametrize("branch", [0, 1, 4])
@pytest.mark.parametrize("operator", ["follow-the-leader", None])
def test_eigenfunctions_solve_the_linearised_equation(make_scene: MakeScene, branch: int, operator: str | None) -> None:
    """s δf + ikv δf + ∂_v[(g - γv)δf] = σγ ∂_v² δf + δC on a fine grid, derivatives spectral; unequal parameters, lab frame."""
    scene = make_scene(collisions=None if operator is None else {"operator": operator, "cross_section": 1.7})
    m, rho, cross = scene.model, scene.initial.density, scene.cross_section
    mode, count = 2, 1200
    half = 14 * math.sqrt(m.noise)
    v = mean_velocity(scene) + np.linspace(-half, half, count, endpoint=False)
    dv = v[1] - v[0]
    xi = 2j * np.pi * np.fft.fftfreq(count, dv)

    def derivative(f: np.ndarray) -> np.ndarray:
        return np.fft.ifft(xi * np.fft.fft(f))

    f, delta = rho * homogeneous_distribution(scene, v), rho * eigenfunction(scene, mode, branch, v)
    density, flux = delta.sum() * dv, (v * delta).sum() * dv
    assert density == pytest.approx(rho, rel=1e-10)
    u = float((v * f).sum() / f.sum())
    assert u == pytest.approx((m.gravity - cross * rho * m.noise) / m.friction, abs=1e-10)
    collisions = cross * (delta * rho * (u - v) + f * (flux - v * density))
    k = 2 * math.pi * mode / scene.pipe.length
    s = kinetic_rates(scene, mode, branch + 1)[0][branch]
    right = -1j * k * v * delta - derivative((m.gravity - m.friction * v) * delta)
    right += m.noise * m.friction * derivative(derivative(delta)) + collisions
    assert np.abs(s * delta - right).max() < 1e-9 * np.abs(s * delta).max()


@pytest.mark.parametrize(("wavenumber", "number"), [(1e-4, 30.0), (0.01, 1e3), (5.0, 0.0), (5.0, 1e-6), (4.0, 30.0)])
def test_eigenfunctions_at_extremes(wavenumber: float, number: float) -> None:
    """Long and short waves, many collisions and none: Σ of the terms of the equation, h in powers of w, by Gauss's quadrature."""
    flow = FollowLeaderFlow(number)
    w, weights = np.polynomial.hermite_e.hermegauss(60)
    weights = weights / math.sqrt(2 * math.pi)
    for branch, s in enumerate(flow.rates(wavenumber, 3)[0]):
        h = flow.eigenfunction(wavenumber, branch, w) / flow.distribution(w)
        # Against polynomials g: s⟨g h⟩ = ⟨(g'' - wg' - ikwg)h⟩ + R[⟨g'h⟩ + ...], C of (6) being R[M⟨wh⟩ - w(Mh + M⟨h⟩)].
        for n in range(4):
            g = np.polynomial.hermite_e.HermiteE.basis(n)
            drift = (number - w) * g.deriv()(w) + g.deriv(2)(w) - 1j * wavenumber * w * g(w)
            collisions = number * ((weights @ g(w)) * (weights @ (w * h)) - weights @ (w * g(w) * h))
            collisions -= number * (weights @ (w * g(w))) * (weights @ h)
            terms = np.array([s * (weights @ (g(w) * h)), -(weights @ (drift * h)), -collisions])
            size = np.abs(weights) @ np.abs(h) * (1 + number) * (1 + abs(s))
            assert abs(terms.sum()) < 1e-11 * size
        assert weights @ h == pytest.approx(1.0, abs=1e-11 * float(weights @ np.abs(h)))


def test_the_homogeneous_state(make_scene: MakeScene) -> None:
    """A Gaussian of variance σ about (g - Sρσ)/γ, of integral 1."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    v = np.linspace(-5.0, 6.0, 7)
    u = (1.3 - 1.7 * 0.8 * 0.5) / 0.7
    assert mean_velocity(scene) == pytest.approx(u, rel=1e-14)
    expected = np.exp(-((v - u) ** 2) / (2 * 0.5)) / math.sqrt(2 * math.pi * 0.5)
    assert homogeneous_distribution(scene, v) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(("wavenumber", "number"), [(0.25, 1.0), (1.0, 2.0), (2.0, 0.0)])
def test_density_gain(wavenumber: float, number: float) -> None:
    """⟨|φ_t|²⟩ against the density's row of exp(Gt)."""
    times = np.array([0.0, 0.1, 1.0, 3.0])
    generator = closure_generator(wavenumber, number, 80)
    rows = [float(np.sum(np.abs(expm(t * generator)[0]) ** 2)) for t in times]
    assert FollowLeaderFlow(number).density_gain(wavenumber, times) == pytest.approx(rows, rel=1e-11)


def test_the_response_is_the_exponentials_of_the_docs() -> None:
    """φ_t(w) = (R/κ) exp[ikκ(t - q)] {1 + (ik/R) exp(-κqw - (κq)²/2)} in Hermite polynomials is the density's row of exp(Gt)."""
    k, number, t = 0.8, 1.4, 1.3
    kappa, q = number + 1j * k, -math.expm1(-t)
    n = np.arange(20)
    # exp(-bw - b²/2) has the Hermite coefficients (-b)^n/√n! with ⟨φ_n ·⟩, for the generating function exp(bw - b²/2)
    b = kappa * q
    coefficients = (1j * k / number) * (-b) ** n * np.exp(0j) / np.sqrt([math.factorial(int(i)) for i in n])
    coefficients[0] += 1
    coefficients *= number / kappa * np.exp(1j * k * kappa * (t - q))
    row = expm(t * closure_generator(k, number, 80))[0][:20]
    # exp(-bw - b²/2) = Σ (-b)^n He_n(w)/n!: test against it as it stands
    assert np.abs(row - coefficients).max() < 1e-12
