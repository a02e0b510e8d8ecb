"""The file of a checkpoint: whole or refused, two of them, of one run alone; trees of what it holds."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from kinetic_solver import RunUnfinished, Scene, SceneError, run_to_file
from kinetic_solver.dataset import Checkpoint, open_run
from kinetic_solver.dataset import checkpoint as module
from kinetic_solver.dataset.trees import pack, unpack
from kinetic_solver.methods import METHODS

MakeScene = Callable[..., Scene]
EVERY_METHOD = pytest.mark.parametrize("method", METHODS)
SMALL: dict[str, Any] = {
    "run": {"end_time": 1.5, "output_every": 0.5},
    "grid": {"nx": 9, "nv": 32},
    "particles": {"count": 200, "replicas": 2},
    "accuracy": {"rtol": 1e-2},
}


@dataclasses.dataclass(frozen=True)
class Pair:
    first: Any
    second: float


def there_and_back(tree: Any) -> Any:
    arrays: list[np.ndarray] = []
    return unpack(json.loads(json.dumps(pack(tree, arrays))), arrays, {"Pair": Pair})


def test_trees_come_back_as_they_were() -> None:
    x = np.arange(6.0).reshape(2, 3)
    tree = {"a": [1, 2.5, None, True, "τ"], "b": (x, {"c": x}), "d": Pair((), -math.inf), "e": np.float64(0.1), "f": np.int64(3)}
    found = there_and_back(tree)
    assert found["a"] == tree["a"]
    assert isinstance(found["b"], tuple)
    assert found["b"][0] is found["b"][1]["c"]
    assert np.array_equal(found["b"][0], x)
    assert found["d"] == Pair((), -math.inf)
    assert (found["e"], found["f"]) == (0.1, 3)
    assert math.isnan(there_and_back(math.nan))


@pytest.mark.parametrize("other", [{1: 2}, object(), {"kind": 1}, {1, 2}], ids=["a key", "an object", "the mark", "a set"])
def test_what_is_no_tree_is_refused(other: Any) -> None:
    with pytest.raises(ValueError, match="a checkpoint cannot hold a"):
        pack([other], [])


# -- the file


@pytest.fixture
def kept(make_scene: MakeScene, tmp_path: Path) -> tuple[Checkpoint, Path]:
    """Two checkpoints of a run, of the times 0.5 and 1."""
    target = tmp_path / "a.nc"
    target.write_bytes(b"0123456789")
    checkpoint = Checkpoint(target, make_scene(**SMALL), "grid")
    for time in (0.5, 1.0):
        checkpoint.save(time, {"t": time, "x": np.full(100, time)})
    return checkpoint, target


def test_the_last_is_loaded_and_the_one_before_is_kept(kept: tuple[Checkpoint, Path]) -> None:
    checkpoint, target = kept
    assert checkpoint.load()["t"] == 1.0
    assert sorted(path.name for path in target.parent.iterdir()) == ["a.nc", "a.nc.checkpoint", "a.nc.checkpoint.previous"]
    checkpoint.path.unlink()
    assert checkpoint.load()["t"] == 0.5
    checkpoint.remove()
    assert checkpoint.load() is None
    assert [path.name for path in target.parent.iterdir()] == ["a.nc"]


def test_any_flipped_byte_is_noticed(kept: tuple[Checkpoint, Path]) -> None:
    """Of the newer one: the one before is taken. Bytes of the zip's own bookkeeping that change nothing may pass."""
    checkpoint, _ = kept
    whole = checkpoint.path.read_bytes()
    for place in range(0, len(whole), 97):
        checkpoint.path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x41]) + whole[place + 1 :])
        found = checkpoint.load()
        assert np.array_equal(found["x"], np.full(100, found["t"]))
        assert found["t"] in (0.5, 1.0)


@pytest.mark.parametrize("keep", [0, 10, 1000, -1])
def test_one_cut_short_gives_way_to_the_one_before(kept: tuple[Checkpoint, Path], keep: int) -> None:
    checkpoint, _ = kept
    checkpoint.path.write_bytes(checkpoint.path.read_bytes()[:keep])
    assert checkpoint.load()["t"] == 0.5
    checkpoint.previous.write_bytes(b"")
    with pytest.raises(SceneError, match=r"a\.nc\.checkpoint: is not a readable checkpoint; remove it to start afresh$"):
        checkpoint.load()


