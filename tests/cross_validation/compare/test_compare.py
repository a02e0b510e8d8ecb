"""Datasets laid over each other: right scenes pass, planted errors are found, and what cannot be compared says so."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from kinetic_solver import Scene, SceneError, exact, solve
from kinetic_solver.analysis.comparison_figure import comparison_figure
from kinetic_solver.compare import Comparison, compare
from kinetic_solver.compare.comparison import MOST_LINES
from kinetic_solver.compare.ensembles import PARTS
from kinetic_solver.compare.rows import LEAST_COUNT, MEAN
from kinetic_solver.compare.sides import side_of
from kinetic_solver.compare.statistics import beyond
from kinetic_solver.compare.systematic import CELLS, EXACT, STEP, contact_excess, systematic_parts
from kinetic_solver.compare.values import OVER_X, TOTALS
from kinetic_solver.stability import structure_factor
from particles.plan import make_plan
from particles.simulation import simulate

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
HOMOGENEOUS: dict[str, Any] = {"modes": []}
GRID = {"nx": 17, "nv": 48}
FEW = {"count": 2000, "replicas": 20}
W = "velocity_distribution"
SEEN = {*OVER_X, W, *TOTALS}
"""But for f."""

# Scenes are immutable: one run of each serves all tests.
ensemble, truth, on_the_grid = functools.cache(simulate), functools.cache(exact.solve), functools.cache(solve)


def fields(found: Comparison) -> set[str]:
    return {row.field for row in found.rows}


def times(found: Comparison, field: str | None = None) -> set[float]:
    """Those of a field, or of all; the mean over frames has none."""
    return {row.time for row in found.rows if row.time != MEAN and field in (None, row.field)}


def raw(run: xr.Dataset, names: tuple[str, str] = ("x", "v"), **frame: int) -> xr.Dataset:
    """The positions and velocities of a run alone, in dimensions of other names, without its scene."""
    dimensions = [name if name.startswith("time") else f"{name}_of_raw" for name in run["position"].dims]
    data = {new: (dimensions, run[old].values) for new, old in zip(names, ("position", "velocity"), strict=True)}
    times = [name for name in dimensions if name.startswith("time")]
    return xr.Dataset(data, {name: run[name].values for name in times}).isel({f"{k}_of_raw": n for k, n in frame.items()})


# -- without chance


def test_grid_and_exact(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW)
    found = compare(on_the_grid(scene), truth(scene))
    assert not found.differ
    assert found.p == 1
    assert found.notes == []
    assert fields(found) == {*SEEN, "f"}
    assert times(found) == {0, 1.5}
    assert "no difference found: at most 0.0" in found.verdict
    for row in found.rows:
        assert row.statistics == 0
        assert np.isnan(row.z).all()
        assert np.abs(row.difference).max() < 0.1 * row.bound


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_another_cross_section_on_the_grid(make_scene: MakeScene, factor: float) -> None:
    """1 % of S_C is said in a note, and found at the end, not at the start, which is the same."""
    start = {"mean_velocity": 0.9, "temperature": 0.4}
    right = on_the_grid(make_scene(collisions=FOLLOW, initial=start))
    wrong = truth(make_scene(collisions={**FOLLOW, "cross_section": 1.2 * factor}, initial=start))
    found = compare(right, wrong)
    assert found.differ
    assert found.p == 0
    assert {row.time for row in found.rows if row.p == 0} == {1.5}
    assert f"the scenes differ: collisions.cross_section is 1.2 and {1.2 * factor:g}" in "\n".join(found.notes)


@pytest.mark.parametrize("method", ["grid", "exact", "particles"])
def test_identity(make_scene: MakeScene, method: str) -> None:
    scene = make_scene(collisions=FOLLOW, grid=GRID, particles=FEW)
    run = {"grid": on_the_grid, "exact": truth, "particles": ensemble}[method](scene)
    found = compare(run, run)
    assert not found.differ
    assert found.p == 1
    assert all(not row.difference.any() for row in found.rows)
    if method == "particles":
        assert all(not row.z[np.isfinite(row.z)].any() and not row.mode_z.any() for row in found.rows)


@pytest.mark.parametrize(("first", "second"), [(32, 33), (33, 64), (64, 65), (47, 64)])
def test_two_grids_in_x(make_scene: MakeScene, first: int, second: int) -> None:
    """Even, odd, and different numbers of points, which all hold the waves: only an odd number is compared."""
    runs = [truth(make_scene(initial={"temperature": 0.5}, grid={"nx": nx})) for nx in (first, second)]
    found = compare(*runs)
    assert not found.differ
    points = min(first, second) - 1 + min(first, second) % 2
    for row in found.rows:
        if row.field == "density":
            assert row.points == pytest.approx(9.0 * np.arange(points) / points)


def test_two_grids_in_v(make_scene: MakeScene) -> None:
    """The coarser points that lie in the other's window are taken; splines of the finer are within the bounds."""
    coarse = on_the_grid(make_scene(collisions=FOLLOW))
    fine = on_the_grid(make_scene(collisions=FOLLOW, grid={"nv": 96, "velocity_window": (-3.3, 5.4)}))
    assert coarse["v"].values[0] < fine["v"].values[0]
    found = compare(coarse, fine)
    assert not found.differ
    v = next(row.points for row in found.rows if row.field == W)
    assert np.isin(v, coarse["v"].values).all()
    assert fine["v"].values[0] - 1e-9 <= v[0] <= v[-1] <= fine["v"].values[-1] + 1e-9


