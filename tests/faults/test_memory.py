"""A long run keeps nothing per frame in memory: what it writes is in the file."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kinetic_solver import Scene, run_to_file
from kinetic_solver.methods import METHODS

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
