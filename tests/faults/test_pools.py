"""Many runs at once: pools of processes and of threads give the bits of a single run; a fork that cannot work says so."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
from typing import Any

import numpy as np
import pytest

from kinetic_solver import KineticError, Scene, solve

SCENE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.3}]},
    "run": {"end_time": 0.2},
    "accuracy": {"rtol": 1e-2},
    "grid": {"nx": 9, "nv": 32},
    "particles": {"count": 300, "replicas": 2},
}


def job(method: str) -> np.ndarray:
    from particles import simulate

    scene = Scene.model_validate(SCENE)
    return (simulate(scene)["density"] if method == "particles" else solve(scene)["f"]).values


@pytest.mark.parametrize("start", ["spawn", "forkserver"])
def test_pools_of_processes(start: str) -> None:
    methods = ["grid", "particles"]
    expected = [job(method) for method in methods]
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(start)) as pool:
        for found, truth in zip(pool.map(job, methods * 2), expected * 2, strict=True):
            assert np.array_equal(found, truth)


@pytest.mark.parametrize("method", ["grid", "particles"])
def test_pools_of_threads(method: str) -> None:
    expected = job(method)
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        assert all(np.array_equal(found, expected) for found in pool.map(job, [method] * 4))


@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["grid", "particles"])
def test_a_fork_after_a_run(method: str) -> None:
    """The grid solver's threads last no longer than a loop. Particles' loops, where they run on GNU OpenMP, would end the process
    at its first one: that is refused in one line."""
    import numba

    expected = job(method)
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        asked = pool.submit(job, method)
        if method == "particles" and numba.threading_layer() == "omp":
            with pytest.raises(KineticError, match=r"^this process was forked from one that had used threads already"):
                asked.result()
        else:
            assert np.array_equal(asked.result(), expected)