def test_resolutions_of_two_grids_are_bounded_by_their_estimates(make_scene: MakeScene) -> None:
    """A run on a coarse grid differs from the exact solution by more than rtol, and its own estimate grants it."""
    scene = make_scene(collisions=FOLLOW, accuracy={"rtol": 1e-2})
    run, right = on_the_grid(scene), truth(scene)
    found = compare(run, right)
    assert not found.differ
    strict = run.drop_vars("error_estimate")
    strict.attrs["scene"] = make_scene(collisions=FOLLOW, accuracy={"rtol": 1e-6}).model_dump_json(exclude_none=True)
    assert compare(strict, right).differ


def test_one_point_in_x(make_scene: MakeScene) -> None:
    scene = make_scene(initial=HOMOGENEOUS, grid={"nx": 1})
    assert not compare(truth(scene), truth(make_scene(initial=HOMOGENEOUS, grid={"nx": 8}))).differ
    assert compare(truth(scene), truth(make_scene(initial=HOMOGENEOUS, model={"noise": 0.51}))).differ


@pytest.mark.parametrize("nx", [1, 2])
def test_one_point_in_x_of_particles(make_scene: MakeScene, nx: int) -> None:
    """The grid solver and the closed form take one point for a homogeneous scene by themselves."""
    run = ensemble(make_scene(initial=HOMOGENEOUS, particles=FEW, grid={"nx": nx}))
    for other in (truth(make_scene(initial=HOMOGENEOUS)), on_the_grid(make_scene(initial=HOMOGENEOUS))):
        assert not compare(run, other).differ


@pytest.mark.parametrize("method", ["grid", "particles"])
def test_a_density_step(make_scene: MakeScene, method: str) -> None:
    """The same scene: values at the points are right, but their waves are not those of the step."""
    scene = make_scene(initial={"modes": [], "step": {"from": 0.3, "to": 0.7, "ratio": 0.3}}, particles=FEW)
    run = on_the_grid(scene) if method == "grid" else ensemble(scene)
    assert not compare(run, truth(scene)).differ


# -- particles against the closed form


@pytest.mark.parametrize("collisions", [None, FOLLOW], ids=["none", "(6)"])
def test_the_right_scene(make_scene: MakeScene, collisions: dict[str, Any] | None) -> None:
    """At level 0.01 none of 8 seeds differs, and the least p is not below 1/8 of it."""
    right = truth(make_scene(collisions=collisions))
    found = [compare(ensemble(make_scene(collisions=collisions, particles={**FEW, "seed": s})), right) for s in range(8)]
    assert not any(one.differ for one in found)
    assert min(one.p for one in found) > 0.01 / 8
    assert all(f"over {len(one.rows)} fields and times, level 0.01" in one.verdict for one in found)


def test_the_right_scene_at_its_rate(make_scene: MakeScene) -> None:
    """Nothing systematic without collisions: of 40 seeds no more than 10 % have p < 0.1, and z² has Student's mean 7/5."""
    right, p, squares = truth(make_scene()), [], []
    for seed in range(40):
        found = compare(
            simulate(make_scene(grid={"nx": 9, "nv": 48}, particles={"count": 1000, "replicas": 8, "seed": seed})), right
        )
        p.append(found.p)
        squares.append([np.nanmean(np.concatenate([row.z, row.mode_z]) ** 2) for row in found.rows if row.field != W])
    assert (np.array(p) < 0.1).sum() <= stats.binom.ppf(0.999, 40, 0.1)
    assert 1.15 < np.mean(squares) < 1.65


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    "wrong",
    [{"collisions": {**FOLLOW, "cross_section": 1.32}}, {"model": {"noise": 0.55}}, {"model": {"gravity": -1.3}}],
    ids=["S_C", "noise", "gravity"],
)
def test_planted_errors(make_scene: MakeScene, wrong: dict[str, Any], seed: int) -> None:
    """10 % of S_C or σ, or the sign of g, with 20 replicas of 2000, whose finite N alone is granted 2 %."""
    run = ensemble(make_scene(collisions=FOLLOW, particles={**FEW, "seed": seed}))
    found = compare(run, truth(make_scene(**{"collisions": FOLLOW, **wrong})))
    assert found.differ
    assert found.p < 1e-3
    assert any(note.startswith("the scenes differ: ") for note in found.notes)


