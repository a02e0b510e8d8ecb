"""The Langevin step: its coefficients against integrals of the equation, its limits, and samples of it."""

from __future__ import annotations

import math
from dataclasses import astuple
from decimal import Decimal, localcontext

import numba
import numpy as np
import pytest
from scipy.integrate import quad

from kinetic_solver.scene import Model
from particles.langevin import LangevinStep, _excess, _fall, advance, wrapped
from particles.random import LANGEVIN, VELOCITIES, key, standard_normals

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)


@pytest.mark.parametrize("tau", [1e-10, 1e-9, 1e-4, 0.03, 0.4, 0.5, 0.51, 0.99, 1.01, 3.0, 40.0, 50.0])
def test_coefficients_are_the_integrals(tau: float) -> None:
    """x's response (1 - exp(-γt))/γ to a kick at t before the end; variances and covariance are integrals over the kicks."""
    g, gamma, sigma = MODEL.gravity, MODEL.friction, MODEL.noise
    h = tau / gamma
    step = LangevinStep.over(MODEL, h)

    def integral(kernel) -> float:  # type: ignore[no-untyped-def]
        return h * quad(lambda u: kernel(h * u), 0, 1, epsabs=0, epsrel=1e-12, limit=200)[0]

    def response(t: float) -> float:
        return -math.expm1(-gamma * t) / gamma

    diffusion = 2 * sigma * gamma
    vv = diffusion * integral(lambda t: math.exp(-2 * gamma * t))
    xv = diffusion * integral(lambda t: math.exp(-gamma * t) * response(t))
    xx = diffusion * integral(lambda t: response(t) ** 2)
    assert step.v_noise**2 == pytest.approx(vv, rel=1e-11, abs=0)
    assert step.x_noise_of_v * step.v_noise == pytest.approx(xv, rel=1e-11, abs=0)
    assert step.x_noise_of_v**2 + step.x_noise**2 == pytest.approx(xx, rel=1e-11, abs=0)
    assert step.x_velocity == pytest.approx(response(h), rel=1e-13, abs=0)
    assert step.v_velocity == pytest.approx(math.exp(-tau), rel=1e-15, abs=2.3e-16)  # to round-off of one, which is v's
    assert step.v_constant == pytest.approx(g * response(h), rel=1e-13, abs=0)
    assert step.x_constant == pytest.approx(g * integral(response), rel=1e-11, abs=0)


@pytest.mark.parametrize("tau", [1e-10, 1e-6, 1e-3, 0.1])
def test_short_steps_keep_x_noise_of_its_own(tau: float) -> None:
    """x given v, where variance and covariance squared agree to five digits: 2σγ h³/12 (1 - τ²/10 + 17 τ⁴/1680 - …)."""
    h = tau / MODEL.friction
    expected = 2 * MODEL.noise * MODEL.friction * h**3 / 12 * (1 - tau**2 / 10 + 17 * tau**4 / 1680)
    assert LangevinStep.over(MODEL, h).x_noise ** 2 == pytest.approx(expected, rel=1e-14 + tau**6 / 500, abs=0)


@pytest.mark.parametrize("h", [1e-6, 1e-3, 0.5, 4.0])
def test_two_steps_are_one(h: float) -> None:
    """Means and covariances compose."""
    one, two = LangevinStep.over(MODEL, h), LangevinStep.over(MODEL, 2 * h)
    drift = np.array([[1, one.x_velocity], [0, one.v_velocity]])
    noise = np.array([[one.x_noise_of_v, one.x_noise], [one.v_noise, 0]])
    constant = np.array([one.x_constant, one.v_constant])
    covariance = drift @ noise @ noise.T @ drift.T + noise @ noise.T
    expected = np.array([[two.x_noise_of_v, two.x_noise], [two.v_noise, 0]])
    assert covariance == pytest.approx(expected @ expected.T, rel=1e-12, abs=0)
    assert drift @ drift == pytest.approx(np.array([[1, two.x_velocity], [0, two.v_velocity]]), rel=1e-13, abs=0)
    assert drift @ constant + constant == pytest.approx([two.x_constant, two.v_constant], rel=1e-13, abs=0)


def test_free_fall_and_friction_alone() -> None:
    fall = LangevinStep.over(Model(gravity=1.3, friction=0.0, noise=0.5), 2.0)
    assert astuple(fall) == pytest.approx((2.0, 2.6, 0.0, 0.0, 1.0, 2.6, 0.0), rel=1e-15, abs=0)
    for gravity in (0.0, 1.3):
        x, v, k = np.array([0.25, 6.5]), np.array([0.4, -1.7]), key(3, 1)
        drag = LangevinStep.over(Model(gravity=gravity, friction=0.7, noise=0.0), 2.0)
        assert drag.v_noise == drag.x_noise == 0.0
        advance(x, v, 9.0, astuple(drag), np.uint64(4), k[0], k[1])
        m, e = gravity / 0.7, math.exp(-1.4)
        assert v == pytest.approx(m + (np.array([0.4, -1.7]) - m) * e, rel=1e-14, abs=0)
        assert x == pytest.approx(np.array([0.25, 6.5]) + m * 2 + (np.array([0.4, -1.7]) - m) * (1 - e) / 0.7, rel=1e-14, abs=0)


