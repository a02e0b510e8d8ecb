"""A long run keeps nothing per frame in memory: what it writes is in the file."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kinetic_solver import Scene, run_to_file
from kinetic_solver.methods import METHODS
from kinetic_solver.plan import make_plan
from kinetic_solver.solver.scheme import Early

FRAMES, SETTLED = 300, 100
NX, NV = 9, 64
PER_FRAME = 1000
"""Bytes that may be allocated and kept a frame, beside noise: a frame's f alone has 4608."""


@pytest.mark.parametrize("method", METHODS)
def test_memory_is_flat(make_scene: Callable[..., Scene], tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for the block of frames that is about to be written: here each frame is one."""
    monkeypatch.setattr("kinetic_solver.dataset.netcdf_recorder.EVERY", 0.0)
    scene = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 0.9},
        initial={"modes": [{"mode": 1, "cos": 0.1}]},
        run={"end_time": 15.0, "output_every": 0.05},
        grid={"nx": NX, "nv": NV},
        particles={"count": 200, "replicas": 2},
        accuracy={"rtol": 1e-2},
    )
    sizes: dict[int, int] = {}

    def measure(time: float, end: Any) -> None:
        frame = round(time / 0.05)
        if frame in (SETTLED, FRAMES - 1):
            sizes[frame] = tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        run_to_file(scene, tmp_path / "a.nc", method, progress=measure)
    finally:
        tracemalloc.stop()
    assert sizes[FRAMES - 1] - sizes[SETTLED] < PER_FRAME * (FRAMES - 1 - SETTLED)


MOST_ARRAYS = 30.0
"""Of the size of f, alive at once: what planning reckons with beside its tables (plan.STATE_ARRAYS)."""
VELOCITIES = 64
LAWS: dict[str, dict[str, Any] | None] = {
    "none": None,
    "(6)": {"operator": "follow-the-leader", "cross_section": 0.6},
    "(12)": {"operator": "inelastic", "cross_section": 0.7, "restitution": 0.4},
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.filterwarnings("ignore")
def test_a_run_holds_so_many_arrays_of_f(make_scene: Callable[..., Scene], tmp_path: Path, law: str) -> None:
    """By the difference that more points in x make, in which what does not grow with them is not."""

    def peak(nx: int) -> int:
        scene = make_scene(
            collisions=LAWS[law],
            initial={"modes": [{"mode": 1, "cos": 0.3}]},
            run={"end_time": 0.02, "output_every": 0.01},
            grid={"nx": nx, "nv": VELOCITIES},
            accuracy={"rtol": 1e-3},
        )
        run_to_file(scene, tmp_path / "first.nc", overwrite=True)  # imports, and what is kept between runs
        tracemalloc.start()
        try:
            run_to_file(scene, tmp_path / "a.nc", overwrite=True)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    few, many = 315, 945
    assert (peak(many) - peak(few)) / (8 * VELOCITIES * (many - few)) < MOST_ARRAYS


def test_frames_too_early_for_the_kernel_leave_no_tables(make_scene: Callable[..., Scene]) -> None:
    """Each is a step of its own length, on up to nine times the velocities: a table has eighty times the size of a kernel."""
    scene = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 0.9},
        initial={"modes": [{"mode": 1, "cos": 0.1}]},
        grid={"nx": NX, "nv": NV},
        accuracy={"rtol": 1e-3},
    )
    plan = make_plan(scene)
    early = Early(plan)
    times = [plan.shortest_step * share for share in (0.02, 0.03, 0.04, 0.05, 0.06)]
    early(times[0])
    gc.collect()
    tracemalloc.start()
    try:
        for time in times:
            early(time)
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert plan.shortest_step > 0
    assert kept < 8 * NV**2
