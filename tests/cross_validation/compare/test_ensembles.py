"""Positions and velocities alone: their fields are made here, with errors from replicas or from parts of one ensemble."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import SceneError
from kinetic_solver.compare import compare
from kinetic_solver.compare.ensembles import PARTS
from kinetic_solver.compare.values import TOTALS
from kinetic_solver.stability import structure_factor
from tests.cross_validation.compare.laid_over import FOLLOW, GRID, HOMOGENEOUS, MakeScene, W, ensemble, raw, times, truth


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


def test_a_snapshot_says_how_little_it_can_tell(make_scene: MakeScene) -> None:
    """Of independent particles: density in 16 waves known to √(33/N), twice that as a share of its maximum; a hundred times as
    many in replicas tell a tenth of it apart."""
    right, rng = truth(make_scene(initial=HOMOGENEOUS, grid={"nx": 33, "nv": 48})), np.random.default_rng(3)

    def cloud(*shape: int) -> xr.Dataset:
        dims = ("replica", "n")[-len(shape) :]
        return xr.Dataset({"x": (dims, rng.uniform(0, 9, shape)), "v": (dims, rng.normal(1.3 / 0.7, math.sqrt(0.5), shape))})

    few, many = compare(right, cloud(2000), time=0.0), compare(right, cloud(8, 25_000), time=0.0)
    density = next(row for row in few.rows if row.field == "density")
    expected = 2 * math.sqrt(density.points.size / 2000) * 0.8 / density.scale
    assert 0.7 * expected < few.hidden < 2.5 * expected
    assert (few.differ, few.conclusive) == (False, False)
    assert few.verdict.startswith(f"inconclusive: differences below {100 * few.hidden:.2g} % cannot be judged")
    assert (many.differ, many.conclusive) == (False, True)
    assert many.hidden == pytest.approx(few.hidden / 10, rel=0.4)


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


def test_raw_particles_of_a_stopped_run(make_scene: MakeScene) -> None:
    """A cadence of its own has frames to come, which are NaN: those that are there are compared."""
    scene = make_scene(particles={"count": 3000, "replicas": 1}, output={"particles": 0.5}, grid=GRID)
    stopped = ensemble(scene).copy(deep=True)
    assert stopped["position"].dims[0] == "time_particles"
    for name in ("position", "velocity"):
        stopped[name][-1] = np.nan
    found = compare(stopped, truth(make_scene(run={"output_every": 0.5})))
    assert times(found) == {0, 0.5, 1.0}


def test_mean_velocities_of_raw_particles_are_relative_to_the_thermal_one(make_scene: MakeScene) -> None:
    scene = make_scene(
        model={"gravity": 0.0},
        initial=HOMOGENEOUS,
        particles={"count": 20_000, "replicas": 1},
        output={"particles": True},
        grid=GRID,
    )
    one = ensemble(scene)
    row = next(row for row in compare(one, one).rows if row.field == "mean_velocity")
    assert row.scale > 0.9 * math.sqrt(0.5)


def test_the_time_may_be_in_the_middle(make_scene: MakeScene, run: xr.Dataset) -> None:
    particles = raw(run)
    turned = particles.transpose(*sorted(map(str, particles["x"].dims), reverse=True))
    assert times(compare(turned, run)) == {0, 1.5}