def test_samples_against_a_slow_twin_and_the_moments() -> None:
    count, length, h, number = 100_000, 1e6, 0.9, 4
    step, k = LangevinStep.over(MODEL, h), key(3, 1)
    x, v = np.full(count, 5e5), np.full(count, 0.4)
    advance(x, v, length, astuple(step), np.uint64(number), k[0], k[1])
    n = np.empty((count, 2))
    standard_normals(n, LANGEVIN, np.uint64(number), k[0], k[1])
    slow_x = 5e5 + step.x_velocity * 0.4 + step.x_constant + step.x_noise_of_v * n[:, 0] + step.x_noise * n[:, 1]
    slow_v = step.v_velocity * 0.4 + step.v_constant + step.v_noise * n[:, 0]
    assert np.abs(x - slow_x).max() < 1e-9
    assert np.abs(v - slow_v).max() < 1e-14
    e = math.exp(-0.7 * h)
    covariance = np.cov(x - 5e5, v)
    xx = 0.5 / 0.49 * (2 * 0.7 * h - 3 + 4 * e - e * e)
    expected = np.array([[xx, 0.5 / 0.7 * (1 - e) ** 2], [0.5 / 0.7 * (1 - e) ** 2, 0.5 * (1 - e * e)]])
    # The standard error of a covariance of Gaussians.
    error = np.sqrt((expected**2 + np.outer(np.diag(expected), np.diag(expected))) / count)
    assert (np.abs(covariance - expected) < 4 * error).all()


def test_samples_of_a_gaussian_start() -> None:
    """x and v with a covariance of their own, 200 000 particles, two unequal steps: mean and covariance evolve exactly."""
    count, k = 200_000, key(11, 2)
    covariance, mean = np.array([[0.8, 0.3], [0.3, 0.45]]), np.array([5e3, -0.6])
    normals = np.empty((count, 2))
    standard_normals(normals, VELOCITIES, np.uint64(0), k[0], k[1])
    x, v = (mean + normals @ np.linalg.cholesky(covariance).T).T.copy()
    for number, h in enumerate((0.35, 1.1)):
        advance(x, v, 1e4, astuple(LangevinStep.over(MODEL, h)), np.uint64(number), k[0], k[1])
    g, gamma, sigma, h = MODEL.gravity, MODEL.friction, MODEL.noise, 0.35 + 1.1
    e, m = math.exp(-gamma * h), g / gamma
    drift = np.array([[1, (1 - e) / gamma], [0, e]])
    xx, xv = sigma / gamma**2 * (2 * gamma * h - 3 + 4 * e - e * e), sigma / gamma * (1 - e) ** 2
    covariance = drift @ covariance @ drift.T + np.array([[xx, xv], [xv, sigma * (1 - e * e)]])
    mean = drift @ (mean - [0, m]) + [m * h, m]
    variance = np.diag(covariance)
    assert (np.abs([x.mean() - mean[0], v.mean() - mean[1]]) < 4 * np.sqrt(variance / count)).all()
    assert (np.abs(np.cov(x, v) - covariance) < 4 * np.sqrt((covariance**2 + np.outer(variance, variance)) / count)).all()


@pytest.mark.parametrize("h", [0.9, 30.0])
def test_the_same_bits_at_any_number_of_threads(h: float) -> None:
    """And, around the pipe once or a hundred times, the slow twin's place in it."""
    count, length, k, step = 10_001, 0.7, key(3, 1), LangevinStep.over(MODEL, h)
    rng, n, found = np.random.default_rng(4), np.empty((10_001, 2)), []
    x0, v0 = rng.uniform(0, length, count), rng.normal(0.4, 1.6, count)
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            x, v = x0.copy(), v0.copy()
            advance(x, v, length, astuple(step), np.uint64(6), k[0], k[1])
            found.append((x, v))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    assert x.min() >= 0
    assert x.max() < length
    standard_normals(n, LANGEVIN, np.uint64(6), k[0], k[1])
    slow = x0 + step.x_velocity * v0 + step.x_constant + step.x_noise_of_v * n[:, 0] + step.x_noise * n[:, 1]
    assert np.abs(slow / length).max() > (2 if h < 1 else 70)
    assert np.abs((x - slow + length / 2) % length - length / 2).max() < 1e-12


def test_the_pipe_is_periodic() -> None:
    for x in (-1e-18, -0.3, 2.5, 7.49, 1e9, -1e9, 2.5 - 1e-16):
        place = wrapped.py_func(x, 2.5)
        assert 0 <= place < 2.5
        assert abs(np.exp(2j * np.pi * (place - x) / 2.5) - 1) < 1e-6


def test_places_next_to_whole_periods() -> None:
    """x/length may round up to a whole number from below: the place is in [0, length) all the same."""
    rng = np.random.default_rng(6)
    for length in rng.uniform(0.5, 9, 2000):
        for periods in range(1, 9):
            end = periods * length
            for x in (end, math.nextafter(end, 0), math.nextafter(end, 99), -end, -math.nextafter(end, 0)):
                place = wrapped.py_func(x, length)
                assert 0 <= place < length, (x, length)
                assert min(place, length - place) <= 2 * math.ulp(end)


@pytest.mark.parametrize("tau", [1e-300, 1e-107, 1e-20, 1e-4, 0.4999, 0.5001, 0.9999, 1.0001, 30.0, 1e120, 1e300])
def test_extreme_steps(tau: float) -> None:
    """The variance of x given v, (2σ/γ²)(γh - 2 tanh(γh/2)), and the fall in gravity: by series, in decimals, by their limits."""
    t = Decimal(tau)
    with localcontext() as context:
        context.prec = 60
        if tau < 1e-2:
            excess, fall = Decimal(1) / 12 - t * t / 120, Decimal(1) / 2 - t / 6 + t * t / 24 - t**3 / 120
        elif tau < 100:
            decayed = (-t).exp()
            excess, fall = (t - 2 * (1 - decayed) / (1 + decayed)) / t**3, (t - 1 + decayed) / t**2
        else:
            excess, fall = (1 - 2 / t) / t / t, (1 - 1 / t) / t
    assert _excess(tau) == pytest.approx(float(excess), rel=1e-13)
    assert _fall(tau) == pytest.approx(float(fall), rel=1e-13)
