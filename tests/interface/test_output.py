"""Files: schema, live reading, a killed run, no overwriting."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from kinetic_solver.dataset import VARIABLES, NetCDFRecorder, open_run, write_dataset
from kinetic_solver.errors import SceneError
from kinetic_solver.plan import make_plan
from kinetic_solver.scene import Scene, Schedule
from kinetic_solver.solver import integrate, solve

MakeScene = Callable[..., Scene]

SLOW = """
[pipe]
length = 9.0
[collisions]
operator = "follow-the-leader"
cross_section = 0.4
[run]
end_time = 100000.0
output_every = 0.1
[grid]
nx = 15
nv = 64
time_step = 0.05
"""

ENOUGH = 2**26
"""Bytes: some 8000 frames of that run."""


def written(scene: Scene, path: Path) -> None:
    plan = make_plan(scene)
    recorder = NetCDFRecorder(path, plan.output, scene, Schedule.of(scene, VARIABLES))
    integrate(plan, recorder)
    recorder.close()


def test_datasets_of_one_scene_share_nothing(make_scene: MakeScene) -> None:
    """What is laid out alike is put together once; whoever changes one dataset changes no other."""
    scene = make_scene(run={"end_time": 0.5, "output_every": 0.25}, units={"length": "m", "time": "s", "number": "1"})
    first, untouched = solve(scene), solve(scene)
    expected = untouched.copy(deep=True)
    for variable in first.variables.values():
        variable.attrs["long_name"] = "spoiled"
        if variable.values.ndim and variable.values.flags.writeable:
            variable.values[...] = -7.0
    first.attrs["scene"] = "spoiled"
    later = solve(scene)
    for found in (untouched, later):
        created = {name: found.attrs[name] for name in ("created", "history")}
        xr.testing.assert_identical(found, expected.assign_attrs(created))


def test_a_file_and_solve_hold_the_same(make_scene: MakeScene, tmp_path: Path) -> None:
    collisions = {"operator": "follow-the-leader", "cross_section": 0.5}
    output = {"f": 0.75, "moment_equations": True}
    scene = make_scene(collisions=collisions, run={"end_time": 1.5, "output_every": 0.25}, output=output)
    written(scene, tmp_path / "a.nc")
    in_memory = solve(scene)
    with open_run(tmp_path / "a.nc") as on_disk:
        assert on_disk.sizes["time"] == 7
        assert on_disk["f"].dims == ("time_f", "x", "v")
        assert set(on_disk.variables) == set(in_memory.variables)
        for name in in_memory.variables:
            assert np.array_equal(on_disk[name].values, in_memory[name].values), name
            assert on_disk[name].attrs.keys() >= {"long_name"} or name.endswith("bounds"), name
        assert Scene.model_validate_json(on_disk.attrs["scene"]) == scene
        assert json.loads(on_disk.attrs["packages"])["numpy"] == np.__version__
        assert int(on_disk["status"]) == 1


def test_only_what_is_asked_for_is_written(make_scene: MakeScene) -> None:
    off = {"f": False, "moments": False, "budgets": False}
    dataset = solve(make_scene(output=off))
    assert "mass" in dataset
    assert not {"f", "density", "energy_residual"} & set(dataset.variables)


def test_an_existing_file_is_kept(make_scene: MakeScene, tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(b"mine")
    plan = make_plan(make_scene())
    with pytest.raises(SceneError, match="exists already"):
        NetCDFRecorder(path, plan.grid, plan.scene, Schedule.of(plan.scene, VARIABLES))
    with pytest.raises(SceneError, match="exists already"):
        write_dataset(xr.Dataset(), path)
    assert path.read_bytes() == b"mine"


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(b"no netCDF")
    with pytest.raises(SceneError, match="not a readable netCDF"):
        open_run(path)
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "b.nc")
    with pytest.raises(SceneError, match="not written by kinetic-solver"):
        open_run(tmp_path / "b.nc")


def test_a_running_file_opens_and_a_killed_one_keeps_its_frames(tmp_path: Path) -> None:
    (tmp_path / "slow.toml").write_text(SLOW)
    path = tmp_path / "slow.nc"
    command = [sys.executable, "-m", "kinetic_solver", "run", str(tmp_path / "slow.toml"), "-o", str(path)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        frames: list[int] = []
        while len(frames) < 6 and process.poll() is None:
            time.sleep(0.2)
            if not path.exists():
                continue
            assert path.stat().st_size < ENOUGH, "thousands of frames, and the file could not be opened six times"
            try:
                with xr.open_dataset(path) as live:
                    if live.sizes.get("time", 0) > (frames[-1] if frames else 0):
                        frames.append(live.sizes["time"])
                        assert np.isfinite(live["f"].values[: frames[-1] - 1]).all()
                        assert int(live["status"]) == 0
            except (OSError, ValueError):
                assert not frames, "a file that was readable is not any more"
        assert len(frames) == 6
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with open_run(path) as killed:
        times = killed["time"].values
        assert times.size >= frames[-1]
        whole = np.isfinite(killed["f"].values.reshape(times.size, -1)).all(axis=1)
        assert whole[:-1].all()
        assert times[:-1] == pytest.approx(0.1 * np.arange(times.size - 1))
        mass = killed["mass"].values[whole]
        assert mass == pytest.approx(mass[0], rel=1e-12)
