"""Hermite functions: basis, moments, the closed-form propagator, and the collision operators on coefficients."""

from __future__ import annotations

import decimal
import math
from decimal import Decimal

import numpy as np
import pytest
from scipy.linalg import expm

from kinetic_solver import laws
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import maxwellian
from kinetic_solver.operators.collisions import FollowLeader, Inelastic
from kinetic_solver.operators.collisions.hermite import FollowLeaderHermite, InelasticHermite
from kinetic_solver.operators.moments import moments, totals
from kinetic_solver.operators.velocity.hermite import HermiteBasis, propagators
from kinetic_solver.scene import Model
from kinetic_solver.theory.hermite import hermite_functions

S = 1.7
CENTRE, VARIANCE = 0.4, 0.7
MODEL = Model(gravity=1.3, friction=0.9, noise=VARIANCE)


def window(nv: int, reach: float) -> np.ndarray:
    """nv cell centres within reach·√variance of the centre."""
    return CENTRE + reach * math.sqrt(VARIANCE) * (2 * (np.arange(nv) + 0.5) / nv - 1)


def coefficients(count: int) -> np.ndarray:
    """Three x: a Maxwellian, a skewed state, noise in the first modes."""
    a = HermiteBasis(CENTRE, VARIANCE, count).maxwellian(
        np.array([0.8, 1.5, 1.1]), CENTRE + np.array([0.3, -0.2, 0]), np.full(3, 0.6)
    )
    a[1, 3] += 0.2
    a[2, 1:9] += 0.1 * np.random.default_rng(3).normal(size=8)
    return a


# The basis


def test_duality() -> None:
    """∫φ_n He_m(w)/√m! dv = δ_nm, up to the highest function."""
    basis = HermiteBasis(CENTRE, VARIANCE, 40)
    v = window(400, 22)
    assert basis.coefficients(basis.values(v), v) == pytest.approx(np.eye(40), abs=1e-12)


def test_256_functions_do_not_overflow() -> None:
    """√weight He_n/√n! are orthonormal, the last of 256 too."""
    w = np.linspace(-60, 60, 2001)
    functions = hermite_functions(w, np.exp(-(w**2) / 4) / (2 * math.pi) ** 0.25, 256)
    assert functions @ functions.T * (w[1] - w[0]) == pytest.approx(np.eye(256), abs=1e-12)
    assert np.isfinite(HermiteBasis(CENTRE, VARIANCE, 256).values(CENTRE + w)).all()


def test_maxwellian_and_moments() -> None:
    """Closed-form coefficients are those of the point values; moments of coefficients are those of the points."""
    grid = PhaseSpaceGrid(3, 500, 2.4, -13.0, 14.0)
    basis = HermiteBasis(CENTRE, VARIANCE, 64)
    rho, u, theta = np.array([0.8, 1.7, 1.2]), np.array([0.9, 0.1, 0.4]), np.array([0.35, 0.7, 0.95])
    a = basis.maxwellian(rho, u, theta)
    f = maxwellian(rho, u, theta, grid.v)
    assert a[:, :20] == pytest.approx(basis.coefficients(f, grid.v)[:, :20], abs=1e-10)
    assert a @ basis.values(grid.v) == pytest.approx(f, abs=1e-9)
    assert a[2, 1:] == pytest.approx(basis.maxwellian(rho[2:], u[2:], theta[2:])[0, 1:])
    a[:, 3] += [0.1, -0.2, 0.3]
    of_points, of_modes = moments(grid, a @ basis.values(grid.v)), basis.moments(a)
    for name in ("density", "mean_velocity", "temperature", "heat_flux"):
        assert getattr(of_modes, name) == pytest.approx(getattr(of_points, name), abs=1e-12), name
    assert basis.totals(a, grid.dx) == pytest.approx(totals(grid, a @ basis.values(grid.v)), rel=1e-12)


def test_moments_without_density() -> None:
    empty = HermiteBasis(CENTRE, VARIANCE, 8).moments(np.zeros((2, 8)))
    assert np.isnan(empty.mean_velocity).all()
    assert np.isnan(empty.temperature).all()
    assert not empty.density.any()


# The propagator


def by_exponential(basis: HermiteBasis, k: float, rate: float, model: Model, h: float, larger: int) -> np.ndarray:
    """The same block of expm of the generator on `larger` functions."""
    n = np.arange(larger)
    lowers = np.diag(np.sqrt(n[1:]), 1)
    width = math.sqrt(basis.variance)
    generator = -1j * k * basis.centre * np.eye(larger) - (1j * k + rate) * width * (lowers + lowers.T)
    generator += (model.gravity - model.friction * basis.centre) / width * lowers.T - model.friction * np.diag(n)
    return expm(h * generator)[: basis.count, : basis.count]