def test_planted_gravity_that_leaves_ranges_empty(make_scene: MakeScene) -> None:
    run = ensemble(make_scene(collisions=FOLLOW, particles={**FEW, "seed": 0}))
    assert compare(run, truth(make_scene(collisions=FOLLOW, model={"gravity": -1.3}))).differ


@pytest.mark.parametrize(("replicas", "nv"), [(40, 64), (20, 32), (12, 16)])
def test_ranges_of_velocity_that_cover_all(make_scene: MakeScene, replicas: int, nv: int) -> None:
    """Right scenes, more replicas than bins of v can be divided for: the sum over all ranges is certain, and no statistic."""
    for seed in range(3):
        scene = make_scene(particles={"count": 1000, "replicas": replicas, "seed": seed}, grid={"nx": 17, "nv": nv})
        assert compare(ensemble(scene), truth(make_scene())).p > 0.01 / 3


def test_f_at_an_even_number_of_points(make_scene: MakeScene) -> None:
    """The right scene, whose wave is the highest that 4 points hold."""
    changes: dict[str, Any] = {"initial": {"modes": [{"mode": 2, "cos": 0.8}]}, "run": {"end_time": 0.2}}
    run = ensemble(make_scene(**changes, particles={"count": 50_000, "replicas": 8}, grid={"nx": 4, "nv": 48}))
    found = compare(run, truth(make_scene(**changes)))
    assert "f" in fields(found)
    assert not found.differ


def test_a_cold_wave_of_velocity(make_scene: MakeScene) -> None:
    """The right scene, where f is narrow in v everywhere and w(v) is wide; bins twice √θ."""
    changes: dict[str, Any] = {
        "initial": {"mean_velocity": 0.0, "temperature": 0.05, "velocity_modes": [{"mode": 1, "sin": 2.0}]},
        "run": {"end_time": 0.1},
    }
    run = ensemble(make_scene(**changes, particles={"count": 50_000, "replicas": 16}, grid={"nx": 17, "nv": 16}))
    assert not compare(run, truth(make_scene(**changes))).differ


def test_a_long_step_is_within_its_bound(make_scene: MakeScene) -> None:
    """The right scene with ε = 0 and a step as long as the shortest time, for which the bound is there."""
    changes: dict[str, Any] = {
        "collisions": {"operator": "inelastic", "cross_section": 0.7 / math.sqrt(0.5) / 0.8, "restitution": 0.0},
        "initial": {"mean_velocity": 0.9, "temperature": 0.4},
    }
    particles = {"count": 50_000, "replicas": 16, "time_step": 0.75, "cells": 60}
    found = compare(ensemble(make_scene(**changes, particles=particles, grid=GRID)), on_the_grid(make_scene(**changes)))
    assert not found.differ


def test_f_is_compared_where_there_are_particles(make_scene: MakeScene) -> None:
    """z of f and w(v) where a cell or a bin of a replica expects 50 particles, and nowhere else."""
    right = truth(make_scene())
    run = ensemble(make_scene(particles={"count": 40_000, "replicas": 8}, grid={"nx": 5, "nv": 32}))
    found = compare(run, right)
    assert not found.differ
    for row in found.rows:
        if row.field in ("f", W):
            expected = 40_000 * np.maximum(row.second, 0) / np.maximum(row.second, 0).sum()
            assert np.array_equal(np.isfinite(row.z), expected >= LEAST_COUNT)
            assert 0 < np.isfinite(row.z).sum() < row.z.size
    few = compare(ensemble(make_scene(particles=FEW, grid=GRID)), right)
    assert "f" not in fields(few)
    assert f"not compared: f at t = 0, 1.5: no cell of x and v holds {LEAST_COUNT} particles of a replica" in "\n".join(few.notes)


def test_errors_of_f_alone_are_found(make_scene: MakeScene) -> None:
    """f moved by one cell in x, all else as it was: nothing but the test of f can see it."""
    run = ensemble(make_scene(particles={"count": 40_000, "replicas": 8}, grid={"nx": 5, "nv": 32}))
    moved = run.assign(f=run["f"].copy(data=np.roll(run["f"].values, 1, axis=1)))
    found = compare(moved, truth(make_scene()))
    assert found.differ
    assert {row.field for row in found.rows if row.p < 1e-3} == {"f"}


