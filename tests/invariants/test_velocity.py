"""Drift-diffusion substeps: mass, equilibrium, mean, positivity, at any step."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.velocity import Expansion, FiniteVolume, HighOrderFiniteVolume, OrnsteinUhlenbeckKernel
from kinetic_solver.operators.velocity.kernel import resolved_spacing
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import excess_displacement, half_transport_time, transition

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


@pytest.mark.parametrize("scheme", [FiniteVolume, HighOrderFiniteVolume])
def test_finite_volumes_refuse_a_model_without_noise(scheme: type) -> None:
    with pytest.raises(ValueError, match="noise"):
        scheme(GRID, Model(friction=1.0, noise=0.0))


@pytest.mark.parametrize("h", [1e-3 / MODEL.friction, 0.05, 0.5, 2.0, 1e3 / MODEL.friction])
@pytest.mark.parametrize("window", [(-4.0, 7.5), (-8.0, 7.5), (-30.0, 7.5)])
def test_high_order_equilibrium_and_mass_over_many_steps(window: tuple[float, float], h: float) -> None:
    """Relative to the Maxwellian itself, to the window's edges; where M underflows (45 √σ away) it is 0 and stays so."""
    grid = PhaseSpaceGrid(1, 96, 1.0, *window)
    matrix = HighOrderFiniteVolume(grid, MODEL).matrix(h)
    equilibrium = maxwellian(grid.v, MODEL.gravity / MODEL.friction, MODEL.noise)
    assert np.abs(matrix.sum(axis=0) - 1).max() < 10 * EPS
    f, start = equilibrium.copy(), np.exp(-((grid.v - 0.4) ** 2))
    moving = start.copy()
    for _ in range(500):
        f, moving = matrix @ f, matrix @ moving
    seen = equilibrium > 1e-280
    assert np.abs(f[seen] / equilibrium[seen] - 1).max() < 2000 * EPS
    assert np.all(np.abs(f[~seen]) < 1e-270)
    assert moving.sum() == pytest.approx(start.sum(), rel=500 * EPS)


@pytest.mark.parametrize("window", [(-4.0, 7.5), (-8.0, 11.0)])
def test_high_order_generator_is_symmetric_and_dissipative_in_the_weight_one_over_m(window: tuple[float, float]) -> None:
    grid = PhaseSpaceGrid(1, 96, 1.0, *window)
    generator = HighOrderFiniteVolume(grid, MODEL).generator().toarray()
    root = np.sqrt(maxwellian(grid.v, MODEL.gravity / MODEL.friction, MODEL.noise))
    symmetric = generator * root[None, :] / root[:, None]
    scale = np.abs(symmetric).max()
    assert np.abs(generator.sum(axis=0)).max() < 20 * EPS * np.abs(generator).max()
    assert np.abs(symmetric - symmetric.T).max() < 100 * EPS * scale
    eigenvalues = np.linalg.eigvalsh(symmetric)
    assert eigenvalues.max() < 100 * EPS * scale
    # The Ornstein-Uhlenbeck process has the eigenvalues 0, -γ, -2γ, …
    assert eigenvalues[::-1][:5] == pytest.approx(-MODEL.friction * np.arange(5), abs=1e-4)


@pytest.mark.parametrize("grid", [GRID, PhaseSpaceGrid(1, 40, 1.0, -30.0, 30.0)])
def test_high_order_is_stable_at_any_step(grid: PhaseSpaceGrid) -> None:
    """Noise, resolved or not (dv = 2.1 √σ): Σ f²/M never grows, and 1e3/γ leaves the equilibrium alone."""
    equilibrium = maxwellian(grid.v, MODEL.gravity / MODEL.friction, MODEL.noise)
    inside = equilibrium > 1e-12
    f = np.where(inside, np.random.default_rng(7).normal(size=grid.nv), 0.0) * equilibrium
    operator = HighOrderFiniteVolume(grid, MODEL)
    after = operator.matrix(1e3 / MODEL.friction) @ f
    expected = equilibrium * f.sum() / equilibrium.sum()
    assert np.abs(after - expected).max() < 1e-12 * np.abs(f).max()
    seen = equilibrium > 1e-280
    for h in (1e-3, 0.1, 10.0):
        after = operator.matrix(h) @ f
        assert np.sum(after[seen] ** 2 / equilibrium[seen]) < np.sum(f[seen] ** 2 / equilibrium[seen])


def test_high_order_is_not_positive_but_what_dv_resolves_hardly_undershoots() -> None:
    """Measured: -0.16 of a point mass; -1e-13 and -3e-33 of Gaussians of standard deviation 2.6 and 4.5 dv."""
    grid = PhaseSpaceGrid(1, 128, 1.0, -8.0, 7.5)
    matrix = HighOrderFiniteVolume(grid, MODEL).matrix(1e-3 / MODEL.friction)
    assert -0.3 < matrix.min() < -0.05
    for variance, undershoot in ((0.1, 1e-12), (0.3, 1e-31)):
        f = maxwellian(grid.v, 1.0, variance)
        lowest = 0.0
        for _ in range(50):
            f = matrix @ f
            lowest = min(lowest, f.min() / f.max())
        assert -undershoot < lowest < 0


def test_high_order_keeps_the_mean_to_its_own_accuracy() -> None:
    h, grid = 0.5, PhaseSpaceGrid(1, 192, 1.0, -8.0, 10.0)
    f = maxwellian(grid.v, 0.3, 0.8)
    after = HighOrderFiniteVolume(grid, MODEL).matrix(h) @ f
    step = transition(MODEL, h)
    expected = step.velocity_shift + step.decay * (grid.v @ f / f.sum())
    assert 1e-10 < abs(grid.v @ after / after.sum() - expected) < 3e-8  # dv = 0.13 √σ


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


@pytest.mark.parametrize("h", [0.01, 0.3, 1.1])
def test_expansion_spreads_f_keeps_mass_and_takes_out_a_mean(h: float) -> None:
    """f(v) → f(ve^{-κh})e^{-κh}; steps compose; without x the mean is 0 afterwards, with x it grows as velocities do."""
    grid, rate = PhaseSpaceGrid(1, 190, 1.0, -14.0, 14.0), 0.6
    expansion = Expansion(grid, rate, 0.5)
    f = maxwellian(grid.v, 0.0, 0.5)
    after = expansion.matrix(h) @ f
    assert np.abs(after - maxwellian(grid.v, 0.0, 0.5 * np.exp(2 * rate * h))).max() < 2e-12
    assert np.abs(expansion.matrix(h).sum(axis=0) - 1).max() < 100 * EPS
    halves = expansion.matrix(h / 2)
    assert np.abs(halves @ (halves @ f) - after).max() < 2e-12
    off = f + 1e-10 * grid.v * f
    assert abs(grid.v @ (expansion.matrix(h) @ off)) < 1e-14
    with_x = Expansion(PhaseSpaceGrid(5, 190, 1.0, -14.0, 14.0), rate, 0.5).matrix(h)
    moved = maxwellian(grid.v, 0.4, 0.5)
    assert grid.v @ with_x @ moved == pytest.approx(np.exp(rate * h) * (grid.v @ moved), rel=1e-13)


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
