"""Sorting by cells: the stable permutation, whatever the threads."""

from __future__ import annotations

import tracemalloc
from dataclasses import astuple

import numba
import numpy as np
import pytest

from kinetic_solver.scene import Model
from particles.ensemble import BLOCKS, Ensemble
from particles.langevin import LangevinStep, advance
from particles.random import key

MODEL = Model(gravity=1.3, friction=0.7, noise=0.5)
LENGTH = 9.0


def start(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.uniform(0, LENGTH, count), rng.normal(size=count)


@pytest.mark.parametrize(("count", "cells"), [(5000, 37), (5000, 1), (40, 100), (BLOCKS - 1, 4), (BLOCKS, 5), (1, 3)])
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


@pytest.mark.parametrize("threads", [1, 2])
def test_many_sorts(threads: int) -> None:
    """Ten steps in turn against NumPy's sort: particle i of a step is the i-th of the order left by the last one."""
    x, v = start(3000)
    ensemble, k, step = Ensemble(x.copy(), v.copy(), LENGTH, 20), key(6, 3), LangevinStep.over(MODEL, 0.7)
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        for number in range(10):
            ensemble.advance_and_sort(step, number, k)
            advance(x, v, LENGTH, astuple(step), np.uint64(number), k[0], k[1])
            order = np.argsort((x * (20 / LENGTH)).astype(int), kind="stable")
            x, v = x[order], v[order]
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(ensemble.x, x)
    assert np.array_equal(ensemble.v, v)
    assert ensemble.count == 3000


def test_walls_between_cells() -> None:
    """Particles at rest on walls and next to them: a wall belongs to the cell on its right, the last place to the last cell."""
    still = LangevinStep(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    walls = np.array([3.0, 6.0, 0.0])
    below = np.nextafter(np.array([3.0, 6.0, LENGTH]), 0)
    x = np.concatenate([below, walls])
    ensemble = Ensemble(x.copy(), np.arange(6.0), LENGTH, 3)
    ensemble.advance_and_sort(still, 0, key(1, 0))
    assert np.array_equal(ensemble.v, [0, 5, 1, 3, 2, 4])
    assert np.array_equal(ensemble.starts, [0, 2, 4, 6])


def test_a_step_without_sorting() -> None:
    """The same motion, in the order that was."""
    x, v = start(500)
    ensemble, k, step = Ensemble(x.copy(), v.copy(), LENGTH, 8), key(1, 4), LangevinStep.over(MODEL, 0.3)
    ensemble.advance(step, 5, k)
    advance(x, v, LENGTH, astuple(step), np.uint64(5), k[0], k[1])
    assert np.array_equal(ensemble.x, x)
    assert np.array_equal(ensemble.v, v)


def test_nothing_is_allocated() -> None:
    """Two pairs of arrays, exchanged at each sort, and a thousandth of a copy of x at most for the calls themselves."""
    ensemble, k, step = Ensemble(*start(1_000_000), LENGTH, 5), key(1, 0), LangevinStep.over(MODEL, 0.3)
    ensemble.advance_and_sort(step, 0, k)
    seen = set()
    tracemalloc.start()
    try:
        for number in range(1, 5):
            ensemble.advance_and_sort(step, number, k)
            seen.add((ensemble.x.ctypes.data, ensemble.v.ctypes.data))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(seen) == 2
    assert peak < ensemble.x.nbytes / 1000