def test_two_runs_of_particles(make_scene: MakeScene) -> None:
    """Other seeds agree; more replicas and other grids too; another scene does not."""
    first = ensemble(make_scene(particles=FEW))
    for particles, grid in (({**FEW, "seed": 2}, {}), ({"count": 3000, "replicas": 8, "seed": 3}, GRID)):
        found = compare(first, ensemble(make_scene(particles=particles, grid=grid)))
        assert not found.differ
        assert found.p > 0.01 / 2
    other_grids = [note for note in found.notes if "f, which two particle runs have on different grids" in note]
    assert len(other_grids) == 1
    assert compare(first, ensemble(make_scene(model={"noise": 0.6}, particles={**FEW, "seed": 2}))).differ


def test_the_mean_over_frames(make_scene: MakeScene) -> None:
    """Of the frames after the first: each replica's mean is its share; in the dataset beside the frames."""
    scene = make_scene(particles={**FEW, "seed": 2}, grid=GRID, run={"output_every": 0.5})
    run, right = ensemble(scene), truth(make_scene(run={"output_every": 0.5}))
    found = compare(run, right)
    assert not found.differ
    assert {row.field for row in found.rows if row.time == MEAN} == SEEN
    row = next(row for row in found.rows if row.time == MEAN and row.field == "density")
    assert row.first == pytest.approx(run["density"].values[1:].mean(axis=0))
    shares = run["density_replica"].values[1:].mean(axis=0)
    assert row.error == pytest.approx(shares.std(axis=0, ddof=1) / math.sqrt(20), rel=1e-6)
    data = found.dataset()
    assert data["density_z_of_mean"].dims == ("x",)
    assert np.array_equal(data["density_z_of_mean"].values, row.z)
    assert data["time"].values.tolist() == [0, 0.5, 1.0, 1.5]
    assert not any(row.time == MEAN for row in compare(ensemble(make_scene(particles=FEW)), truth(make_scene())).rows)


def test_mean_and_variance_of_all_velocities(make_scene: MakeScene) -> None:
    """Against the particles themselves, pooled; standard errors by leaving out one replica at a time (the jackknife)."""
    run = ensemble(make_scene(particles={"count": 3000, "replicas": 8}, grid=GRID, output={"particles": True}))
    found = compare(run, truth(make_scene()))
    velocities = run["velocity"].values[-1]
    for name, moment in zip(TOTALS, (np.mean, np.var), strict=True):
        row = next(row for row in found.rows if row.field == name and row.time == 1.5)
        without = np.array([moment(np.delete(velocities, n, axis=0)) for n in range(8)])
        assert row.first == pytest.approx(moment(velocities), rel=1e-10)
        assert row.error == pytest.approx(math.sqrt(7 / 8 * ((without - without.mean()) ** 2).sum()), rel=0.01)
        assert row.z == pytest.approx((beyond(row.difference, row.bound) / row.error), rel=1e-6)
    wrong = compare(run, truth(make_scene(model={"noise": 0.53})))
    assert next(row for row in wrong.rows if row.field == "variance_of_all" and row.time == 1.5).p < 1e-2


def test_the_mean_over_many_frames(make_scene: MakeScene) -> None:
    """The right scene, stationary, 20 replicas of 40 on 33 points: 24 particles a point, 200 frames."""
    changes: dict[str, Any] = {"initial": {"modes": [{"mode": 1, "cos": 1e-6}]}, "run": {"end_time": 200.0, "output_every": 1.0}}
    changes["output"] = {"f": False}
    run = ensemble(make_scene(**changes, particles={"count": 40, "replicas": 20}, grid={"nx": 33, "nv": 32}))
    still = truth(make_scene(**{**changes, "run": {"end_time": 1.0}}, grid={"nx": 33})).isel(time=[1])
    right = xr.concat(
        [still.assign_coords(time=[t]) for t in run["time"].values],
        "time",
        data_vars="minimal",
        coords="minimal",
        compat="override",
    )
    assert not compare(run, right).differ


def test_velocities_far_apart(make_scene: MakeScene) -> None:
    run = ensemble(make_scene(model={"gravity": 10.0}, particles=FEW))
    assert compare(run, truth(make_scene(model={"gravity": -10.0}))).differ


# -- positions and velocities


@pytest.fixture
def run(make_scene: MakeScene) -> xr.Dataset:
    return ensemble(make_scene(particles={"count": 3000, "replicas": 8}, grid=GRID, output={"particles": True}))


