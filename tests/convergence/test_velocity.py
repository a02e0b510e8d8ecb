"""Observed orders in dv of the drift-diffusion substeps, against the exact Ornstein-Uhlenbeck solution."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.velocity import FiniteVolume, HighOrderFiniteVolume, OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)


def error(scheme: type, nv: int, h: float) -> float:
    grid = PhaseSpaceGrid(1, nv, 1.0, -8.0, 10.0)
    mean, variance = 0.3, 0.8
    step = transition(MODEL, h)

    def gaussian(m: float, s: float) -> np.ndarray:
        return np.exp(-((grid.v - m) ** 2) / (2 * s)) / np.sqrt(2 * np.pi * s)

    after = scheme(grid, MODEL).matrix(h) @ gaussian(mean, variance)
    expected = gaussian(step.velocity_shift + step.decay * mean, step.decay**2 * variance + step.velocity_variance)
    return float(np.abs(after - expected).max() / expected.max())


def test_finite_volumes_are_second_order() -> None:
    errors = [error(FiniteVolume, nv, 0.5) for nv in (96, 192, 384)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.95) & (orders < 2.05)), (errors, orders)


@pytest.mark.parametrize("h", [1e-3 / MODEL.friction, 0.5, 3.0])
def test_high_order_finite_volumes_are_eighth_order(h: float) -> None:
    """The shortest step is one whose Gaussian kernel dv does not resolve."""
    counts = (108, 162, 243)
    assert OrnsteinUhlenbeckKernel(PhaseSpaceGrid(1, 243, 1.0, -8.0, 10.0), MODEL).positive(h) == (h > 0.1)
    errors = [error(HighOrderFiniteVolume, nv, h) for nv in counts]
    orders = np.log(np.divide(errors[:-1], errors[1:])) / np.log(1.5)
    assert np.all((orders > 7.8) & (orders < 8.4)), (errors, orders)
    assert errors[-1] < 2e-9


@pytest.mark.parametrize("amplification", [2.0, 5.0])
@pytest.mark.parametrize("h", [0.005, 0.05, 0.5, 2.0])
def test_high_order_is_accurate_relative_to_f_in_the_tail(amplification: float, h: float) -> None:
    """M exp(-R w), w = (v - m)/√σ, as the follow-the-leader operator makes it: error over f itself, down to w = -8.

    dv = 0.17 √σ. The second-order scheme is wrong by up to 0.3 there after long steps, this one by 2e-4.
    """
    mean, sigma = MODEL.gravity / MODEL.friction, MODEL.noise
    grid = PhaseSpaceGrid(1, 128, 1.0, mean - 14 * np.sqrt(sigma), mean + 8 * np.sqrt(sigma))
    w = (grid.v - mean) / np.sqrt(sigma)
    seen = (w > -8) & (w < 2)
    start = np.exp(-((w + amplification) ** 2) / 2)
    expected = np.exp(-((w + amplification * transition(MODEL, h).decay) ** 2) / 2)

    def relative(scheme: type) -> float:
        after = scheme(grid, MODEL).matrix(h) @ start
        return float(np.abs(after[seen] / expected[seen] - 1).max())

    assert expected[seen].min() < 1e-6
    assert relative(HighOrderFiniteVolume) < min(5e-4, relative(FiniteVolume) / 100)


def test_the_kernel_is_exact_once_resolved() -> None:
    assert error(OrnsteinUhlenbeckKernel, 96, 0.5) < 1e-13
    assert error(OrnsteinUhlenbeckKernel, 96, 50.0) < 1e-13
