"""solve, simulate and run_to_file from an f(x, v) that the user hands over: a callable or a DataArray."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, initial, run_to_file, solve
from kinetic_solver.errors import RunUnfinished
from kinetic_solver.plan import make_plan
from particles import simulate

MakeScene = Callable[..., Scene]
F = Callable[[np.ndarray, np.ndarray], np.ndarray]
START: dict[str, Any] = {
    "modes": [],
    "pulse": {"at": 0.9, "width": 0.06, "height": 2.5},
    "beams": [
        {"share": 0.35, "mean_velocity": -1.7, "temperature": 0.2},
        {"share": 0.65, "mean_velocity": 1.4, "temperature": 0.6},
    ],
}
FOLLOW = {"operator": "follow-the-leader", "cross_section": 0.6}
INELASTIC = {"operator": "inelastic", "cross_section": 0.5, "restitution": 0.4}


def bare(scene: Scene) -> Scene:
    """The same without [initial]."""
    return Scene.model_validate(scene.model_dump(exclude={"initial"}, exclude_none=True))


def function_of(scene: Scene) -> F:
    def two_beams(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return initial.distribution(scene, x[:, 0], v[0])

    return two_beams


def array_of(scene: Scene, first: float = 0.0, points: int = 70) -> xr.DataArray:
    x, v = 9.0 / points * (np.arange(points) + first), np.linspace(-6.5, 7.5, 160)
    return xr.DataArray(function_of(scene)(x[:, None], v[None]), {"x": x, "v": v}, ("x", "v"), name="beams")


def worst(run: xr.Dataset, scene: Scene) -> float:
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)
    return float((abs(run["f"] - truth["f"]).max(["x", "v"]) / truth["f"].max(["x", "v"])).max())


@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
@pytest.mark.parametrize("cross_section", [0.0, 0.6, 2.0])
def test_a_callable_against_the_closed_form(make_scene: MakeScene, cross_section: float, rtol: float) -> None:
    """On no more points than the scene's own start takes, but for a few."""
    scene = make_scene(
        collisions={**FOLLOW, "cross_section": cross_section},
        initial=START,
        accuracy={"rtol": rtol},
        run={"end_time": 1.0, "output_every": 0.5},
    )
    run = solve(bare(scene), initial=function_of(scene))
    assert worst(run, scene) <= rtol
    assert float(run["error_estimate"].max()) < 3 * rtol
    assert run["mass"].values == pytest.approx(0.8 * 9.0, rel=rtol)
    assert np.ptp(run["mass"].values) < 1e-12
    own, found = make_plan(scene).grid, make_plan(bare(scene), given=function_of(scene)).grid
    assert found.nx == own.nx
    assert 0.8 * own.nv < found.nv < 1.2 * own.nv


@pytest.mark.parametrize(
    "model",
    [{"noise": 0.0}, {"friction": 0.0}, {"friction": 0.0, "gravity": 0.0, "noise": 0.0}, {"gravity": 40.0}],
    ids=["no noise", "no friction", "free", "strong gravity"],
)
def test_in_moving_frames_and_without_noise(make_scene: MakeScene, model: dict[str, float]) -> None:
    scene = make_scene(model=model, collisions=FOLLOW, initial=START, accuracy={"rtol": 1e-5}, run={"end_time": 0.8})
    plan = make_plan(bare(scene), given=function_of(scene))
    assert plan.reference_frame.moving == (model.get("gravity") != 0.0)
    assert worst(solve(bare(scene), initial=function_of(scene)), scene) <= 1e-5


def test_in_hermite_functions(make_scene: MakeScene) -> None:
    start = {"modes": [{"mode": 1, "cos": 0.3}], "mean_velocity": 1.5, "temperature": 0.4}
    scene = make_scene(
        collisions={**FOLLOW, "cross_section": 0.3},
        initial=start,
        grid={"velocity": "hermite"},
        accuracy={"rtol": 1e-6},
        run={"end_time": 0.7},
    )
    assert worst(solve(bare(scene), initial=function_of(scene)), scene) <= 1e-6