@pytest.mark.parametrize("names", [("x", "v"), ("position", "velocity")])
@pytest.mark.parametrize("shape", ["times, replicas", "replicas"])
def test_raw_particles_are_those_of_their_run(run: xr.Dataset, names: tuple[str, str], shape: str) -> None:
    """The same points and the same standard errors as the run's own, w(v) but for particles outside its window."""
    particles = raw(run, names)
    if shape == "replicas":
        particles = particles.isel(time=-1, drop=True)
    found = compare(particles, run)
    assert not found.differ
    assert times(found) == ({0, 1.5} if shape == "times, replicas" else {1.5})
    assert ("A has no time" in "\n".join(found.notes)) == (shape == "replicas")
    for row in found.rows:
        assert row.field != "f"
        assert row.first == pytest.approx(row.second, abs=1e-10 * row.scale)
        if row.field in TOTALS:
            continue
        stderr = run[f"{row.field}_stderr"].sel(time=row.time).values
        counted = np.isfinite(row.error)
        expected = math.sqrt(2) * stderr
        if row.field == W:  # not below that of counts
            weight, dv = 0.8 * 9 / run["position"][0].size, float(run["v"][1] - run["v"][0])
            expected = np.maximum(expected, np.sqrt(2 * np.maximum(row.second, 0) * weight / dv))
        assert row.error[counted] == pytest.approx(expected[counted], rel=1e-8)


@pytest.mark.parametrize("order", ["as they are", "by position", "by velocity", "mixed"])
def test_the_order_of_a_single_ensemble(make_scene: MakeScene, run: xr.Dataset, order: str) -> None:
    """One ensemble of 3000: agrees in any order, and a wrong one is found in any order."""
    right = truth(make_scene())
    one = raw(run, replica=0).isel(time=-1, drop=True)
    x, v = one["x"].values, one["v"].values
    for moved in (False, True):
        rng = np.random.default_rng(1)
        index = {
            "as they are": np.arange(x.size),
            "by position": np.argsort(x),
            "by velocity": np.argsort(v),
            "mixed": rng.permutation(x.size),
        }[order]
        particles = xr.Dataset({"x": ("n", x[index]), "v": ("n", v[index] + 0.15 * moved)})
        found = compare(particles, right)
        assert found.differ == moved
        assert "3000 particles, one ensemble" in found.sides[0]


def test_a_single_ensemble_is_as_uncertain_as_it_is(make_scene: MakeScene, run: xr.Dataset) -> None:
    """Without collisions the parts' errors are those of independent particles: z² has Student's mean 19/17."""
    right, squares = truth(make_scene()), []
    for replica in range(8):
        found = compare(raw(run, replica=replica), right)
        squares += [np.mean(row.z**2) for row in found.rows if row.field == "density"]
        assert found.p > 0.01 / 8
    assert np.mean(squares) == pytest.approx((PARTS - 1) / (PARTS - 3), rel=0.3)


def test_collisions_make_a_single_ensemble_less_certain(make_scene: MakeScene) -> None:
    """By S(k) of the scene, which raw particles take from the other side."""
    rng = np.random.default_rng(0)
    particles = xr.Dataset({"x": ("n", rng.uniform(0, 9, 4000)), "v": ("n", rng.normal(1.0, 0.7, 4000))})
    scene = make_scene(collisions=FOLLOW)
    found, without = (compare(particles, truth(one)) for one in (scene, make_scene()))
    ratio = (found.rows[0].error / without.rows[0].error) ** 2
    assert ratio == pytest.approx(float(structure_factor(scene, range(1, 9)).max()))
    assert ratio[0] > 2


def test_a_wrong_ensemble_is_found(make_scene: MakeScene) -> None:
    """Replicas of uniform positions and Gaussian velocities, in a scene with waves; in their own scene they pass."""
    rng = np.random.default_rng(3)
    u, theta = 1.3 / 0.7, 0.5
    x, v = rng.uniform(-18, 18, (8, 2000)), rng.normal(u, math.sqrt(theta), (8, 2000))
    particles = xr.Dataset({"x": (("replica", "n"), np.mod(x, 9.0)), "v": (("replica", "n"), v)})
    flat = truth(make_scene(initial={"modes": [{"mode": 1, "cos": 1e-6}]}, grid={"nx": 33}))
    assert not compare(particles, flat).differ
    assert compare(particles, truth(make_scene()), time=0.0).differ
    assert compare(particles.assign(v=1.05 * particles["v"]), flat).differ


