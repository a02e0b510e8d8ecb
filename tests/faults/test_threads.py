"""Runs in several threads of one process: netCDF's C library is not made for that, and BLAS has one number of threads for all."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import netCDF4
import numpy as np
import pytest
import threadpoolctl
import xarray as xr
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from kinetic_solver import Scene, run_to_file
from kinetic_solver.dataset import VARIABLES, NetCDFRecorder, append, compress, library, open_run
from kinetic_solver.dataset.files import mark_as_stopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Schedule
from kinetic_solver.threads import one_blas_thread

MakeScene = Callable[..., Scene]

SMALL = {"pipe": {"length": 5.0}, "accuracy": {"rtol": 1e-2}, "run": {"end_time": 0.2}}


@pytest.fixture
def often() -> Iterator[None]:
    """Python changes from one thread to another as often as it can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def test_files_written_and_read_at_once_are_whole(make_scene: MakeScene, tmp_path: Path) -> None:
    """The file alone, many times: without locks a few of these files were lost in one of some trials, or the process crashed."""
    scene, grid = make_scene(run={"end_time": 1.5, "output_every": 0.5}), PhaseSpaceGrid(5, 8, 9.0, -2.0, 3.0)
    schedule = Schedule.of(scene, ("f", "scalars"))

    def write(number: int) -> np.ndarray:
        path = tmp_path / f"{number}.nc"
        recorder = NetCDFRecorder(path, grid, scene, schedule)
        for time in schedule.of_group("f"):
            values = dict.fromkeys(VARIABLES["scalars"], number + time)
            recorder.record(time, {"f": {"f": np.full((5, 8), number + time)}, "scalars": values})
        recorder.close()
        with open_run(path) as dataset:
            return dataset["f"].values[:, 3, 4]

    with ThreadPoolExecutor(8) as pool:
        for number, values in enumerate(pool.map(write, range(100))):
            assert values.tolist() == [number, number + 0.5, number + 1.0, number + 1.5]


class Watched(netCDF4.Dataset):  # type: ignore[misc]
    """A file whose calls are made by whoever holds the lock."""

    calls = 0

    def __init__(self, *arguments: Any, **more: Any) -> None:
        self.look()
        super().__init__(*arguments, **more)

    @staticmethod
    def look() -> None:
        assert NETCDF4_PYTHON_LOCK.locked()
        Watched.calls += 1

    def __getitem__(self, name: str) -> Any:
        self.look()
        return super().__getitem__(name)

    def setncatts(self, attributes: Any) -> None:
        self.look()
        super().setncatts(attributes)

    def sync(self) -> None:
        self.look()
        super().sync()

    def close(self) -> None:
        self.look()
        super().close()


def test_calls_of_the_library_hold_the_locks(make_scene: MakeScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever writes, ends, resumes, adds to, marks and compresses a file: xarray's lock, too, for those who read with xarray."""
    scene, path = make_scene(**SMALL), tmp_path / "run.nc"
    run_to_file(scene, other := tmp_path / "other.nc")
    with open_run(other) as run:
        density = run[["density"]].rename(density="density_again").load()
    monkeypatch.setattr(netCDF4, "Dataset", Watched)
    grid = PhaseSpaceGrid(5, 8, 9.0, -2.0, 3.0)
    schedule = Schedule.of(scene, ("scalars",))
    values = dict.fromkeys(VARIABLES["scalars"], 0.3)
    recorder = NetCDFRecorder(path, grid, scene, schedule)
    recorder.record(0.0, {"scalars": values})
    recorder.close(stopped="for a test")
    recorder = NetCDFRecorder(path, grid, scene, schedule, after=0.0)
    recorder.record(0.2, {"scalars": values})
    recorder.close()
    mark_as_stopped(path, "for a test")
    append(other, density)
    compress(other)
    assert Watched.calls > 20
    assert not library.OPENING.locked()


def test_every_method_has_the_same_bits_beside_others(make_scene: MakeScene, tmp_path: Path, often: None) -> None:
    """Compiled loops, transforms, dense algebra, random numbers: nothing of a run is another's."""
    follow = make_scene(**SMALL, collisions={"operator": "follow-the-leader", "cross_section": 0.7}, particles={"count": 500})
    inelastic = make_scene(
        **{**SMALL, "grid": {}}, collisions={"operator": "inelastic", "restitution": 0.6, "cross_section": 0.8}
    )
    runs: list[tuple[Scene, str]] = [
        (follow, "grid"), (inelastic, "grid"), (follow, "exact"), (follow, "particles"), (follow, "hydrodynamics")
    ]  # fmt: skip

    def run(number: int) -> xr.Dataset:
        scene, method = runs[number % len(runs)]
        run_to_file(scene, tmp_path / f"{number}.nc", method)
        with open_run(tmp_path / f"{number}.nc") as dataset:
            return dataset.load()

    alone = [run(number) for number in range(len(runs))]
    with ThreadPoolExecutor(4) as pool:
        for number, dataset in enumerate(pool.map(run, range(len(runs), 4 * len(runs)))):
            xr.testing.assert_equal(dataset, alone[number % len(runs)])


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in threadpoolctl.threadpool_info() if library["user_api"] == "blas"]


def test_blas_stays_on_one_thread_until_the_last_has_left() -> None:
    """Who came first leaves first: the number is set back neither too early, nor to the one that the second found."""
    both_within, one_left = Barrier(2), Barrier(2)
    with one_blas_thread():
        pass  # SciPy's BLAS is loaded
    before = blas_threads()

    def first() -> None:
        with one_blas_thread():
            both_within.wait()
        one_left.wait()

    def second() -> list[int]:
        with one_blas_thread():
            both_within.wait()
            one_left.wait()
            return blas_threads()

    with threadpoolctl.threadpool_limits(2, "blas"), ThreadPoolExecutor(2) as pool:
        leaving, staying = pool.submit(first), pool.submit(second)
        leaving.result()
        assert set(staying.result()) == {1}
        assert set(blas_threads()) == {2}
    assert blas_threads() == before