def test_a_whole_one_with_another_content_is_noticed(kept: tuple[Checkpoint, Path]) -> None:
    """A well-formed zip, and a wrong time in it."""
    checkpoint, _ = kept
    with np.load(checkpoint.path) as file:
        header, arrays = json.loads(str(file["header"])), file["array_0"]
    header["time"] = 0.0
    with checkpoint.path.open("wb") as stream:
        np.savez(stream, header=json.dumps(header), array_0=arrays)
    assert checkpoint.load()["t"] == 0.5


@pytest.mark.parametrize("time", [-0.5, 2.0, math.nan])
def test_a_time_outside_the_run_is_noticed(kept: tuple[Checkpoint, Path], time: float) -> None:
    checkpoint, _ = kept
    checkpoint.save(time, {"t": time})
    assert checkpoint.load()["t"] == 1.0


def test_those_of_other_runs_are_refused(
    kept: tuple[Checkpoint, Path], make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint, target = kept
    other = make_scene(**{**SMALL, "particles": {"count": 201, "replicas": 2}})
    with pytest.raises(SceneError, match=r"is of another scene \(particles\.count differ\); allowed: to overwrite it"):
        Checkpoint(target, other, "grid").load()
    with pytest.raises(SceneError, match="is of method 'grid'; allowed: to overwrite the run, or another name"):
        Checkpoint(target, make_scene(**SMALL), "exact").load()
    target.write_bytes(b"012")
    with pytest.raises(SceneError, match="has lost what was written before the checkpoint"):
        checkpoint.load()
    monkeypatch.setattr(module, "version", lambda: "9.9")
    with pytest.raises(SceneError, match=r"was written by version \S+, this is 9\.9; allowed: to go on with that version"):
        checkpoint.load()


def test_a_failed_write_leaves_the_last(kept: tuple[Checkpoint, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    checkpoint, target = kept
    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="No space left"):
        checkpoint.save(1.25, {"t": 1.25})
    assert checkpoint.load()["t"] == 1.0
    assert not list(target.parent.glob("*.part"))


# -- of a run, by every method


@EVERY_METHOD
def test_resuming(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """What is refused, in one line; without a checkpoint afresh; a run that is stopped again and again comes to its end."""
    scene, path = make_scene(**SMALL), tmp_path / "a.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene, path, method, max_walltime=0)
    assert path.with_name("a.nc.checkpoint").exists()
    for changes, message in (
        ({"run": {"end_time": 1.5, "output_every": 0.75}}, r"is of another scene \(run\.output_every differ\)"),
        ({"accuracy": {"rtol": 2e-2}}, r"is of another scene \(accuracy\.rtol differ\)"),
    ):
        with pytest.raises(SceneError, match=message):
            run_to_file(make_scene(**{**SMALL, **changes}), path, method, resume=True)
    other = next(name for name in METHODS if name != method)
    with pytest.raises(SceneError, match=f"is a run of method '{method}'; allowed: another name"):
        run_to_file(scene, path, other, resume=True)
    stops = 0
    while True:
        try:
            run_to_file(scene, path, method, resume=True, max_walltime=0)
            break
        except RunUnfinished:
            stops += 1
    assert stops > 1
    run_to_file(scene, tmp_path / "b.nc", method)
    with open_run(path) as found, open_run(tmp_path / "b.nc") as expected:
        assert found.attrs.keys() == expected.attrs.keys()
        assert found.drop_attrs().identical(expected.drop_attrs())


@EVERY_METHOD
def test_a_file_that_lost_a_frame_is_not_continued(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """As long as it was, but with fewer frames than the checkpoint knows."""
    scene, path = make_scene(**SMALL), tmp_path / "a.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene, path, method, max_walltime=0)
    with netCDF4.Dataset(path, "a") as out:
        out["time"][0] = 17.0
    with pytest.raises(SceneError, match="has lost what was written before the checkpoint"):
        run_to_file(scene, path, method, resume=True)