def test_the_time_of_what_has_none(make_scene: MakeScene, run: xr.Dataset) -> None:
    """The first frame is that of t = 0 if told so, and differs from the last, which it is taken for."""
    first = raw(run).isel(time=0, drop=True)
    assert not compare(first, truth(make_scene()), time=0.0).differ
    assert compare(first, truth(make_scene())).differ
    with pytest.raises(
        SceneError, match=r"nothing to compare: not compared: 3 times that one of them alone has \(t = 0, 0\.5, 1\.5\)"
    ):
        compare(first, truth(make_scene()), time=0.5)
    scalar = raw(run).isel(time=0)
    found = compare(scalar, truth(make_scene()))
    assert not found.differ
    assert times(found) == {0}


@pytest.mark.parametrize("count", [3, 4, 19])
def test_an_ensemble_of_very_few(make_scene: MakeScene, count: int) -> None:
    """Fewer than four have no two parts with an error each."""
    rng = np.random.default_rng(count)
    particles = xr.Dataset({"x": ("n", rng.uniform(0, 9, count)), "v": ("n", rng.normal(2, 0.7, count))})
    if count == 3:
        with pytest.raises(SceneError, match="B: 3 particles have no standard errors; allowed: 4 or more, or replicas"):
            compare(truth(make_scene()), particles)
    else:
        assert not compare(truth(make_scene(initial=HOMOGENEOUS)), particles).differ


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


def test_raw_particles_of_a_stopped_run(make_scene: MakeScene) -> None:
    """A cadence of its own has frames to come, which are NaN: those that are there are compared."""
    scene = make_scene(particles={"count": 3000}, output={"particles": 0.5}, grid=GRID)
    stopped = ensemble(scene).copy(deep=True)
    assert stopped["position"].dims[0] == "time_particles"
    for name in ("position", "velocity"):
        stopped[name][-1] = np.nan
    found = compare(stopped, truth(make_scene(run={"output_every": 0.5})))
    assert times(found) == {0, 0.5, 1.0}


def test_mean_velocities_are_relative_to_the_thermal_one(make_scene: MakeScene) -> None:
    """The scale of u is the larger of |u| and √θ, of f and ρ their largest values."""
    scene = make_scene(model={"gravity": 0.0}, collisions=FOLLOW)
    right = truth(scene)
    for row in compare(right, right).rows:
        name = row.field
        if name in TOTALS:
            continue
        values = np.abs(right[name].sel(time=row.time).values)
        theta = right["temperature"].sel(time=row.time)
        expected = max(values.max(), math.sqrt(theta.max())) if name == "mean_velocity" else None
        assert row.scale == pytest.approx(values.max() if expected is None else expected, rel=2e-3)
        assert row.bound == pytest.approx(2 * EXACT * row.scale)


def test_mean_velocities_of_raw_particles_are_relative_to_the_thermal_one(make_scene: MakeScene) -> None:
    scene = make_scene(
        model={"gravity": 0.0}, initial=HOMOGENEOUS, particles={"count": 20_000}, output={"particles": True}, grid=GRID
    )
    one = ensemble(scene)
    row = next(row for row in compare(one, one).rows if row.field == "mean_velocity")
    assert row.scale > 0.9 * math.sqrt(0.5)


# -- times, groups, refusals


def test_cadences_of_their_own(make_scene: MakeScene) -> None:
    """f every 1, moments every 0.5, and at the end; times of one alone are said, not compared."""
    scene = make_scene(output={"f": 1.0, "moments": 0.5})
    run = on_the_grid(scene)
    found = compare(run, run)
    assert times(found, "density") == {0, 0.5, 1.0, 1.5}
    assert times(found, "f") == {0, 1.0, 1.5}
    assert found.notes == []
    found = compare(run, truth(make_scene(run={"output_every": 0.75})))
    assert times(found) == {0, 1.5}
    assert "not compared: 3 times that one of them alone has (t = 0.5, 0.75, 1)" in found.notes
    assert not found.differ
    found = compare(run, truth(make_scene(run={"output_every": 0.1})))
    assert any(note.endswith("…)") and note.startswith("not compared: 12 times") for note in found.notes)


def test_a_run_without_f(make_scene: MakeScene) -> None:
    found = compare(on_the_grid(make_scene(output={"f": False})), truth(make_scene()))
    assert not found.differ
    assert "f" not in fields(found)
    assert any("not compared" in note for note in found.notes)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ({"pipe": {"length": 9.1}}, {}, "pipe.length: 9.1 in A, 9 in B; allowed: the same"),
        ({"output": {"moments": False}}, {}, "A: has neither density over"),
        ({"run": {"end_time": 0.5}, "output": {"moments": 0.5}}, None, "nothing to compare: not compared: 3 times"),
    ],
    ids=["length", "no moments", "no time"],
)
def test_refusals_of_runs(make_scene: MakeScene, first: dict[str, Any], second: dict[str, Any] | None, message: str) -> None:
    other = truth(make_scene(**(second or {})))
    if second is None:
        other = other.isel(time=[1])
    with pytest.raises(SceneError, match=message):
        compare(truth(make_scene(**first)), other)


