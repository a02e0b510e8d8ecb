"""Observed orders in dv of the drift-diffusion substeps, against the exact Ornstein-Uhlenbeck solution."""

from __future__ import annotations

import numpy as np

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Model
from kinetic_solver.velocity import FiniteVolume, OrnsteinUhlenbeckKernel
from kinetic_solver.velocity.ornstein_uhlenbeck import transition

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


def test_the_kernel_is_exact_once_resolved() -> None:
    assert error(OrnsteinUhlenbeckKernel, 96, 0.5) < 1e-13
    assert error(OrnsteinUhlenbeckKernel, 96, 50.0) < 1e-13