@pytest.mark.parametrize("first", [0.0, 0.5], ids=["from 0", "cell centres"])
@pytest.mark.parametrize("points", [69, 70])
def test_a_data_array_against_the_closed_form(make_scene: MakeScene, first: float, points: int) -> None:
    scene = make_scene(collisions=FOLLOW, initial=START, accuracy={"rtol": 1e-7}, run={"end_time": 0.8})
    array = array_of(scene, first, points)
    run = solve(bare(scene), initial=array)
    assert worst(run, scene) <= 1e-7
    assert np.array_equal(run["f"], solve(bare(scene), initial=array.transpose("v", "x"))["f"])


def test_a_run_goes_on_from_the_last_frame_of_another(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, accuracy={"rtol": 1e-5}, run={"end_time": 1.0, "output_every": 0.5})
    half = solve(scene.model_copy(update={"run": scene.run.model_copy(update={"end_time": 0.5})}))
    rest = bare(scene.model_copy(update={"run": scene.run.model_copy(update={"end_time": 0.5})}))
    run = solve(rest, initial=half["f"].isel(time=-1))
    truth = exact.solve(scene, x=run["x"].values, v=run["v"].values)["f"].isel(time=-1)
    assert float(abs(run["f"].isel(time=-1) - truth).max() / truth.max()) < 2e-5