@pytest.mark.parametrize(
    ("gamma", "h", "larger"),
    [(0.9, 0.01, 120), (0.9, 0.5, 260), (0.9, 1.7, 200), (1e-7, 0.3, 260), (0.0, 0.3, 260)],
)
def test_propagator_against_the_exponential_of_a_larger_matrix(gamma: float, h: float, larger: int) -> None:
    """k√σ/γ up to 15, R√σ/γ up to 5, about nearly the homogeneous mean velocity. expm's own error is round-off of the largest
    matrix on its way: hence the absolute part. (For a triangular matrix with close eigenvalues it is 1e-8: k = 0 is left out.)"""
    model = MODEL.model_copy(update={"friction": gamma})
    scale = 0.9 / math.sqrt(VARIANCE)
    k = scale * np.array([0.01, 0.4, 3.0, 15.0])
    for rate in (0.0, 1.1 * scale, 5 * scale):
        basis = HermiteBasis(0.3 + (MODEL.gravity - rate * VARIANCE) / MODEL.friction, VARIANCE, 40)
        for k_i, matrix in zip(k, propagators(basis, k, rate, model, h), strict=True):
            expected = by_exponential(basis, float(k_i), rate, model, h, larger)
            assert np.abs(matrix - expected).max() < 1e-13 * max(1.0, np.abs(expected).max()), (k_i, rate)


