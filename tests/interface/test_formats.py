"""What other programs read of our files: types that every netCDF has, netCDF-4 by request, times that go on from another run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import RunUnfinished, Scene, SceneError, exact, run_to_file, solve
from kinetic_solver.compare import compare
from kinetic_solver.dataset import compress, open_run

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.9}
CLASSIC = ("int8", "int16", "int32", "float32", "float64", "|S1", "<U1")
"""What the oldest format holds."""
SCENE = """
[pipe]
length = 9.0
[collisions]
operator = "follow-the-leader"
cross_section = 0.9
[initial]
modes = [{ mode = 1, cos = 0.1 }]
[run]
end_time = 0.2
[particles]
count = 500
seed = 7
replicas = 2
"""


def as_classic(path: Path, copy: Path) -> None:
    """What `nccopy -k classic` does: every variable and attribute in its own type, which is refused where CDF-1 has none such."""
    with netCDF4.Dataset(path) as old, netCDF4.Dataset(copy, "w", format="NETCDF3_CLASSIC") as new:
        old.set_auto_maskandscale(False)
        for name in old.ncattrs():
            value = old.getncattr(name)
            assert isinstance(value, str) or np.asarray(value).dtype.name in CLASSIC, name
            new.setncattr(name, value)
        for name, dimension in old.dimensions.items():
            new.createDimension(name, None if dimension.isunlimited() else dimension.size)
        for name, variable in old.variables.items():
            assert variable.dtype.name in CLASSIC, name
            new.createVariable(name, variable.dtype, variable.dimensions)[...] = variable[...]


@pytest.mark.parametrize("method", ["grid", "exact", "particles", "hydrodynamics"])
def test_every_file_can_be_made_a_classic_one(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    from scipy.io import netcdf_file

    more: dict[str, Any] = {"collisions": FOLLOW} if method == "hydrodynamics" else {}
    particles = {"count": 300, "replicas": 2}
    run_to_file(make_scene(run={"end_time": 0.2}, particles=particles, **more), tmp_path / "a.nc", method)
    as_classic(tmp_path / "a.nc", tmp_path / "classic.nc")
    with open_run(tmp_path / "a.nc") as ours, netcdf_file(tmp_path / "classic.nc", mmap=False) as theirs:
        for name in ("time", "x", "density", "mean_velocity"):
            assert np.array_equal(theirs.variables[name].data, ours[name].values), name


def test_so_can_the_files_of_theory_and_comparisons(command: Any, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    for arguments in (
        ("run", "scene.toml"),
        ("run", "scene.toml", "-o", "p.nc", "--method", "particles"),
        ("stability", "scene.toml", "-o", "theory.nc"),
        ("compare", "scene.nc", "p.nc", "-o", "compared.nc"),
    ):
        code = command(*arguments, folder=tmp_path).returncode
        assert code == (5 if arguments[0] == "compare" else 0), arguments  # so few particles can judge nothing
    for name in ("scene.nc", "p.nc", "theory.nc", "compared.nc"):
        as_classic(tmp_path / name, tmp_path / f"classic_{name}")


def test_seeds_of_any_length(make_scene: MakeScene) -> None:
    for seed, written in ((3, 3), (2**31 - 1, 2**31 - 1), (2**63 - 1, "9223372036854775807")):
        attributes = exact.solve(make_scene(particles={"seed": seed})).attrs
        assert attributes["seed"] == written
        assert Scene.model_validate_json(attributes["scene"]).particles.seed == seed


def test_a_finished_run_as_netcdf_4(command: Any, tmp_path: Path) -> None:
    """Compressed, with every value, fill and attribute of the classic file, and read by all that reads runs."""
    (tmp_path / "scene.toml").write_text(SCENE)
    runs = ("run", "scene.toml", "--set", "run.output_every=0.05", "--set", "output.f=0.1")
    assert command(*runs, folder=tmp_path).returncode == 0
    done = command(*runs, "-o", "four.nc", "--format", "netcdf4", folder=tmp_path)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "wrote four.nc")
    with netCDF4.Dataset(tmp_path / "scene.nc") as old, netCDF4.Dataset(tmp_path / "four.nc") as new:
        assert (old.data_model, new.data_model) == ("NETCDF3_64BIT_DATA", "NETCDF4")
        assert new["f"].filters()["zlib"]
        assert new["f"].chunking() == [1, *old["f"].shape[1:]]
        assert set(old.variables) == set(new.variables)
        assert {name: d.isunlimited() for name, d in new.dimensions.items()} == {
            n: d.isunlimited() for n, d in old.dimensions.items()
        }
        for dataset in (old, new):
            dataset.set_auto_maskandscale(False)
        for name, variable in old.variables.items():
            assert np.array_equal(variable[...], new[name][...], equal_nan=True), name
            assert variable.ncattrs() == new[name].ncattrs() or set(variable.ncattrs()) == set(new[name].ncattrs())
    for arguments in (("info", "four.nc"), ("plot", "four.nc"), ("compare", "scene.nc", "four.nc")):
        assert command(*arguments, folder=tmp_path).returncode == 0, arguments
    assert command(*runs, "-o", "four.nc", "--format", "netcdf4", "--resume", folder=tmp_path).returncode == 0
    assert not list(tmp_path.glob("*.part"))
    done = command(*runs, "-o", "five.nc", "--format", "hdf", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, "error: --format hdf: allowed: classic or netcdf4\n")


def test_an_unfinished_run_is_not_compressed(make_scene: MakeScene, tmp_path: Path) -> None:
    run_to_file(make_scene(), tmp_path / "a.nc")
    with netCDF4.Dataset(tmp_path / "a.nc", "a") as out:
        out["status"][...] = 2
    before = (tmp_path / "a.nc").read_bytes()
    with pytest.raises(SceneError, match="its run has not finished; allowed: to resume it first"):
        compress(tmp_path / "a.nc")
    assert (tmp_path / "a.nc").read_bytes() == before


def test_times_go_on_from_another_run(make_scene: MakeScene, tmp_path: Path) -> None:
    """The clock of the second run begins where the first one ended; both, joined, are the run in one piece."""
    accuracy, every = {"rtol": 1e-6}, {"end_time": 1.0, "output_every": 0.25}
    whole = exact.solve(make_scene(accuracy=accuracy, run={"end_time": 1.5, "output_every": 0.25}))
    run_to_file(make_scene(accuracy=accuracy, run=every), tmp_path / "first.nc")
    table = make_scene().model_dump(exclude={"initial"}, exclude_none=True)
    scene = Scene.model_validate(
        {
            **table,
            "accuracy": accuracy,
            "initial": {"file": str(tmp_path / "first.nc"), "time": 1.0},
            "run": {"end_time": 0.5, "output_every": 0.25},
            "output": {"scalars": 0.125},
        }
    )
    run_to_file(scene, tmp_path / "second.nc")
    with open_run(tmp_path / "first.nc") as first, open_run(tmp_path / "second.nc") as second:
        assert second["time"].values.tolist() == [1.0, 1.25, 1.5]
        assert second["time_scalars"].values.tolist() == [1.0, 1.125, 1.25, 1.375, 1.5]
        joined = xr.concat([first["density"], second["density"].isel(time=slice(1, None))], "time")
        assert joined["time"].values.tolist() == whole["time"].values.tolist()
        truth = exact.solve(make_scene(run={"end_time": 1.5, "output_every": 0.25}), x=joined["x"].values)["density"]
        assert float(abs(joined - truth).max()) < 1e-5
        in_memory = solve(scene)
        assert np.array_equal(in_memory["time"], second["time"])
        assert np.array_equal(in_memory["time_scalars"], second["time_scalars"])
        assert not compare(second.load(), in_memory).differ


def test_measured_rates_do_not_depend_on_what_the_clock_said(make_scene: MakeScene) -> None:
    from kinetic_solver.analysis.measured_rates import measured_rates

    more: dict[str, Any] = {"run": {"end_time": 3.0, "output_every": 0.25}, "collisions": FOLLOW}
    modes = [{"mode": 1, "cos": 1e-4}]
    at_0, at_20 = (
        measured_rates(solve(make_scene(initial={"modes": modes, "time": began}, **more)), modes=1) for began in (0.0, 20.0)
    )
    assert float(at_20["growth_rate"][0]) == pytest.approx(float(at_0["growth_rate"][0]), rel=1e-9)
    assert float(at_20["first_time"][0] - at_0["first_time"][0]) == pytest.approx(20.0)


def test_a_run_whose_clock_began_late_is_resumed_with_the_same_bits(make_scene: MakeScene, tmp_path: Path) -> None:
    initial = {"modes": [{"mode": 1, "cos": 0.1}], "time": 2.1}
    run = {"end_time": 0.7, "output_every": 0.1}
    scene = make_scene(initial=initial, run=run, collisions=FOLLOW, particles={"count": 500, "replicas": 2})
    run_to_file(scene, tmp_path / "whole.nc", "particles")
    stops = 0
    while True:
        try:
            run_to_file(scene, tmp_path / "parts.nc", "particles", resume=True, max_walltime=0.0)
            break
        except RunUnfinished:
            stops += 1
            assert stops < 200
    assert stops > 7
    with open_run(tmp_path / "whole.nc") as whole, open_run(tmp_path / "parts.nc") as parts:
        assert parts["time"].values == pytest.approx(2.1 + 0.1 * np.arange(8))
        for name in whole.variables:
            assert np.array_equal(whole[name].values, parts[name].values, equal_nan=True), name
