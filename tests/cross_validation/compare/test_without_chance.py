"""Grid runs and the closed form laid over each other: no chance, so every difference counts that a bound does not allow."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinetic_solver.compare import compare
from kinetic_solver.compare.systematic import EXACT
from kinetic_solver.compare.values import TOTALS
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
    times,
    truth,
)


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


@pytest.mark.parametrize("method", ["grid", "particles"])
def test_a_density_step(make_scene: MakeScene, method: str) -> None:
    """The same scene: values at the points are right, but their waves are not those of the step."""
    scene = make_scene(initial={"modes": [], "step": {"from": 0.3, "to": 0.7, "ratio": 0.3}}, particles=FEW)
    run = on_the_grid(scene) if method == "grid" else ensemble(scene)
    assert not compare(run, truth(scene)).differ


def test_velocities_far_apart(make_scene: MakeScene) -> None:
    run = ensemble(make_scene(model={"gravity": 10.0}, particles=FEW))
    assert compare(run, truth(make_scene(model={"gravity": -10.0}))).differ


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
