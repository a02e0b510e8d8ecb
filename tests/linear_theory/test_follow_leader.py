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
