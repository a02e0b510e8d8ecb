"""η of the local gauge against a closed form: for any two densities ρ, ρ' of equal mean, n = ρ'η has η = exp(S(Φ' - Φ)).

Errors are max|η/truth - 1|: relative to η itself at each x.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import derivative
from kinetic_solver.operators.linearised.ratio import GaugeRatio

VOID = 1 - 1e-10


def waves(grid: PhaseSpaceGrid, s: float, mode: int, amplitude: float, turn: float) -> tuple[Array, Array, Array]:
    """(ρ, n, η) for ρ = 1 + amplitude cos κx, and ρ' the same wave turned on by an angle."""
    kappa = 2 * np.pi * mode / grid.length
    rho, after = (1 + amplitude * np.cos(kappa * grid.x - angle) for angle in (0.0, turn))
    # Φ' - Φ = amplitude [sin(κx - turn) - sin κx]/κ
    eta = np.exp(-2 * s * amplitude / kappa * np.sin(turn / 2) * np.cos(kappa * grid.x - turn / 2))
    return rho, after * eta, eta


def pipe(nx: int, length: float) -> PhaseSpaceGrid:
    return PhaseSpaceGrid(nx, 8, length, -1.0, 1.0)


def error(eta: Array, truth: Array) -> float:
    return float(np.abs(eta / truth - 1).max())


def by_matrix(grid: PhaseSpaceGrid, s: float, density: Array, n: Array) -> Array:
    """The spectral derivative's nx × nx system, solved as it is."""
    matrix = derivative(np.eye(grid.nx), grid.wavenumbers) + np.diag(s * density)
    return np.asarray(np.linalg.solve(matrix, s * n))


@pytest.mark.parametrize(
    ("length", "s", "mode", "amplitude", "turn", "nx", "decades", "allowed"),
    [
        (25.0, 2.0, 1, 0.5, 0.4, 63, 1, 1e-14),
        (25.0, 2.0, 1, 0.5, 0.4, 64, 1, 1e-14),
        (25.0, 5.0, 1, 0.9, 0.8, 147, 11, 5e-14),
        (25.0, 5.0, 1, 0.9, 0.8, 3087, 11, 1e-13),
        (25.0, 5.0, 1, VOID, 0.8, 375, 13, 5e-14),
        (25.0, 5.0, 20, 0.5, 0.5, 375, 0.2, 1e-14),
        (1000.0, 5.0, 1, 0.9, 0.02, 5625, 12, 1e-12),  # SΦ spans 1400 units: round-off of the truth, too
        (1000.0, 5.0, 1, VOID, 0.02, 5625, 13, 1e-12),
        (1000.0, 5.0, 20, 0.5, 0.2, 5625, 3, 1e-13),
        (1000.0, 5.0, 1, 1e-3, 0.5, 27, 0.3, 1e-14),  # cells of 185 mean free paths
        (1000.0, 5.0, 1, 1e-3, 0.5, 28, 0.3, 1e-14),
    ],
)
def test_closed_form(
    length: float, s: float, mode: int, amplitude: float, turn: float, nx: int, decades: float, allowed: float
) -> None:
    grid = pipe(nx, length)
    rho, n, truth = waves(grid, s, mode, amplitude, turn)
    assert np.ptp(np.log10(truth)) > decades
    assert error(GaugeRatio(grid, s)(rho, n), truth) < allowed


@pytest.mark.parametrize("nx", [1, 2, 3, 4, 9])
@pytest.mark.parametrize("length", [1e-6, 25.0, 1e3])
def test_homogeneous(nx: int, length: float) -> None:
    """η = n/ρ, however thin or thick the cells."""
    assert error(GaugeRatio(pipe(nx, length), 2.0)(np.full(nx, 0.7), np.full(nx, 2.1)), np.full(nx, 3.0)) < 5e-15


def test_converges_as_x_is_resolved() -> None:
    errors = []
    for nx in (45, 63, 105, 147):
        grid = pipe(nx, 25.0)
        rho, n, truth = waves(grid, 5.0, 8, 0.9, 1.0)
        errors.append(error(GaugeRatio(grid, 5.0)(rho, n), truth))
    assert errors[0] > 1e-5
    assert errors[-1] < 1e-12
    assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize("nx", [147, 148, 735])
def test_against_the_matrix(nx: int) -> None:
    """The same where η varies little; over six decades the matrix loses what is small, and this does not."""
    grid = pipe(nx, 25.0)
    rho, n, truth = waves(grid, 5.0, 1, 0.9, 0.03)
    assert error(GaugeRatio(grid, 5.0)(rho, n), by_matrix(grid, 5.0, rho, n)) < 2e-14
    rho, n, truth = waves(grid, 5.0, 1, 0.9, 0.4)
    assert error(GaugeRatio(grid, 5.0)(rho, n), truth) < 3e-14
    assert 1e-10 < error(by_matrix(grid, 5.0, rho, n), truth) < 1e-7


def test_linear_in_n() -> None:
    grid = pipe(147, 25.0)
    rho, n, eta = waves(grid, 2.0, 1, 0.9, 0.3)
    ratio = GaugeRatio(grid, 2.0)
    assert error(ratio(rho, 1e-200 * n), 1e-200 * eta) < 5e-13  # ε·log 1e200
    assert error(ratio(rho, n + rho), eta + 1) < 1e-13


def test_memory_grows_as_nx() -> None:
    """Fewer than six numbers a point and node; the matrix would be 250 MB."""
    grid = pipe(5625, 1000.0)
    rho, n, _ = waves(grid, 2.0, 1, 0.5, 0.01)
    tracemalloc.start()
    GaugeRatio(grid, 2.0)(rho, n)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 8 * 2 * 15 * grid.nx < peak < 8 * 6 * 15 * grid.nx


def test_refusals() -> None:
    grid = pipe(27, 25.0)
    rho, n, _ = waves(grid, 2.0, 1, 0.5, 0.3)
    ratio = GaugeRatio(grid, 2.0)
    place = np.arange(grid.nx) == 3
    rough = np.exp(12 * np.random.default_rng(3).normal(size=grid.nx))  # between the points its Fourier series is negative
    bad = [(rho, np.where(place, value, n)) for value in (0.0, -1.0, np.nan, np.inf)]
    bad += [(np.where(place, value, rho), n) for value in (np.nan, 1e200)]
    for density, source in [*bad, (rho, rough), (1e4 * rho, n)]:
        with pytest.raises(LostAccuracy):
            ratio(density, source)
    assert np.isfinite(ratio(rho, n)).all()
