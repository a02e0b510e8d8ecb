"""Files of runs: whole from the moment they have their name, their data never moved, their end told last."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from kinetic_solver import Scene, SceneError
from kinetic_solver.dataset import FINISHED, RUNNING, VARIABLES, NetCDFRecorder, open_run
from kinetic_solver.dataset.header import needed_bytes
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Schedule

MakeScene = Callable[..., Scene]
GRID = PhaseSpaceGrid(5, 8, 9.0, -2.0, 3.0)
SCALARS = VARIABLES["scalars"]
MARK = 0.7182818284590451
"""The first number of f, to be found in the bytes of a file."""


def recorder(scene: Scene, path: Path, after: float | None = None) -> NetCDFRecorder:
    return NetCDFRecorder(path, GRID, scene, Schedule.of(scene, ("f", "scalars")), after=after)


@pytest.fixture
def scene(make_scene: MakeScene) -> Scene:
    return make_scene(output={"moments": False, "budgets": False}, run={"end_time": 1.5, "output_every": 0.5})


def frame(value: float) -> dict[str, dict[str, Any]]:
    return {"f": {"f": np.full((5, 8), value)}, "scalars": dict.fromkeys(SCALARS, value)}


def place_of_the_data(path: Path) -> int:
    return path.read_bytes().index(struct.pack(">d", MARK))


def test_a_file_has_its_name_once_its_first_frame_is_whole(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(IndexError):
        out.record(0.0, {"f": {"another": 1.0}, "scalars": {}})
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc.part"]
    out.close(stopped="a mistake")
    assert list(tmp_path.iterdir()) == []
    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]
    with open_run(path) as found:
        assert int(found["status"]) == RUNNING
        assert found.sizes["time"] == 1
    out.close()


def test_data_never_move(scene: Scene, tmp_path: Path) -> None:
    """Neither when a run stops for a long reason, nor when it goes on, nor when it is finished with a long report."""
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    place = place_of_the_data(path)
    out.record(0.5, frame(2.0))
    out.close(stopped="why " * 1000)
    assert place_of_the_data(path) == place
    out = recorder(scene, path, after=0.5)
    assert place_of_the_data(path) == place
    out.record(1.0, frame(3.0))
    out.close(report={"limited_by": "x" * 1000, "grids": "y" * 20000})
    assert place_of_the_data(path) == place
    with open_run(path) as found:
        assert found["f"][:, 0, 0].values.tolist() == [MARK, 2.0, 3.0]
        assert int(found["status"]) == FINISHED
        assert {"stopped", "room"}.isdisjoint(found.attrs)
        assert len(found.attrs["grids"]) == 20000


def test_the_status_comes_last(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever goes wrong before it, a file does not say that it is finished."""
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    attempts: list[int] = []

    def breaks(self: NetCDFRecorder) -> None:
        with netCDF4.Dataset(path) as seen:
            attempts.append(int(seen["status"][...]))
        raise OSError("no space")

    monkeypatch.setattr(NetCDFRecorder, "_sync", breaks)
    with pytest.raises(OSError, match="no space"):
        out.close(report={"limited_by": "nothing"})
    assert attempts == [RUNNING]


def test_frames_are_written_in_blocks(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At most a second after they came, whether or not another follows; and when a checkpoint asks for it."""
    clock = [100.0]
    monkeypatch.setattr("kinetic_solver.dataset.netcdf_recorder.monotonic", lambda: clock[0])
    path = tmp_path / "a.nc"

    def there() -> list[float]:
        with open_run(path) as found:
            assert found["f"][:, 0, 0].values.tolist() == found["mass"].values.tolist()
            return found["time"].values.tolist()  # type: ignore[no-any-return]

    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    assert there() == [0.0]
    out.record(0.5, frame(2.0))
    clock[0] += 0.9
    out.settle()
    assert there() == [0.0]
    clock[0] += 0.2
    out.settle()
    assert there() == [0.0, 0.5]
    out.record(1.0, frame(3.0))
    assert there() == [0.0, 0.5]
    out.sync()
    assert there() == [0.0, 0.5, 1.0]
    out.record(1.5, frame(4.0))
    out.close(stopped="a reason")
    assert there() == [0.0, 0.5, 1.0, 1.5]


def test_large_frames_do_not_wait(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinetic_solver.dataset.netcdf_recorder.BLOCK", 600)
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    for n, expected in enumerate((1, 1, 3)):  # a frame has 40 numbers of f and some more
        out.record(0.5 * n, frame(MARK))
        with open_run(path) as found:
            assert found.sizes["time"] == expected
    out.close()


def test_a_frame_in_the_making_is_not_shown(scene: Scene, tmp_path: Path) -> None:
    """A run that was killed while it wrote one: the time, which comes last, is not there."""
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    out.close(stopped="killed")
    with netCDF4.Dataset(path, "a") as broken:
        broken["mass"][1] = 3.0
    with open_run(path) as found:
        assert found["time"].values.tolist() == [0.0]
        assert found["mass"].values.tolist() == [MARK]


@pytest.mark.parametrize("lost", [1, 8, 300, 1000])
def test_a_file_that_was_cut_short_is_said_to_be(scene: Scene, tmp_path: Path, lost: int) -> None:
    """netCDF itself would read zeros."""
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    for time in (0.0, 0.5, 1.0, 1.5):
        out.record(time, frame(MARK))
    out.close()
    whole = path.read_bytes()
    needed = needed_bytes(path)
    assert needed is not None
    path.write_bytes(whole[:needed])
    with open_run(path) as found:
        assert (found["f"].values == MARK).all()
        assert all((found[name].values == MARK).all() for name in SCALARS)
    path.write_bytes(whole[: needed - lost])
    with pytest.raises(SceneError, match=rf"a\.nc: is cut short: it has {needed - lost} of the {needed} bytes"):
        open_run(path)


@pytest.mark.parametrize("form", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4"])
def test_the_length_of_files_of_every_form(tmp_path: Path, form: str) -> None:
    """Of odd sizes, with one variable that grows and with two."""
    for growing in (1, 2):
        path = tmp_path / f"{form}{growing}.nc"
        with netCDF4.Dataset(path, "w", format=form) as out:
            out.title = "odd"
            out.createDimension("time", None)
            out.createDimension("x", 3)
            out.createVariable("whole", "i1", ("x",))[:] = 1
            for n in range(growing):
                out.createVariable(f"v{n}", "i2", ("time", "x")).units = "m"
            for n in range(growing):
                out[f"v{n}"][:5] = np.ones((5, 3))
        needed, size = needed_bytes(path), path.stat().st_size
        if form == "NETCDF4":
            assert needed is None
        else:
            assert needed is not None
            assert size - 4 < needed <= size


def test_a_file_without_a_frame_is_said_to_be(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    out = recorder(scene, path)
    out.record(0.0, frame(MARK))
    out.close()
    with netCDF4.Dataset(path, "a") as broken:
        broken["time"][0] = 9.969209968386869e36
    with pytest.raises(SceneError, match=r"a\.nc: has no frame yet; allowed: a run that has written one"):
        open_run(path)
