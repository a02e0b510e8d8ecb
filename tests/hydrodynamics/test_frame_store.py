"""Frames kept beside the output: they come back as they were, a store goes back to what was on disk, and damage is noticed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kinetic_solver import SceneError
from kinetic_solver.hydrodynamics import FrameStore

ROWS = np.random.default_rng(4).random((5, 7))


def filled(path: Path | None) -> FrameStore:
    """Two passes, of three rows of 7 numbers and two of 4."""
    store = FrameStore(path)
    store.begin(7)
    for row in ROWS[:3]:
        store.append(row)
    store.begin(4)
    for row in ROWS[3:]:
        store.append(row[::2])
    return store


@pytest.mark.parametrize("on_disk", [True, False])
def test_rows_come_back_in_any_order_between_writes(tmp_path: Path, on_disk: bool) -> None:
    store = filled(tmp_path / "a.frames" if on_disk else None)
    assert (store.rows(0), store.rows(1)) == (3, 2)
    for number in (2, 0):
        assert np.array_equal(store.row(0, number), ROWS[number])
    store.append(ROWS[0, :4])
    assert np.array_equal(store.row(1, 1), ROWS[4, ::2])
    assert np.array_equal(store.row(1, 2), ROWS[0, :4])
    store.close()


def test_a_store_goes_back_to_what_was_on_disk(tmp_path: Path) -> None:
    path = tmp_path / "a.frames"
    store = filled(path)
    state = store.state()
    store.append(ROWS[0, :4])
    store.begin(2)
    store.append(ROWS[0, :2])
    store.close()
    again = FrameStore(path)
    again.restore(state)
    assert path.stat().st_size == 8 * (3 * 7 + 2 * 4)
    assert again.state() == state
    again.append(ROWS[1, :4])
    assert np.array_equal(again.row(1, 2), ROWS[1, :4])
    assert np.array_equal(again.row(0, 1), ROWS[1])
    again.close()


def test_one_without_rows_has_no_file(tmp_path: Path) -> None:
    store = FrameStore(tmp_path / "a.frames")
    store.begin(7)
    state = store.state()
    store.close()
    assert list(tmp_path.iterdir()) == []
    again = FrameStore(tmp_path / "a.frames")
    again.restore(state)
    again.append(ROWS[0])
    assert np.array_equal(again.row(0, 0), ROWS[0])
    again.close()


@pytest.mark.parametrize("damage", ["gone", "cut", "flipped"])
def test_damage_is_noticed(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "a.frames"
    store = filled(path)
    state = store.state()
    store.close()
    whole = path.read_bytes()
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(whole[:-1])
    else:
        path.write_bytes(whole[:100] + bytes([whole[100] ^ 1]) + whole[101:])
    again = FrameStore(path)
    with pytest.raises(SceneError, match=r"a\.frames: has lost frames that the checkpoint speaks of; allowed: to overwrite"):
        again.restore(state)
    again.close()
