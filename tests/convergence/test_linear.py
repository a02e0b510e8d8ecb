"""The linear step is exact: any interval, one step or many, against the closed form for a Maxwellian with one wave."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.transport import shift_phases
from kinetic_solver.operators.velocity import FiniteVolume, OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

T, MEAN, VARIANCE = 1.2, 0.3, 0.8


def problem(model: Model, nx: int = 15, nv: int = 200) -> tuple[PhaseSpaceGrid, np.ndarray, np.ndarray]:
    grid = PhaseSpaceGrid(nx, nv, 6.0, -7.0, 9.0)
    k = grid.wavenumbers[1]
    start = np.exp(-((grid.v - MEAN) ** 2) / (2 * VARIANCE)) / np.sqrt(2 * np.pi * VARIANCE)
    f0 = (1 + 0.5 * np.cos(k * grid.x))[:, None] * start
    s = transition(model, T)
    e, b = s.decay, s.drift_time
    mean_x, mean_v = s.displacement_shift + MEAN * b, s.velocity_shift + MEAN * e
    xx = VARIANCE * b * b + s.displacement_variance
    xv = VARIANCE * b * e + s.covariance
    vv = VARIANCE * e * e + s.velocity_variance
    phase = k * (grid.x[:, None] - mean_x - xv / vv * (grid.v - mean_v))
    wave = 1 + 0.5 * np.cos(phase) * np.exp(-k * k / 2 * (xx - xv * xv / vv))
    return grid, f0, wave * np.exp(-((grid.v - mean_v) ** 2) / (2 * vv)) / np.sqrt(2 * np.pi * vv)


@pytest.mark.parametrize(("friction", "noise"), [(0.7, 0.5), (0.0, 0.5), (0.7, 0.0), (1e-9, 0.5), (6.0, 0.9)])
@pytest.mark.parametrize("steps", [1, 7, 40])
def test_exact_over_any_interval(friction: float, noise: float, steps: int) -> None:
    model = Model(gravity=1.3, friction=friction, noise=noise)
    grid, f, expected = problem(model)
    mass = f.sum()
    step = LinearStep(grid, model, OrnsteinUhlenbeckKernel(grid, model))
    for _ in range(steps):
        f = step(f, T / steps)
    assert np.abs(f - expected).max() / expected.max() < 1e-12
    assert f.sum() == pytest.approx(mass, rel=1e-13)


def test_second_order_in_dv_with_finite_volumes() -> None:
    model = Model(gravity=1.3, friction=0.7, noise=0.5)
    errors = []
    for nv in (80, 160, 320):
        grid, f, expected = problem(model, nv=nv)
        step = LinearStep(grid, model, FiniteVolume(grid, model))
        for _ in range(6):
            f = step(f, T / 6)
        errors.append(np.abs(f - expected).max() / expected.max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.9) & (orders < 2.1)), (errors, orders)


def test_even_nx_keeps_mass_and_damps_only_the_nyquist_mode() -> None:
    model = Model(gravity=1.3, friction=0.7, noise=0.5)
    grid, f, expected = problem(model, nx=16)
    step = LinearStep(grid, model, OrnsteinUhlenbeckKernel(grid, model))
    assert np.abs(step(f, T) - expected).max() / expected.max() < 1e-12
    phases = shift_phases(grid, np.linspace(-3.0, 3.0, 7))
    assert np.abs(phases[:-1]) == pytest.approx(1.0, abs=1e-15)
    assert np.all(phases[-1].imag == 0)
    saw = f * (-1.0) ** np.arange(16)[:, None]
    assert step(saw, 0.1).sum() == pytest.approx(saw.sum(), abs=1e-10)


def test_bitwise_repeatable() -> None:
    model = Model(gravity=1.3, friction=0.7, noise=0.5)
    grid, f, _ = problem(model)
    first = LinearStep(grid, model, OrnsteinUhlenbeckKernel(grid, model))(f, 0.3)
    again = LinearStep(grid, model, OrnsteinUhlenbeckKernel(grid, model))(f, 0.3)
    assert np.array_equal(first, again)
