"""What a comparison gives: its dataset, its table, its picture."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from kinetic_solver.analysis.comparison_figure import comparison_figure
from kinetic_solver.compare import compare
from kinetic_solver.compare.comparison import MOST_LINES
from kinetic_solver.compare.rows import MEAN
from kinetic_solver.compare.statistics import beyond
from tests.cross_validation.compare.laid_over import (
    FEW,
    FOLLOW,
    GRID,
    SEEN,
    MakeScene,
    W,
    ensemble,
    fields,
    on_the_grid,
    raw,
    truth,
)


def test_the_figure_without_a_time(make_scene: MakeScene, run: xr.Dataset) -> None:
    one = raw(run).isel(time=-1, drop=True).assign_attrs(scene=run.attrs["scene"])
    found = compare(one, one)
    assert not found.differ
    assert len(comparison_figure(found).axes) == 8


def test_the_figure_at_a_time_that_f_alone_has(make_scene: MakeScene) -> None:
    """f is worst at t = 0.5, and the moments have frames at 0 and 1.5."""
    scene = make_scene(particles={"count": 40_000, "replicas": 8}, grid={"nx": 5, "nv": 32}, output={"f": 0.5})
    run = ensemble(scene)
    f = run["f"].values.copy()
    f[1] = np.roll(f[1], 1, axis=0)
    found = compare(run.assign(f=run["f"].copy(data=f)), on_the_grid(make_scene(output={"f": 0.5})))
    assert min(found.rows, key=lambda row: row.p).time == 0.5
    assert comparison_figure(found).axes


def test_the_dataset(make_scene: MakeScene) -> None:
    """Names, dimensions, and z, which is what is left of a difference beyond its bound, in standard errors."""
    scene = make_scene(collisions=FOLLOW, particles={"count": 40_000, "replicas": 8}, grid={"nx": 5, "nv": 32})
    found = compare(ensemble(scene), truth(make_scene(collisions=FOLLOW, model={"noise": 0.52})), level=0.02)
    data = found.dataset()
    along = {"density": ("x",), "mean_velocity": ("x",), "temperature": ("x",), W: ("v",), "f": ("x_of_f", "v_of_f")}
    for name, dims in along.items():
        for part in ("difference", "stderr", "z"):
            assert data[f"{name}_{part}"].dims == ("time", *dims)
        for part in ("chi_squared", "statistics", "systematic", "p"):
            assert data[f"{name}_{part}"].dims == ("time",)
        difference, stderr, z = (data[f"{name}_{part}"].values for part in ("difference", "stderr", "z"))
        bound = data[f"{name}_systematic"].values.reshape(-1, *[1] * len(dims))
        counted = np.isfinite(z)
        assert counted.any()
        assert z[counted] == pytest.approx((beyond(difference, bound) / stderr)[counted], rel=1e-8, abs=1e-8)
        assert np.isnan(stderr[~counted]).all()
        row = next(row for row in found.rows if row.field == name and row.time == 1.5)
        assert np.array_equal(difference[-1].ravel(), row.difference)
        assert data[f"{name}_p"].values[-1] == row.p
    assert data["density_mode_z"].dims == ("time", "amplitude_of_density")
    assert data.sizes["amplitude_of_density"] == 4
    assert data.sizes["amplitude_of_temperature"] == 5
    assert data["time"].values.tolist() == [0, 1.5]
    assert data["x"].values == pytest.approx(9 * np.arange(5) / 5)
    assert data.attrs["differ"] == int(found.differ) == 1
    assert data.attrs["level"] == 0.02
    assert data.attrs["p"] == found.p
    assert data.attrs["verdict"] == found.verdict


def test_amplitudes_are_those_of_the_waves(make_scene: MakeScene) -> None:
    """A wave added to one side's shares alone: its amplitude's z changes, that of no other."""
    scene = make_scene(particles=FEW, grid=GRID)
    run, right = ensemble(scene), truth(make_scene())
    wave = 0.05 * np.sin(2 * 2 * np.pi * np.arange(17) / 17)
    more = run.assign({name: run[name].copy(data=run[name].values + wave) for name in ("density", "density_replica")})
    before, after = (
        next(row for row in compare(one, right).rows if row.field == "density").mode_z for one in (run, more)
    )  # 1 is left out: cos, sin, cos 2, sin 2, …
    changed = np.abs(after - before) > 1e-5  # and all by what the bound grows with the largest density
    assert np.flatnonzero(changed).tolist() == [3]
    assert after[3] > before[3] + 5


def test_many_rows_are_cut_to_one_a_field(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, run={"output_every": 0.25})
    wrong = make_scene(collisions={**FOLLOW, "cross_section": 1.212}, run={"output_every": 0.25})
    found = compare(on_the_grid(scene), truth(wrong))
    assert len(found.rows) > MOST_LINES
    lines = found.lines()
    table = [line for line in lines if line.startswith((*SEEN, "f "))]
    assert len(table) == len(fields(found)) == 7
    assert f"the time at which each field differs most, of {len(found.rows)} fields and times" in lines
    rows = [row for row in found.rows if row.field == "density"]
    worst = max(rows, key=lambda row: np.abs(row.difference).max() / row.scale)
    assert ("mean" if worst.time == MEAN else f"{worst.time:9.4g}") in next(line for line in table if line.startswith("density"))
    assert lines[-1] == found.verdict
    short = compare(on_the_grid(make_scene(collisions=FOLLOW)), truth(make_scene(collisions=FOLLOW))).lines()
    assert sum(line.startswith("density") for line in short) == 2
    assert all(len(line) <= 130 for line in lines[2:-1] if not line.startswith(("the scenes", "not compared")))


def test_the_figure(make_scene: MakeScene) -> None:
    """Two rows of four panels, of particles and of two runs without chance."""
    scene = make_scene(collisions=FOLLOW, particles=FEW, grid=GRID)
    for run in (ensemble(scene), on_the_grid(scene)):
        found = compare(run, truth(make_scene(collisions=FOLLOW, model={"noise": 0.55})))
        figure = comparison_figure(found)
        titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
        assert titles == ["density ρ", "mean velocity u", "temperature θ", "w(v)"]
        assert len(figure.axes) == 8
        assert found.verdict in figure.get_suptitle()
