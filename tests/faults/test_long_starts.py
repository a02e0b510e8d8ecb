"""Many particles are drawn and summed in parts: a run can be stopped before its first frame, says that it is alive, and has the
same bits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinetic_solver import RunUnfinished, Scene
from kinetic_solver.methods import Interruption, run_to_file
from particles import drawing, estimators, simulate

MakeScene = Callable[..., Scene]
COUNT, REPLICAS = 257, 3


def in_parts(monkeypatch: pytest.MonkeyPatch, drawn: int, summed: int) -> None:
    monkeypatch.setattr(drawing, "AT_ONCE", drawn)
    monkeypatch.setattr(estimators, "AT_ONCE", summed)
    monkeypatch.setattr(estimators, "LEAST_AT_ONCE", 1)


@pytest.fixture
def scene(make_scene: MakeScene) -> Scene:
    return make_scene(particles={"count": COUNT, "replicas": REPLICAS, "seed": 4})


STARTS = [
    {"velocity_modes": [{"mode": 1, "sin": 0.3}], "temperature_modes": [{"mode": 2, "cos": 0.2}]},
    {
        "modes": [],
        "beams": [{"share": s, "mean_velocity": u, "temperature": t} for s, u, t in ((0.3, -1.1, 0.2), (0.7, 0.6, 0.5))],
    },
]


@pytest.mark.parametrize("start", [*STARTS, None])
def test_the_bits_of_all_at_once(
    scene: Scene, make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch, start: dict[str, object] | None
) -> None:
    """100 particles at once, and summed by blocks of four; also from an f(x, v) of one's own."""
    own = None
    if start is None:
        scene = Scene.model_validate({k: v for k, v in scene.model_dump(exclude_unset=True).items() if k != "initial"})

        def own(x: np.ndarray, v: np.ndarray) -> np.ndarray:
            return (1 + 0.3 * np.cos(2 * np.pi * x / 9)) * np.exp(-((v - 0.2) ** 2) / 1.1)

    else:
        scene = make_scene(particles={"count": COUNT, "replicas": REPLICAS, "seed": 4}, initial=start)
    expected = simulate(scene, initial=own)
    in_parts(monkeypatch, 100, 5)
    told: list[float] = []
    found = simulate(scene, lambda time, end: told.append(time), initial=own)
    assert found.drop_attrs().identical(expected.drop_attrs())
    # Parts of 100, 100 and 57: a look before the third and the second of the next replica, and so on; then while they are summed.
    assert told.count(0.0) > REPLICAS
    assert told[-1] == scene.run.end_time


@pytest.mark.parametrize(("drawn", "summed"), [(100, 10**6), (10**6, 100)], ids=["while it is drawn", "while it is summed"])
def test_a_run_stops_before_its_first_frame(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: int, summed: int
) -> None:
    in_parts(monkeypatch, drawn, summed)
    path = tmp_path / "out.nc"
    late = r"^stopped after 0 s, before the first frame, without a checkpoint; run it again with more time$"
    with pytest.raises(RunUnfinished, match=late) as stopped:
        run_to_file(scene, path, "particles", max_walltime=0)
    assert not stopped.value.kept
    asked = Interruption(stop="SIGTERM")
    with pytest.raises(RunUnfinished, match=r"^stopped by SIGTERM before the first frame, without a checkpoint; run it again$"):
        run_to_file(scene, path, "particles", interruption=asked)
    assert [p.name for p in tmp_path.iterdir() if not p.name.endswith(".lock")] == []


def test_few_particles_reach_their_first_frame(scene: Scene, tmp_path: Path) -> None:
    """However little time they are given: then there is a checkpoint to go on from."""
    with pytest.raises(RunUnfinished) as stopped:
        run_to_file(scene, tmp_path / "out.nc", "particles", max_walltime=0)
    assert stopped.value.kept
    assert (tmp_path / "out.nc.checkpoint").exists()
