"""A sweep of 64 points by a pool of this machine and by a cluster of dask.distributed, a worker killed in each: the same bits.

    python -m benchmarks.sweeps

Operator (12) at eight densities and eight restitutions; half a minute on two cores, without distributed half of that. Asserts
that every point comes to its end and that all answers agree in every bit.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver import Scene, sweep

SCENE = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.3}]},
    "run": {"end_time": 4.0, "output_every": 0.5},
    "accuracy": {"rtol": 1e-3},
    "output": {"velocity_window": [-3.0, 6.0]},
}
VALUES = {
    "initial.density": np.linspace(0.4, 1.8, 8).tolist(),
    "collisions.restitution": np.linspace(0.1, 0.8, 8).tolist(),
}
KILLED_AFTER = 10
"""Points."""
WORKERS = 2


def run(executor: Executor | None, kill: Callable[[], None] | None = None) -> tuple[xr.Dataset, float, list[str]]:
    """The dataset, the seconds that it took, and what was said; `kill` is called once, when some points are done."""
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        if kill is not None and len(said) == KILLED_AFTER:
            kill()

    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="kinetic-sweep-") as folder:
        found = sweep(Scene.model_validate(SCENE), VALUES, Path(folder) / "map", executor=executor, say=say)
    return found, time.perf_counter() - began, said


def kill_process_of_pool() -> None:
    victim = multiprocessing.active_children()[0]
    assert victim.pid is not None
    os.kill(victim.pid, signal.SIGKILL)


@contextmanager
def cluster() -> Iterator[tuple[Any, Callable[[], None]]]:
    """An executor, and what kills one of its workers."""
    from distributed import Client, LocalCluster

    workers = LocalCluster(WORKERS, threads_per_worker=1, processes=True, dashboard_address=None)
    with workers, Client(workers) as client:
        yield client.get_executor(), lambda: os.kill(next(iter(workers.workers.values())).pid, signal.SIGKILL)


def main() -> None:
    alone, seconds, _ = run(None)
    points = alone["status"].size
    assert (alone["status"] == 1).all()
    print(f"{points} points, {alone.nbytes / 1e6:.0f} MB")
    print(f"| pool of processes | {seconds:.1f} s |")
    others = [("pool, a process killed", run(None, kill_process_of_pool))]
    assert others[0][1][2].count("a process was killed; its point is run again") == 1
    try:
        with cluster() as (executor, kill):
            others.append(("LocalCluster, a worker killed", run(executor, kill)))
    except ImportError:
        print("| LocalCluster | distributed is not installed |")
    for name, (found, seconds, _) in others:
        print(f"| {name} | {seconds:.1f} s |")
        for variable in alone.data_vars:
            assert found[variable].values.tobytes() == alone[variable].values.tobytes(), (name, variable)
    print("the same bits")


if __name__ == "__main__":
    main()
