"""The flux: its slow twin, orders, conservation, and positivity for any state."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.closure import conserved, primitive
from kinetic_solver.hydrodynamics.weno import SMOOTH, divergence, weno5


def rate(state: Array, alpha: float, share: float = 0.8) -> Array:
    out = np.empty_like(state)
    divergence(state, alpha, share, np.empty((2, *state.shape)), np.empty_like(state), out)
    return out


def flux(state: Array) -> Array:
    rho, u, theta = primitive(state)
    return np.stack([rho * u, rho * (u**2 + theta), 0.5 * rho * u**3 + 1.5 * rho * u * theta])


def fastest(state: Array) -> float:
    _, u, theta = primitive(state)
    return float((np.abs(u) + np.sqrt(3 * theta)).max())


def smooth_state(n: int) -> Array:
    x = 2 * np.pi * np.arange(n) / n
    return conserved(1 + 0.3 * np.sin(x), 0.4 + 0.2 * np.cos(2 * x), 0.7 + 0.1 * np.cos(x))


def twin(state: Array, alpha: float) -> Array:
    """The same by NumPy, matrices of eigenvectors solved for numerically; without the limiter."""

    def weno(cells: Array, least: float) -> float:
        polynomials = np.array([[2, -7, 11, 0, 0], [0, -1, 5, 2, 0], [0, 0, 2, 5, -1]]) / 6
        second = np.array([[1, -2, 1, 0, 0], [0, 1, -2, 1, 0], [0, 0, 1, -2, 1]])
        first = np.array([[1, -4, 3, 0, 0], [0, 1, 0, -1, 0], [0, 0, 3, -4, 1]]) / 2
        beta = 13 / 12 * (second @ cells) ** 2 + (first @ cells) ** 2
        weight = np.array([0.1, 0.6, 0.3]) * (1 + ((beta[0] - beta[2]) / (beta + least)) ** 2)
        return float(weight @ (polynomials @ cells) / weight.sum())

    n = state.shape[1]
    f = flux(state)
    faces = np.empty_like(state)
    for i in range(n):
        at = 0.5 * (state[:, i] + state[:, (i + 1) % n])
        rho, u, theta = primitive(at[:, None])[:, 0]
        c = np.sqrt(3 * theta)
        speeds = np.array([u - c, u, u + c])
        right = np.array([np.ones(3), speeds, 0.5 * speeds**2])
        total = np.zeros(3)
        for sign, places in ((1, np.arange(i - 2, i + 3)), (-1, np.arange(i + 3, i - 2, -1))):
            split = (state + sign * f / alpha)[:, places % n]
            waves = np.linalg.solve(right, split)
            total += sign * alpha / 2 * right @ np.array([weno(wave, (SMOOTH * rho) ** 2) for wave in waves])
        faces[:, i] = total
    return np.roll(faces, 1, axis=1) - faces


def test_agrees_with_its_slow_twin() -> None:
    rng = np.random.default_rng(3)
    state = conserved(1 + 0.3 * rng.random(17), rng.normal(0, 0.2, 17), 0.8 + 0.2 * rng.random(17))
    alpha = 1.1 * fastest(state)
    assert np.abs(rate(state, alpha, 0.3) - twin(state, alpha)).max() < 1e-12


def test_the_eigenvectors_are_those_of_adiabatic_index_three() -> None:
    """dF along (1, λ, λ²/2) is λ times it, by differences: what makes the three waves of the flux separate."""
    state = conserved(np.array([1.3]), np.array([0.4]), np.array([0.6]))
    for speed in (0.4 - np.sqrt(1.8), 0.4, 0.4 + np.sqrt(1.8)):
        vector = np.array([1.0, speed, 0.5 * speed**2])[:, None]
        change = (flux(state + 1e-6 * vector) - flux(state - 1e-6 * vector)) / 2e-6
        assert np.abs(change - speed * vector).max() < 1e-8


def test_reconstruction_is_of_order_five() -> None:
    errors = []
    for h in (0.1, 0.05, 0.025):
        edges = 0.8 + h * np.arange(-2, 4)
        means = -np.diff(np.cos(edges)) / h
        errors.append(abs(weno5(*means, 1e-40) - np.sin(edges[3])))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ((orders > 4.6) & (orders < 5.4)).all(), orders


def test_flux_differences_are_of_order_five() -> None:
    """At points, not in means over cells, with smooth extrema in every field."""
    errors = []
    for n in (128, 256, 512):
        state = smooth_state(n)
        ik = 1j * np.fft.rfftfreq(1024, 1 / 1024)
        exact = -np.fft.irfft(ik * np.fft.rfft(flux(smooth_state(1024)), axis=1), axis=1)[:, :: 1024 // n]
        errors.append(np.abs(rate(state, fastest(state)) * n / (2 * np.pi) - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ((orders > 4.6) & (orders < 5.4)).all(), orders


def test_uniform_states_do_not_change() -> None:
    state = conserved(np.full(9, 0.7), np.full(9, -0.3), np.full(9, 0.45))
    assert (rate(state, 2.0) == 0).all()


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.5, 0.99]), st.floats(1e-8, 1.0))
def test_an_euler_step_keeps_density_and_temperature_positive(seed: int, share: float, least: float) -> None:
    """From states with jumps of every kind, densities and temperatures down to 1e-8 of their largest; conserves to rounding."""
    rng = np.random.default_rng(seed)
    rho, theta = (np.where(rng.random(24) < 0.5, 1.0, least) * (0.5 + rng.random(24)) for _ in range(2))
    state = conserved(rho, rng.normal(0, 3, 24), theta)
    alpha = fastest(state)
    new = state + share / alpha * rate(state, alpha, share)
    rho, _, theta = primitive(new)
    assert (rho > 0).all()
    assert (theta > 0).all()
    assert np.abs(new.sum(axis=1) - state.sum(axis=1)).max() < 1e-13 * np.abs(state).sum(axis=1).max()


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_the_limiter_leaves_resolved_flow_alone(share: float) -> None:
    state = smooth_state(48)
    alpha = fastest(state)
    assert (rate(state, alpha, share) == rate(state, alpha, 1e-3)).all()
