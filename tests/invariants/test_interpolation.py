"""Interpolation between uniform points: exact where it says so, of its order elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from kinetic_solver.interpolation import through_splines, through_waves


@pytest.mark.parametrize("n", [1, 2, 7, 8, 65, 1024])
def test_waves_that_the_points_hold_are_exact_anywhere(n: int) -> None:
    period, rng = 3.7, np.random.default_rng(n)
    own = -1.3 + period * np.arange(n) / n
    places = np.concatenate([own, own + 2 * period, rng.uniform(-9, 9, 50)])
    held = np.arange((n - 1) // 2 + 1)
    size, phase = rng.normal(size=held.size), rng.uniform(0, 6, held.size)

    def field(x: np.ndarray) -> np.ndarray:
        waves = np.cos(2 * np.pi / period * np.outer(x, held) + phase)
        shortest = np.cos(np.pi * n / period * (x - own[0])) if n % 2 == 0 else 0.0
        return np.asarray(waves @ size + shortest)

    assert through_waves(own, places, period) @ field(own) == pytest.approx(field(places), abs=1e-13 * max(n, 10))


def test_the_kernel_is_the_sum_of_waves() -> None:
    """The slow twin: wave by wave."""
    for n in (9, 10):
        own, places = np.arange(n) / n, np.array([0.0, 0.1234, 0.5, 0.9])
        angle = 2 * np.pi * np.subtract.outer(places, own)
        twin = np.ones_like(angle) / n
        for k in range(1, n // 2 + 1):
            twin += (1 if 2 * k == n else 2) * np.cos(k * angle) / n
        assert through_waves(own, places, 1.0) == pytest.approx(twin, abs=1e-14)


@pytest.mark.parametrize("degree", [3, 5])
def test_order_of_splines(degree: int) -> None:
    errors = []
    for n in (20, 40, 80, 160):
        own, places = np.linspace(-3, 2, n), np.linspace(-1.5, 0.5, 501)
        errors.append(np.abs(through_splines(own, places, degree) @ np.exp(np.sin(own)) - np.exp(np.sin(places))).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert degree + 0.7 < orders[-1] < degree + 1.3
