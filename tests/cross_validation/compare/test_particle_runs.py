"""Runs of particles against the closed form: right scenes pass, planted errors are found."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from kinetic_solver.compare import compare
from kinetic_solver.compare.rows import LEAST_COUNT, MEAN
from kinetic_solver.compare.statistics import beyond
from kinetic_solver.compare.values import TOTALS
from particles.simulation import simulate
from tests.cross_validation.compare.laid_over import (
    FEW,
    FOLLOW,
    GRID,
    HOMOGENEOUS,
    SEEN,
    MakeScene,
    W,
    ensemble,
    fields,
    on_the_grid,
    truth,
)


@pytest.mark.parametrize("nx", [1, 2])
def test_one_point_in_x_of_particles(make_scene: MakeScene, nx: int) -> None:
    """The grid solver and the closed form take one point for a homogeneous scene by themselves."""
    run = ensemble(make_scene(initial=HOMOGENEOUS, particles=FEW, grid={"nx": nx}))
    for other in (truth(make_scene(initial=HOMOGENEOUS)), on_the_grid(make_scene(initial=HOMOGENEOUS))):
        assert not compare(run, other).differ


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


def test_a_density_that_is_not_positive(make_scene: MakeScene) -> None:
    """Too few particles for 33 waves: u and θ are left out with a note, and the rest is compared."""
    changes: dict[str, Any] = {"initial": {"modes": [{"mode": 1, "cos": 1.0}]}, "run": {"end_time": 0.01}}
    found = compare(ensemble(make_scene(**changes, particles={"count": 50, "replicas": 8})), truth(make_scene(**changes)))
    assert {"density", W} <= fields(found) <= {"density", W, *TOTALS}
    assert any(note.startswith("not compared: temperature at t = 0: values are not finite") for note in found.notes)


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
