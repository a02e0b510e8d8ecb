"""Many runs at once: pools of processes, however they are started, and of threads give the bits of a single run."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, solve

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
METHODS = ["grid", "particles"]


def job(method: str) -> np.ndarray:
    """On two threads, however little work there is. It also runs where nothing is put back: in other processes."""
    import numba

    from kinetic_solver import threads
    from particles import simulate

    numba.set_num_threads(2)
    threads.SECONDS_OF_A_THREAD = 1e-12
    scene = Scene.model_validate(SCENE)
    return (simulate(scene)["density"] if method == "particles" else solve(scene)["f"]).values


@pytest.fixture(autouse=True)
def _numbers_of_threads_are_put_back(monkeypatch: pytest.MonkeyPatch) -> Any:
    import numba

    from kinetic_solver import threads

    monkeypatch.setattr(threads, "SECONDS_OF_A_THREAD", threads.SECONDS_OF_A_THREAD)
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


def same_as_alone(mapped: Callable[[Callable[[str], np.ndarray], list[str]], Any]) -> None:
    expected = [job(method) for method in METHODS]
    found = list(mapped(job, METHODS * 2))
    assert len(found) == 4
    for one, truth in zip(found, expected * 2, strict=True):
        assert np.array_equal(one, truth)


@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork.*:DeprecationWarning")
@pytest.mark.parametrize("start", ["spawn", "forkserver", "fork"])
def test_pools_of_processes(start: str) -> None:
    """Those by fork after a run in this process."""
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(start)) as pool:
        same_as_alone(pool.map)


def test_pools_of_threads() -> None:
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        same_as_alone(pool.map)


@pytest.mark.parametrize("backend", ["loky", "threading", "multiprocessing"])
def test_joblib(backend: str) -> None:
    joblib = pytest.importorskip("joblib")
    same_as_alone(lambda of, methods: joblib.Parallel(2, backend=backend)(joblib.delayed(of)(method) for method in methods))


@pytest.mark.parametrize("scheduler", ["threads", "processes"])
def test_dask(scheduler: str) -> None:
    dask = pytest.importorskip("dask")
    same_as_alone(lambda of, methods: dask.compute(*map(dask.delayed(of), methods), scheduler=scheduler, num_workers=2))


def test_a_cluster_of_dask() -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        same_as_alone(lambda of, methods: client.gather(client.map(of, methods, pure=False)))


THREADS = """
import concurrent.futures, numpy as np
from tests.faults.test_pools import METHODS, job
expected = [job(method) for method in METHODS]
with concurrent.futures.ThreadPoolExecutor(4) as pool:
    found = list(pool.map(job, METHODS * 4))
assert all(np.array_equal(a, b) for a, b in zip(found, expected * 4, strict=True))
print("the same")
"""


@pytest.mark.parametrize("layer", ["workqueue", "omp"])
def test_threads_on_any_layer_of_numba(layer: str) -> None:
    """numba's workqueue ends a process in which two threads run parallel loops at once: there are none here."""
    root = Path(__file__).parents[2]
    environment = os.environ | {"NUMBA_THREADING_LAYER": layer, "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", THREADS], cwd=root, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "the same\n"), done.stderr
