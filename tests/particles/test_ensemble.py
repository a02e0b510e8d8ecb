"""Sorting by cells: the stable permutation, whatever the threads."""

from __future__ import annotations

from dataclasses import astuple

import numba
import numpy as np
import pytest

from kinetic_solver.scene import Model
from particles.ensemble import Ensemble
from particles.langevin import LangevinStep, advance
from particles.random import key

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)
LENGTH = 9.0


def start(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.uniform(0, LENGTH, count), rng.normal(size=count)


@pytest.mark.parametrize(("count", "cells"), [(5000, 37), (5000, 1), (40, 100), (1, 3)])
@pytest.mark.parametrize("threads", [1, 2])
def test_the_stable_order_of_cells(count: int, cells: int, threads: int) -> None:
    x, v = start(count)
    ensemble, k, step = Ensemble(x.copy(), v.copy(), LENGTH, cells), key(1, 0), LangevinStep.over(MODEL, 0.3)
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        ensemble.advance_and_sort(step, 5, k)
    finally:
        numba.set_num_threads(before)
    advance(x, v, LENGTH, astuple(step), np.uint64(5), k[0], k[1])
    cell = np.minimum((x * (cells / LENGTH)).astype(int), cells - 1)
    order = np.argsort(cell, kind="stable")
    assert np.array_equal(ensemble.x, x[order])
    assert np.array_equal(ensemble.v, v[order])
    assert np.array_equal(np.diff(ensemble.starts), np.bincount(cell, minlength=cells))
    assert ensemble.starts[0] == 0


def test_nothing_is_allocated() -> None:
    """Two pairs of arrays, exchanged at each sort."""
    ensemble, k, step = Ensemble(*start(100), LENGTH, 5), key(1, 0), LangevinStep.over(MODEL, 0.3)
    seen = set()
    for number in range(6):
        ensemble.advance_and_sort(step, number, k)
        seen.add((ensemble.x.ctypes.data, ensemble.v.ctypes.data))
    assert len(seen) == 2
