"""Drift-diffusion substeps: mass, equilibrium, mean, positivity, at any step."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Model
from kinetic_solver.velocity import FiniteVolume, OrnsteinUhlenbeckKernel
from kinetic_solver.velocity.kernel import resolved_spacing
from kinetic_solver.velocity.ornstein_uhlenbeck import excess_displacement, half_transport_time, transition

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)
GRID = PhaseSpaceGrid(1, 96, 1.0, -4.0, 7.5)
SCHEMES = [FiniteVolume, OrnsteinUhlenbeckKernel]
EPS = np.finfo(float).eps


def maxwellian(v: np.ndarray, mean: float, variance: float) -> np.ndarray:
    return np.exp(-((v - mean) ** 2) / (2 * variance)) / np.sqrt(2 * np.pi * variance)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("h", [0.05, 0.3, 1.0, 10.0, 1e4])
def test_equilibrium_mass_and_positivity(scheme: type, h: float) -> None:
    operator = scheme(GRID, MODEL)
    matrix = operator.matrix(h)
    equilibrium = maxwellian(GRID.v, MODEL.gravity / MODEL.friction, MODEL.noise)
    assert np.abs(matrix.sum(axis=0) - 1).max() < 10 * EPS
    assert np.abs(matrix @ equilibrium - equilibrium).max() < 20 * EPS * equilibrium.max()
    assert matrix.min() >= 0


@pytest.mark.parametrize("h", [1e-3, 0.05, 2.0])
def test_finite_volumes_keep_the_mean_exactly_at_any_spacing(h: float) -> None:
    """dp/dt = gN - γp holds on a grid so coarse (dv = 0.7 √σ) that nothing else is accurate."""
    coarse = PhaseSpaceGrid(1, 40, 1.0, -9.0, 11.0)
    f = maxwellian(coarse.v, 0.3, 0.8)
    after = FiniteVolume(coarse, MODEL).matrix(h) @ f
    step = transition(MODEL, h)
    mean = coarse.v @ f / f.sum()
    expected = step.velocity_shift + step.decay * mean
    assert coarse.v @ after / after.sum() == pytest.approx(expected, abs=1e-12)


def test_finite_volume_generator_has_rates_between_neighbours_only() -> None:
    generator = FiniteVolume(GRID, MODEL).generator().toarray()
    off_diagonal = generator - np.diag(np.diag(generator))
    assert off_diagonal.min() >= 0
    assert np.abs(np.triu(off_diagonal, 2)).max() == np.abs(np.tril(off_diagonal, -2)).max() == 0
    assert np.abs(generator.sum(axis=0)).max() < 100 * EPS * np.abs(generator).max()


def test_finite_volumes_refuse_a_model_without_noise() -> None:
    with pytest.raises(ValueError, match="noise"):
        FiniteVolume(GRID, Model(friction=1.0, noise=0.0))


def test_tails_are_accurate_relative_to_themselves() -> None:
    """Thirty decades below the maximum the kernel is right to 1e-9 of the value there."""
    wide = PhaseSpaceGrid(1, 256, 1.0, -12.0, 15.0)
    h, mean, variance = 0.4, 1.0, 0.5
    matrix = OrnsteinUhlenbeckKernel(wide, MODEL).matrix(h)
    step = transition(MODEL, h)
    expected = maxwellian(wide.v, step.velocity_shift + step.decay * mean, step.decay**2 * variance + step.velocity_variance)
    after = matrix @ maxwellian(wide.v, mean, variance)
    seen = (expected > 1e-30) & (np.abs(wide.v - 1.5) < 9)
    assert expected[seen].min() < 1e-25
    assert np.abs(after[seen] / expected[seen] - 1).max() < 1e-9


@pytest.mark.parametrize(("friction", "noise"), [(0.7, 0.0), (0.0, 0.5), (0.0, 0.0)])
def test_without_noise_the_kernel_moves_f_along_its_characteristics(friction: float, noise: float) -> None:
    model = Model(gravity=1.3, friction=friction, noise=noise)
    grid = PhaseSpaceGrid(1, 96, 1.0, -6.5, 8.5)
    h, mean, variance = 0.4, 0.2, 0.6
    after = OrnsteinUhlenbeckKernel(grid, model).matrix(h) @ maxwellian(grid.v, mean, variance)
    step = transition(model, h)
    expected = maxwellian(grid.v, step.velocity_shift + step.decay * mean, step.decay**2 * variance)
    assert np.abs(after - expected).max() < 1e-13
    assert after.sum() * grid.dv == pytest.approx(1.0, abs=1e-13)


def test_the_positive_kernel_is_used_where_dv_resolves_it() -> None:
    kernel = OrnsteinUhlenbeckKernel(GRID, MODEL)
    for h in (1e-3, 1e-2, 0.1, 1.0):
        assert kernel.positive(h) == (GRID.dv <= resolved_spacing(MODEL, h))
    assert not kernel.positive(1e-3)
    assert kernel.positive(1.0)


@pytest.mark.parametrize("friction", [0.0, 1e-12, 1e-6, 1e-3, 0.19, 0.21, 0.49, 0.51, 3.0])
def test_transition_statistics_at_any_friction(friction: float) -> None:
    """Against adaptive quadrature of the Langevin equation's response exp(-γt), h = 1."""
    from scipy.integrate import quad

    model = Model(gravity=1.3, friction=friction, noise=0.5)
    step = transition(model, 1.0)

    def integral(function) -> float:  # type: ignore[no-untyped-def]
        return quad(function, 0, 1, epsabs=0, epsrel=1e-13)[0]

    def drift(t: float) -> float:  # (1 - exp(-γt))/γ
        return -np.expm1(-friction * t) / friction if friction else t

    strength = 2 * 0.5 * friction
    assert step.velocity_shift == pytest.approx(1.3 * integral(lambda t: np.exp(-friction * t)), rel=1e-13)
    assert step.displacement_shift == pytest.approx(1.3 * integral(drift), rel=1e-12)
    assert step.velocity_variance == pytest.approx(strength * integral(lambda t: np.exp(-2 * friction * t)), rel=1e-12)
    assert step.covariance == pytest.approx(strength * integral(lambda t: np.exp(-friction * t) * drift(t)), rel=1e-12)
    assert step.displacement_variance == pytest.approx(strength * integral(lambda t: drift(t) ** 2), rel=1e-12)
    # h - 2τ = (1/2)∫ tanh²(γt/2) dt·2 over [0, h], an identity that has no cancellation.
    excess = integral(lambda t: np.tanh(friction * t / 2) ** 2)
    assert excess_displacement(friction, 1.0) == pytest.approx(excess, rel=1e-11)
    assert half_transport_time(friction, 1.0) == pytest.approx((1 - excess) / 2, rel=1e-13)