@pytest.mark.parametrize(
    ("count", "k", "rate", "x"),
    [(48, 15, 0, "0.7"), (48, 3, 5, "5"), (48, 15, 5, "0.7"), (128, 30, 2, "0.7"), (128, 30, 0, "0.1"), (128, 5, 3, "1e-3")],
)
def test_propagator_against_the_triangular_product_in_80_digits(count: int, k: int, rate: int, x: str) -> None:
    """γ = σ = 1, about the homogeneous mean velocity; x = γh. The product's sums cancel by up to 33 digits."""
    decimal.getcontext().prec = 80
    h, kappa, r = Decimal(x), Decimal(k), Decimal(rate)
    e = (-h).exp()
    q = 1 - e
    model, basis = Model(gravity=0.6, friction=1.0, noise=1.0), HermiteBasis(0.6 - rate, 1.0, count)
    matrix = propagators(basis, np.array([float(k)]), float(rate), model, float(x))[0]
    # α = -ik, β = -i(k - iR): phases, and powers of k - iR
    phase = np.exp(1j * k * (float(rate * (h - q)) - basis.centre * float(x)))
    powers = [(Decimal(1), Decimal(0))]
    for _ in range(count):
        re, im = powers[-1]
        powers.append((q * (re * kappa + im * r), q * (im * kappa - re * r)))
    factorials = [Decimal(math.factorial(n)) for n in range(count)]
    modes = sorted({0, 1, 2, count // 4, count // 2, count - 2, count - 1})
    for m in modes:
        for n in modes:
            re = im = Decimal(0)
            for j in range(min(m, n) + 1):
                term = (kappa * q) ** (m - j) * (-e) ** j / (factorials[j] * factorials[m - j] * factorials[n - j])
                re += term * powers[n - j][0]
                im += term * powers[n - j][1]
            scale = (-(kappa**2) * (h - q)).exp() * (factorials[m] * factorials[n]).sqrt()
            expected = phase * (-1j) ** (m + n) * complex(re * scale, im * scale)
            assert abs(matrix[m, n] - expected) < 1e-13 * np.abs(matrix).max(), (m, n)


def test_propagators_compose() -> None:
    """exp(h1 G) exp(h2 G) = exp((h1 + h2) G), on modes that the cut of the product does not reach."""
    small, large = HermiteBasis(CENTRE, VARIANCE, 20), HermiteBasis(CENTRE, VARIANCE, 140)
    k = np.array([0.0, 0.7, 6.0])
    for h1, h2 in ((0.05, 0.11), (0.4, 0.3), (2.0, 0.1)):
        both = propagators(large, k, 1.6, MODEL, h1) @ propagators(large, k, 1.6, MODEL, h2)
        assert both[:, :20, :20] == pytest.approx(propagators(small, k, 1.6, MODEL, h1 + h2), abs=2e-14)


def test_homogeneous_relaxation() -> None:
    """k = 0, R = 0: a Maxwellian relaxes to g/γ and σ as the Ornstein-Uhlenbeck process does; mass is kept to the bit."""
    basis, h = HermiteBasis(CENTRE, VARIANCE, 48), 0.8
    rho, u, theta = np.array([1.2]), np.array([0.1]), np.array([0.4])
    matrix = propagators(basis, np.zeros(1), 0.0, MODEL, h)[0]
    assert not matrix.imag.any()
    e, terminal = math.exp(-MODEL.friction * h), MODEL.gravity / MODEL.friction
    expected = basis.maxwellian(rho, terminal + (u - terminal) * e, VARIANCE + (theta - VARIANCE) * e**2)
    after = basis.maxwellian(rho, u, theta) @ matrix.real.T
    assert after == pytest.approx(expected, abs=1e-14)
    assert after[0, 0] == rho[0]


def test_the_basis_must_have_the_variance_of_the_noise() -> None:
    with pytest.raises(ValueError, match="variance"):
        propagators(HermiteBasis(CENTRE, 0.8, 8), np.zeros(1), 0.0, MODEL, 0.1)


# Collision operators


def test_follow_leader_is_the_operator_on_points() -> None:
    """(6) reaches one mode further than the state: with one to spare it is exact."""
    basis, v = HermiteBasis(CENTRE, VARIANCE, 40), window(400, 15)
    a = coefficients(40)
    a[:, -1] = 0
    operator = FollowLeaderHermite(basis, S)
    rate = operator.rate(a)
    assert rate @ basis.values(v) == pytest.approx(FollowLeader(v, S).rate(a @ basis.values(v)), abs=1e-13)
    assert not rate[:, 0].any()
    assert operator.conserves == FollowLeader.conserves
    m = basis.moments(a)
    assert math.sqrt(VARIANCE) * rate[:, 1] == pytest.approx(-S * m.density**2 * m.temperature)  # (8)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_inelastic_is_the_operator_on_points(restitution: float) -> None:
    """Its coefficients are those of (12) by the quintic deposit on a fine grid, for modes within 24."""
    basis, v = HermiteBasis(CENTRE, VARIANCE, 24), window(800, 11)
    a = coefficients(24)
    expected = basis.coefficients(Inelastic(v, S, restitution, "quintic").rate(a @ basis.values(v)), v)
    assert InelasticHermite(basis, S, restitution).rate(a) == pytest.approx(expected, abs=2e-9)


@pytest.mark.parametrize("count", [8, 31, 64])
def test_inelastic_conserves_and_cools(count: int) -> None:
    """Mass and momentum to the bit, whatever the state; -2S(1 - ε²)/√π ρ²θ^(3/2) on a Maxwellian, exact with 3 modes."""
    basis, epsilon = HermiteBasis(CENTRE, VARIANCE, count), 0.6
    operator = InelasticHermite(basis, S, epsilon)
    noise = np.random.default_rng(1).normal(size=(5, count))
    assert not operator.rate(noise)[:, :2].any()
    assert operator.conserves == laws.Inelastic.conserves
    rho = np.array([0.8])
    cooling = VARIANCE * math.sqrt(2) * operator.rate(basis.maxwellian(rho, np.array([CENTRE]), np.array([VARIANCE])))[0, 2]
    assert cooling == pytest.approx(-2 * S * (1 - epsilon**2) / math.sqrt(math.pi) * rho[0] ** 2 * VARIANCE**1.5, rel=1e-14)
    assert not InelasticHermite(basis, S, 1.0).rate(noise).any()


def test_energy_rate_about_another_temperature() -> None:
    """The same rate where u and θ are not the basis's: the error is what the expansion leaves out."""
    rho, u, theta, epsilon = np.array([0.8]), np.array([0.7]), np.array([0.45]), 0.3
    expected = -2 * S * (1 - epsilon**2) / math.sqrt(math.pi) * rho[0] ** 2 * theta[0] ** 1.5
    errors = []
    for count in (8, 16, 32):
        basis = HermiteBasis(CENTRE, VARIANCE, count)
        c = InelasticHermite(basis, S, epsilon).rate(basis.maxwellian(rho, u, theta))[0]
        errors.append(abs(VARIANCE * math.sqrt(2) * c[2] / expected - 1))
    assert errors[1] < 1e-2 * errors[0]
    assert errors[2] < 1e-9


def steady_state(count: int, restitution: float, cross_section: float) -> tuple[float, float]:
    """(θ, a2) of -n a_n + C_n = 0, γ = σ = ρ = 1, by Newton's method."""
    basis = HermiteBasis(0.0, 1.0, count)
    operator = InelasticHermite(basis, cross_section, restitution)
    n, unit = np.arange(count), np.eye(count)
    a = unit[0].copy()
    even = slice(2, None, 2)
    for _ in range(8):
        residual = -n * a + operator.rate(a[None])[0]
        # C is quadratic: half the difference is its exact derivative
        jacobian = -np.diag(n) + (operator.rate(a + unit) - operator.rate(a - unit)).T / 2
        a[even] -= np.linalg.solve(jacobian[even, even], residual[even])
    theta = 1 + math.sqrt(2) * a[2]
    return theta, (math.sqrt(24) * a[4] + 6 * math.sqrt(2) * a[2] + 3) / (3 * theta**2) - 1


@pytest.mark.parametrize(
    ("restitution", "theta", "a2", "errors"),
    [(0.5, 0.7332962323, 0.0199397, (5e-5, 1e-8, 2e-10)), (0.0, 0.68043451, 0.04815877, (2e-4, 5e-7, 5e-9))],
)
def test_homogeneous_steady_state(restitution: float, theta: float, a2: float, errors: tuple[float, ...]) -> None:
    """By another method than homogeneous.py: θ with 8, 16 and 24 functions, geometric convergence; a2 is known to 1e-8."""
    for count, error in zip((8, 16, 24), errors, strict=True):
        assert abs(steady_state(count, restitution, 1.0)[0] - theta) < error
    assert steady_state(32, restitution, 1.0)[1] == pytest.approx(a2, abs=1e-8)