def test_refusals_of_particles(make_scene: MakeScene, run: xr.Dataset) -> None:
    with pytest.raises(SceneError, match="A, B: neither has a scene, so the period is not known"):
        compare(raw(run), raw(run))
    one = ensemble(make_scene(particles={"count": 2000}, grid=GRID))
    with pytest.raises(SceneError, match=r"A: one replica gives no standard errors; set particles.replicas = 8, or output"):
        compare(one, truth(make_scene()))
    lost = raw(run).copy(deep=True)
    lost["x"][0, 0, 0] = np.nan
    with pytest.raises(SceneError, match="A: positions or velocities at t = 0 are not finite"):
        compare(lost, truth(make_scene()))
    deep = raw(run).expand_dims("more", axis=1)
    with pytest.raises(SceneError, match=r"allowed: \(time,\) \(replica,\) particle"):
        compare(deep, truth(make_scene()))


def test_refusals_of_files(make_scene: MakeScene, tmp_path: Path) -> None:
    right = truth(make_scene())
    with pytest.raises(SceneError, match=r"none\.nc: there is no such file"):
        compare(tmp_path / "none.nc", right)
    (tmp_path / "text.nc").write_text("nonsense")
    with pytest.raises(SceneError, match=r"text\.nc: is not a readable netCDF file"):
        compare(right, str(tmp_path / "text.nc"))
    xr.Dataset({"a": ("n", [1.0])}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(SceneError, match=r"other\.nc: has neither density"):
        compare(right, tmp_path / "other.nc")


def test_a_scene_that_is_none(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match="A: its scene cannot be read"):
        compare(truth(make_scene()).assign_attrs(scene="{}"), truth(make_scene()))


def test_a_density_that_is_not_positive(make_scene: MakeScene) -> None:
    """Too few particles for 33 waves: u and θ are left out with a note, and the rest is compared."""
    changes: dict[str, Any] = {"initial": {"modes": [{"mode": 1, "cos": 1.0}]}, "run": {"end_time": 0.01}}
    found = compare(ensemble(make_scene(**changes, particles={"count": 50, "replicas": 8})), truth(make_scene(**changes)))
    assert {"density", W} <= fields(found) <= {"density", W, *TOTALS}
    assert any(note.startswith("not compared: temperature at t = 0: values are not finite") for note in found.notes)


# -- what a comparison gives


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


# -- what is known beforehand


def test_systematic_parts(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, particles=FEW)
    plan = make_plan(scene)
    run = ensemble(scene)
    assert systematic_parts(truth(scene), scene) == {"closed form": EXACT}
    found = systematic_parts(run, scene)
    assert list(found) == ["step", "cells", "finite N"]
    assert found["step"] == STEP * plan.relative_step**2
    assert found["cells"] == CELLS * plan.relative_width**2
    assert found["finite N"] == contact_excess(scene, plan.cells)
    assert systematic_parts(ensemble(make_scene(particles=FEW)), make_scene(particles=FEW)) == {"exact steps": 0}
    grid = on_the_grid(make_scene(collisions=FOLLOW))
    assert systematic_parts(grid, scene) == {"grid": max(1e-4, float(np.nanmax(grid["error_estimate"])))}
    assert systematic_parts(grid.drop_vars("error_estimate"), scene) == {"grid": 1e-4}
    side = side_of(run, "A")
    assert side.bound == sum(found.values())
    assert side_of(raw(ensemble(make_scene(particles=FEW, output={"particles": True}))), "A").bound == 0


def with_collisions(make_scene: MakeScene, number: float, **changes: Any) -> Scene:
    table = {"operator": "follow-the-leader", "cross_section": number * 0.7 / math.sqrt(0.5) / 0.8}
    return make_scene(**{"collisions": table, "particles": {"count": 1000}, **changes})


@pytest.mark.parametrize("number", [0.3, 1.0, 2.0])
def test_the_excess_of_pairs_at_contact(make_scene: MakeScene, number: float) -> None:
    """(2/N) Σ (S_m - 1): at least the sum to the wave as long as a cell, within 5 %, and as 1/N."""
    scene = with_collisions(make_scene, number)
    for cells in (1, 20, 50):
        waves = range(1, max(cells, 8) + 1)
        direct = 2 / 1000 * float((structure_factor(scene, waves).values - 1).sum())
        assert 0.999 * direct < contact_excess(scene, cells) < 1.05 * direct
    double = with_collisions(make_scene, number, particles={"count": 2000})
    assert contact_excess(double, 20) == pytest.approx(contact_excess(scene, 20) / 2)
    assert contact_excess(with_collisions(make_scene, number, model={"friction": 0.0}), 20) == 0


@pytest.mark.parametrize(("kind", "least"), [("single-file", 1000), ("dsmc", 400)])
def test_waves_of_pairs_at_contact(make_scene: MakeScene, kind: str, least: int) -> None:
    """Single files see the distance between neighbours, 1000 waves here; 400 cells see 400."""
    scene = with_collisions(
        make_scene, 1.0, particles={"count": 1000, "collisions": kind} | ({"cells": 400} if kind == "dsmc" else {})
    )
    direct = 2 / 1000 * float((structure_factor(scene, range(1, least + 1)).values - 1).sum())
    part = systematic_parts(ensemble(scene), scene)["finite N"]
    assert direct < part < 1.2 * direct


@pytest.mark.parametrize(("count", "replicas"), [(300, 20), (100, 20)])
def test_few_particles_are_granted_their_correlations(make_scene: MakeScene, count: int, replicas: int) -> None:
    """The right scene with so few particles that (2), which knows no correlations, is off by more than the scatter."""
    scene = make_scene(collisions=FOLLOW, particles={"count": count, "replicas": replicas}, grid={"nx": 9, "nv": 64})
    assert not compare(ensemble(scene), truth(make_scene(collisions=FOLLOW))).differ


@pytest.mark.parametrize("seed", [102, 112, 137, 141, 148, 150])
def test_replicas_that_count_the_same(make_scene: MakeScene, seed: int) -> None:
    """Two replicas with the same number at some v have no scatter there; these seeds have such a v."""
    scene = make_scene(particles={"count": 2000, "replicas": 2, "seed": seed})
    assert not compare(ensemble(scene), on_the_grid(make_scene())).differ


def test_a_density_step_later_on(make_scene: MakeScene) -> None:
    """Default points of the closed form do not hold the waves of f: what they may do is granted, or f is left out."""
    initial = {"modes": [], "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}}
    scene = make_scene(initial=initial, pipe={"length": 25.0}, run={"output_every": 0.5})
    found = compare(on_the_grid(scene), truth(scene))
    assert not found.differ
    assert len(found.rows) > 5


def test_values_that_are_not_finite(make_scene: MakeScene) -> None:
    right = truth(make_scene())
    for name, said in ((W, "w(v) at t = 1.5"), ("f", "f at t = 1.5"), ("temperature", "temperature at t = 1.5")):
        values = right[name].values.copy()
        values[-1].flat[3] = np.nan
        for pair in (
            (right.assign({name: right[name].copy(data=values)}), right),
            (right, right.assign({name: right[name].copy(data=values)})),
        ):
            found = compare(*pair)
            assert not found.differ
            assert any(note.startswith(f"not compared: {said}") for note in found.notes), found.notes


def test_a_bound_that_allows_everything_is_no_agreement(make_scene: MakeScene) -> None:
    """At R* = 3 with 50 particles the excess of pairs at contact is beyond 1: nothing is left to be compared."""
    scene = with_collisions(make_scene, 3.0, particles={"count": 50, "replicas": 20}, grid=GRID)
    with pytest.raises(SceneError, match=r"nothing to compare: .*not compared: density, .*: the systematic part may be"):
        compare(ensemble(scene), truth(with_collisions(make_scene, 3.0)))


def test_a_time_for_what_has_times(make_scene: MakeScene) -> None:
    with pytest.raises(SceneError, match=r"time = 77: both have times of their own"):
        compare(truth(make_scene()), on_the_grid(make_scene()), time=77.0)


def test_the_time_may_be_in_the_middle(make_scene: MakeScene, run: xr.Dataset) -> None:
    particles = raw(run)
    turned = particles.transpose(*sorted(map(str, particles["x"].dims), reverse=True))
    assert times(compare(turned, run)) == {0, 1.5}


def test_steps_are_those_that_are_taken(make_scene: MakeScene) -> None:
    """Frames cut a longer step short."""
    given = {"count": 1000, "time_step": 50.0}
    plan = make_plan(make_scene(collisions=FOLLOW, particles=given, run={"output_every": 0.5}))
    assert plan.longest_step == 0.5
    assert plan.relative_step == pytest.approx(0.5 * plan.fastest)
