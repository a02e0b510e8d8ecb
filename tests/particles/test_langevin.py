"""The Langevin step: its coefficients against integrals of the equation, its limits, and samples of it."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
import pytest
from scipy.integrate import quad

from kinetic_solver.scene import Model
from particles.langevin import LangevinStep, advance, wrapped
from particles.random import LANGEVIN, key, standard_normals

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)


@pytest.mark.parametrize("tau", [1e-9, 1e-4, 0.03, 0.4, 0.99, 1.01, 3.0, 40.0])
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
    assert step.v_noise**2 == pytest.approx(vv, rel=1e-11)
    assert step.x_noise_of_v * step.v_noise == pytest.approx(xv, rel=1e-11)
    assert step.x_noise_of_v**2 + step.x_noise**2 == pytest.approx(xx, rel=1e-11)
    assert step.x_velocity == pytest.approx(response(h), rel=1e-13)
    assert step.v_velocity == pytest.approx(math.exp(-tau), rel=1e-12)
    assert step.v_constant == pytest.approx(g * response(h), rel=1e-13)
    assert step.x_constant == pytest.approx(g * integral(response), rel=1e-11)


@pytest.mark.parametrize("h", [1e-3, 0.5, 4.0])
def test_two_steps_are_one(h: float) -> None:
    """Means and covariances compose."""
    one, two = LangevinStep.over(MODEL, h), LangevinStep.over(MODEL, 2 * h)
    drift = np.array([[1, one.x_velocity], [0, one.v_velocity]])
    noise = np.array([[one.x_noise_of_v, one.x_noise], [one.v_noise, 0]])
    constant = np.array([one.x_constant, one.v_constant])
    covariance = drift @ noise @ noise.T @ drift.T + noise @ noise.T
    expected = np.array([[two.x_noise_of_v, two.x_noise], [two.v_noise, 0]])
    assert covariance == pytest.approx(expected @ expected.T, rel=1e-12)
    assert drift @ drift == pytest.approx(np.array([[1, two.x_velocity], [0, two.v_velocity]]), rel=1e-13)
    assert drift @ constant + constant == pytest.approx([two.x_constant, two.v_constant], rel=1e-13)


def test_free_fall_and_friction_alone() -> None:
    fall = LangevinStep.over(Model(gravity=1.3, friction=0.0, noise=0.5), 2.0)
    assert astuple(fall) == pytest.approx((2.0, 2.6, 0.0, 0.0, 1.0, 2.6, 0.0))
    drag = LangevinStep.over(Model(gravity=0.0, friction=0.7, noise=0.0), 2.0)
    assert (drag.v_noise, drag.x_noise, drag.x_noise_of_v) == (0.0, 0.0, pytest.approx(0.0))


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


def test_the_pipe_is_periodic() -> None:
    for x in (-1e-18, -0.3, 2.5, 7.49, 1e9, -1e9, 2.5 - 1e-16):
        place = wrapped.py_func(x, 2.5)
        assert 0 <= place < 2.5
        assert abs(np.exp(2j * np.pi * (place - x) / 2.5) - 1) < 1e-6
