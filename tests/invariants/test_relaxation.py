"""φ-functions by scaling and squaring, and (2) with (12) linearised about its homogeneous state on the grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.collisions import on_points
from kinetic_solver.operators.phi_functions import PhiTables
from kinetic_solver.operators.relaxation import Generators, Relaxation, drift_diffusion, quadratic_derivative
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model
from kinetic_solver.stability.inelastic import inelastic_flow

MODEL = Model(gravity=0.6, friction=0.8, noise=1.3)
LAW = Inelastic(1.7, 0.4)
DENSITY = 0.9


def generators(nx: int = 9, nv: int = 72) -> Generators:
    grid = PhaseSpaceGrid(nx, nv, 5.0, -7.5, 9.0)
    width, mean = math.sqrt(MODEL.noise), MODEL.gravity / MODEL.friction
    flow = inelastic_flow(LAW.restitution, LAW.cross_section * DENSITY * width / MODEL.friction)
    f = DENSITY * flow.distribution((grid.v - mean) / width).real / width
    return Generators(grid, MODEL, on_points(LAW, grid.v, "quintic"), f)


def by_augmented_exponential(z: Array) -> list[Array]:
    """φ_1 … φ_3 as blocks of one exponential (R. B. Sidje 1998)."""
    n = len(z)
    big = np.zeros((4 * n, 4 * n), dtype=complex)
    big[:n, :n] = z
    for block in range(3):
        big[block * n : (block + 1) * n, (block + 1) * n : (block + 2) * n] = np.eye(n)
    whole = expm(big)
    return [whole[:n, (block + 1) * n : (block + 2) * n] for block in range(3)]


@pytest.mark.parametrize("h", [1e-3, 0.37, 6.0])
def test_phi_functions(h: float) -> None:
    draw = np.random.default_rng(5)
    matrices = draw.normal(size=(3, 7, 7)) + 1j * draw.normal(size=(3, 7, 7)) - 4 * np.eye(7)
    for found, matrix in zip(np.swapaxes(PhiTables(matrices).get(h), 0, 1), matrices, strict=True):
        for ours, theirs in zip(found, by_augmented_exponential(h * matrix), strict=True):
            assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()


def test_rounding_does_not_grow_as_lengths_double() -> None:
    """A step of 2/γ, |hM| = 7e3: to 1e-12, as by another method."""
    matrix = generators(nx=1, nv=144).at_rest
    found = PhiTables(matrix[None]).get(2.5)
    for ours, theirs in zip(found, by_augmented_exponential(2.5 * matrix), strict=True):
        assert np.abs(ours[0] - theirs).max() < 1e-11 * np.abs(theirs).max()


def test_a_matrix_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        PhiTables(np.full((1, 3, 3), math.nan))
    grid = PhaseSpaceGrid(1, 24, 5.0, -7.5, 9.0)
    with pytest.raises(SolverStopped, match=r"not finite on 24 velocities .* grid\.stepping = 'extrapolated'"):
        Generators(grid, MODEL, on_points(LAW, grid.v, "quintic"), np.full(24, math.nan))


def test_tables_do_not_depend_on_what_was_asked_before() -> None:
    matrices = generators().tables.matrices
    one, other = PhiTables(matrices), PhiTables(matrices)
    for h in (0.8, 0.1, 0.1 * (1 + 1e-14), 3.2):
        one.get(h)
    for a, b in zip(one.get(0.4), other.get(0.4), strict=True):
        assert np.array_equal(a, b)


def test_mass_and_momentum_of_the_generator() -> None:
    found = generators()
    size = np.abs(found.at_rest).sum(axis=0).max()
    assert np.abs(found.at_rest.sum(axis=0)).max() < 1e-14 * size
    v = found.grid.v
    assert np.abs(v @ found.collisions).max() < 1e-13 * (np.abs(v) @ np.abs(found.collisions)).max()
    momentum = MODEL.gravity - MODEL.friction * v
    assert np.abs(v @ found.at_rest - momentum).max() < 1e-13 * np.abs(v).max() * size


def test_the_homogeneous_state_is_stationary_and_the_rest_decays() -> None:
    """But for the quadrature's error of order 6; no eigenvalue grows, and that of mass vanishes."""
    rates = []
    for nv in (72, 144):
        found = generators(nv=nv)
        relaxation, operator = Relaxation(found), on_points(LAW, found.grid.v, "quintic")
        f = np.tile(found.homogeneous, (found.grid.nx, 1))
        rate = relaxation.inverse(relaxation.whole(relaxation.forward(f), relaxation.remainder(f, operator.rate(f))))
        assert relaxation.distance(f) == 0
        rates.append(float(np.abs(rate).max() / f.max()))
    assert rates[1] < 2e-6
    assert 40 < rates[0] / rates[1] < 90
    s = np.linalg.eigvals(found.at_rest)
    assert np.sort(s.real)[-1] == pytest.approx(0, abs=1e-11)
    assert np.sort(s.real)[-2] < -0.5 * MODEL.friction


def test_the_whole_rate_is_that_of_the_equation() -> None:
    """At one x, far from the homogeneous state: what the generator misses is in the remainder."""
    found = generators(nx=1)
    relaxation, operator = Relaxation(found), on_points(LAW, found.grid.v, "quintic")
    v = found.grid.v
    f = np.exp(-((v - 1.4) ** 2) / 1.1)[None]
    whole = relaxation.whole(f, relaxation.remainder(f, operator.rate(f)))
    expected = operator.rate(f) + f @ drift_diffusion(found.grid, MODEL).T
    assert np.abs(whole - expected).max() < 1e-12 * np.abs(expected).max()
    slope, curvature = -2 * (v - 1.4) / 1.1 * f, (4 * (v - 1.4) ** 2 / 1.1**2 - 2 / 1.1) * f
    gamma = MODEL.friction
    linear = gamma * f - (MODEL.gravity - gamma * v) * slope + gamma * MODEL.noise * curvature
    assert np.abs(f @ drift_diffusion(found.grid, MODEL).T - linear).max() < 1e-9


def test_the_exponential_of_drift_and_diffusion_is_the_kernel() -> None:
    grid = generators(nx=1).grid
    f = np.exp(-((grid.v - 1.1) ** 2))
    kernel = OrnsteinUhlenbeckKernel(grid, MODEL).matrix(0.7)
    assert np.abs(expm(0.7 * drift_diffusion(grid, MODEL)) @ f - kernel @ f).max() < 1e-9


def test_the_derivative_of_a_quadratic_rate() -> None:
    found = generators(nx=1)
    operator, v = on_points(LAW, found.grid.v, "quintic"), found.grid.v
    f, change = np.exp(-((v - 0.2) ** 2) / 2), np.cos(v) * np.exp(-(v**2) / 3)
    both = (operator.rate((f + change)[None]) - operator.rate((f - change)[None]))[0] / 2
    assert np.abs(quadratic_derivative(operator, f) @ change - both).max() < 1e-13 * np.abs(both).max()