def test_a_homogeneous_start_has_one_place(make_scene: MakeScene) -> None:
    def flat(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 0.7 * np.exp(-(v**4))

    run = solve(bare(make_scene(collisions=INELASTIC, accuracy={"rtol": 1e-4})), initial=flat)
    assert run.sizes["x"] == 1
    v = run["v"].values
    assert run["f"].values[0, 0] == pytest.approx(0.7 * np.exp(-(v**4)), rel=1e-6, abs=1e-6)
    # Γ(3/4)/Γ(1/4): the variance of exp(-v⁴).
    assert run["temperature"].values[0, 0] == pytest.approx(0.337989120, rel=1e-4)


def test_inelastic_from_a_callable_is_inelastic_from_the_scene(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=INELASTIC, initial=START, accuracy={"rtol": 1e-4}, run={"end_time": 0.4})
    ours, theirs = solve(bare(scene), initial=function_of(scene)), solve(scene)
    for name in ("density", "mean_velocity", "temperature"):
        assert float(abs(ours[name] - theirs[name]).max() / abs(theirs[name]).max()) < 2e-4, name


def test_what_a_dataset_says_of_it(make_scene: MakeScene, tmp_path: Path) -> None:
    scene = make_scene(initial=START, run={"end_time": 0.2}, particles={"count": 500})
    f, array = function_of(scene), array_of(scene)
    assert solve(bare(scene), initial=array).attrs["initial"] == "given: DataArray beams"
    name = "given: callable function_of.<locals>.two_beams"
    for method in ("grid", "particles"):
        run_to_file(bare(scene), tmp_path / f"{method}.nc", method, initial=f)
        with xr.open_dataset(tmp_path / f"{method}.nc") as run:
            assert run.attrs["initial"] == name
            said = Scene.model_validate_json(run.attrs["scene"]).initial
        u, theta = initial.start_state(scene)
        assert [said.density, said.mean_velocity, said.temperature] == pytest.approx([0.8, u, theta], rel=1e-4)
    in_memory = simulate(bare(scene), initial=f)
    assert in_memory.attrs["initial"] == name
    with xr.open_dataset(tmp_path / "particles.nc") as run:
        assert np.array_equal(run["density"], in_memory["density"])
    with pytest.raises(SceneError, match=r"initial: method 'exact' starts from what \[initial\] says"):
        run_to_file(bare(scene), tmp_path / "exact.nc", "exact", initial=f)


def test_particles_resume_from_the_same_start(make_scene: MakeScene, tmp_path: Path) -> None:
    follow = make_scene(collisions=FOLLOW, initial=START, run={"end_time": 0.4, "output_every": 0.1}, particles={"count": 800})
    scene, f = bare(follow), function_of(follow)
    whole = simulate(scene, initial=f)
    path = tmp_path / "run.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene, path, "particles", max_walltime=0, initial=f)
    run_to_file(scene, path, "particles", resume=True, initial=f)
    with xr.open_dataset(path) as run:
        assert np.array_equal(run["density"], whole["density"])
        assert run.attrs["initial"] == whole.attrs["initial"]


def gaussian(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return (1 + 0.3 * np.cos(2 * np.pi * x / 9)) * np.exp(-((v - 1) ** 2))


def fails(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    raise ValueError("no such\nthing")


@pytest.mark.parametrize(
    ("f", "message"),
    [
        (lambda x, v: gaussian(x, v)[:, :-1], r"gives shape \(64, 4095\) for x of shape \(64, 1\) and v of shape \(1, 4096\)"),
        (lambda x, v: gaussian(x, v) + 0j, "gives values of type complex128"),
        (lambda x, v: np.where(v > 3, np.nan, gaussian(x, v)), "f is not finite for some v"),
        (lambda x, v: gaussian(x, v) - 0.2 * np.exp(-((v - 2) ** 2)), "f is negative, 0.0[0-9]+ of its maximum"),
        (lambda x, v: 1 / (1 + np.abs(v)), "does not fall below rtol/40 of its maximum"),
        (lambda x, v: 0 * v, "f is 0 at all velocities"),
        (lambda x, v: np.where(np.abs(v) < 1, 1.0, 0.0), "16384 velocities from .* do not resolve f"),
        (lambda x, v: (1 + x) * gaussian(x, v), "4096 places do not resolve f .* of the period pipe.length = 9"),
        (fails, r"callable fails: fails with x of shape \(64, 1\) .*: ValueError no such thing$"),
        (3.0, r"initial: is of type float; allowed: a callable f\(x, v\), or a DataArray"),
    ],
)
def test_callables_that_are_refused(make_scene: MakeScene, f: Any, message: str) -> None:
    for take in (solve, simulate):
        with pytest.raises(SceneError, match=message) as caught:
            take(bare(make_scene()), initial=f)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.isel(x=0), "has dimensions v; allowed: x and v"),
        (lambda a: a.drop_vars("v"), "has no coordinate v"),
        (lambda a: a.assign_coords(x=a["x"] ** 2), "its x is not uniform"),
        (lambda a: a.assign_coords(x=a["x"] * 2), "its 70 places cover 18; allowed: one period, pipe.length = 9"),
        (lambda a: a.where(a["v"] < 2), "f is not finite at 4[0-9]+ of its points"),
        (lambda a: a.sel(v=slice(-1.8, 9.0)), r"f has not ended at the edges of v"),
        (lambda a: a.isel(v=slice(None, None, 20)), "8 velocities do not resolve f"),
        (lambda a: -a, "f is nowhere positive"),
        (lambda a: a - 0.01 * a.max(), "f has not ended|f is negative"),
        (lambda a: a.astype(complex), "is of type complex128"),
        (lambda a: a.isel(x=slice(None, None, 7)), "f is negative at its points, or between them"),
    ],
)
def test_data_arrays_that_are_refused(
    make_scene: MakeScene, change: Callable[[xr.DataArray], xr.DataArray], message: str
) -> None:
    scene = make_scene(initial={**START, "pulse": {"at": 0.9, "width": 0.02, "height": 30.0}})
    with pytest.raises(SceneError, match=message) as caught:
        solve(bare(scene), initial=change(array_of(scene)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["density", "temperature", "beams"])
def test_refused_together_with_other_keys(make_scene: MakeScene, key: str) -> None:
    value = START["beams"] if key == "beams" else 1.0
    scene = Scene.model_validate({**bare(make_scene()).model_dump(exclude_none=True), "initial": {key: value}})
    with pytest.raises(SceneError, match=rf"initial\.{key}: is given together with an f\(x, v\) of one's own"):
        solve(scene, initial=gaussian)


def test_a_given_window_says_where_to_look(make_scene: MakeScene) -> None:
    """A jet narrower than the places at which f is first looked at."""

    def jet(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.exp(-(((v - 20.0123) / 1e-5) ** 2) / 2) + 0 * x

    scene = bare(make_scene(run={"end_time": 1e-12}))
    with pytest.raises(SceneError, match="f is 0 at all velocities"):
        solve(scene, initial=jet)
    given = scene.model_copy(update={"grid": scene.grid.model_copy(update={"velocity_window": (20.0122, 20.0124)})})
    run = solve(given, initial=jet)
    assert run["temperature"].values[0, 0] == pytest.approx(1e-10, rel=1e-6)


def test_a_given_window_that_cuts_f_is_warned_of(make_scene: MakeScene) -> None:
    """As with a start from the scene; f's own reach is found all the same."""
    scene = bare(make_scene(grid={"velocity_window": (-1.0, 4.0), "nv": 80}, run={"end_time": 0.1}))
    with pytest.warns(UserWarning, match="edge of the velocity window spoils"):
        run = solve(scene, initial=gaussian)
    assert (float(run["v_bounds"][0, 0]), float(run["v_bounds"][-1, 1])) == pytest.approx((-1.0, 4.0))


def test_the_places_of_a_wave_decide_nx(make_scene: MakeScene) -> None:
    """Waves that only a narrow part of f has are seen."""

    def wave(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        rest = np.exp(-(v**2) / 8)
        return rest + (1 + np.cos(2 * np.pi * 30 * x / 9)) * np.exp(-(((v - 3.05) / 0.05) ** 2) / 2)

    plan = make_plan(bare(make_scene(run={"end_time": 0.01})), given=wave)
    assert plan.grid.nx >= 61


def test_a_narrow_pulse_between_the_first_places_is_seen(make_scene: MakeScene) -> None:
    start = {"modes": [], "pulse": {"at": 0.5078, "width": 1e-3, "height": 300.0}, "mean_velocity": 1.0, "temperature": 0.4}
    scene = make_scene(initial=start, run={"end_time": 0.3}, accuracy={"rtol": 1e-5})
    run = solve(bare(scene), initial=function_of(scene))
    assert worst(run, scene) <= 1e-5


@pytest.mark.parametrize("given", [np.ones((4, 4)), xr.Dataset({"f": (("x", "v"), np.ones((4, 4)))})])
def test_what_is_no_start(make_scene: Callable[..., Scene], given: Any) -> None:
    message = (
        f"^initial: is of type {type(given).__name__}; allowed: a callable f\\(x, v\\), or a DataArray with dimensions x and v$"
    )
    with pytest.raises(SceneError, match=message):
        solve(bare(make_scene()), initial=given)


def test_a_run_goes_on_with_its_own_start_only(make_scene: Callable[..., Scene], tmp_path: Path) -> None:
    """Two starts of one name and the same means: a sum of their values tells them apart."""

    def wave(shift: float) -> Any:
        def start(x: np.ndarray, v: np.ndarray) -> np.ndarray:
            return (1 + 0.3 * np.cos(2 * np.pi * (x / length - shift))) * np.exp(-(v**2) / 2) / np.sqrt(2 * np.pi)

        return start

    scene = bare(make_scene(run={"end_time": 0.5, "output_every": 0.25}))
    length, path = scene.pipe.length, tmp_path / "a.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene, path, max_walltime=0, initial=wave(0.0))
    with pytest.raises(SceneError, match=r"is of initial_sha256 = .*allowed: to overwrite it, or another name"):
        run_to_file(scene, path, resume=True, initial=wave(0.25))
    with pytest.raises(SceneError, match=r"is of initial = given: callable .*, this run of what the scene says"):
        run_to_file(scene, path, resume=True)
    run_to_file(scene, path, resume=True, initial=wave(0.0))
