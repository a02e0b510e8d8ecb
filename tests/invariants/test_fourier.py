"""Transforms along x: amplitudes of waves, derivative, antiderivative, and the buffers of the real transform."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.grid import wavenumbers
from kinetic_solver.operators.fourier import RealTransform, derivative, integral_spectrum, relative_amplitudes

LENGTH = 7.0


def waves(n: int, amplitudes: dict[int, float]) -> np.ndarray:
    x = np.arange(n) / n
    return np.asarray(sum(a * np.cos(2 * np.pi * m * x + 0.3 * m) for m, a in amplitudes.items()))


@pytest.mark.parametrize("n", [15, 16])
def test_amplitudes_relative_to_the_largest(n: int) -> None:
    """The mean counts once and a wave half, as in a real transform; over the other axis the largest is taken."""
    columns = [waves(n, {0: 2.0, 1: 0.8, 3: 0.02}), waves(n, {0: 0.5, 1: 0.1, 5: 0.4})]
    f = np.stack(columns, axis=1)
    expected = np.zeros(n // 2 + 1)
    expected[[0, 1, 3, 5]] = [1.0, 0.2, 0.005, 0.1]
    assert relative_amplitudes(f) == pytest.approx(expected, abs=1e-15)
    assert relative_amplitudes(f.T, axis=1) == pytest.approx(expected, abs=1e-15)
    assert relative_amplitudes(f.T, axis=-1) == pytest.approx(expected, abs=1e-15)
    assert relative_amplitudes(3.7 * columns[0]) == pytest.approx([1.0, 0.2, 0, 0.005, *[0] * (n // 2 - 3)], abs=1e-15)


def test_amplitudes_over_more_than_one_other_axis() -> None:
    f = np.stack([waves(9, {0: 1.0, 2: 0.6}), waves(9, {0: 1.5, 4: 0.3})])[:, None, :] * np.array([0.4, 1.0])[None, :, None]
    assert relative_amplitudes(f, axis=2) == pytest.approx([1.0, 0, 0.2, 0, 0.1], abs=1e-15)


@pytest.mark.parametrize("n", [15, 16])
def test_derivative_and_antiderivative(n: int) -> None:
    k = wavenumbers(n, LENGTH)
    field = waves(n, {0: 1.7, 1: 0.8, 3: 0.2, 6: 0.05})
    slope = derivative(field, wavenumbers(n, LENGTH))
    x = LENGTH * np.arange(n) / n
    exact = sum(-a * k[m] * np.sin(k[m] * x + 0.3 * m) for m, a in {1: 0.8, 3: 0.2, 6: 0.05}.items())
    assert slope == pytest.approx(exact, abs=1e-13)
    assert slope.sum() == pytest.approx(0, abs=1e-13)
    back = np.fft.irfft(integral_spectrum(slope, k), n=n)
    assert back == pytest.approx(field - field.mean(), abs=1e-14)


@pytest.mark.parametrize("n", [9, 10])
def test_the_transform_and_its_inverse(n: int) -> None:
    f = np.random.default_rng(3).normal(size=(n, 4))
    transform = RealTransform(n, 4)
    assert transform.forward(f) == pytest.approx(np.fft.rfft(f, axis=0), abs=1e-13)
    transform.spectrum *= 2
    assert transform.inverse() == pytest.approx(2 * f, abs=1e-14)
