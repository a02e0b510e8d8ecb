"""When anything is written: the properties of every schedule, and the same times for every method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from kinetic_solver import exact, run_to_file, solve
from kinetic_solver.scene import GROUPS, Scene, Schedule
from particles import simulate

MakeScene = Callable[..., Scene]
NEAR = {"run": {"end_time": 1.0, "output_every": 0.1}, "output": {"f": 0.100000005}}
"""Two cadences that nobody means to differ."""
SMALL = {"grid": {"nx": 9, "nv": 32}, "particles": {"count": 200, "replicas": 2}, "accuracy": {"rtol": 1e-2}}


def scene_of(end: float, every: float | None, output: dict[str, Any]) -> Scene:
    run = {"end_time": end} if every is None else {"end_time": end, "output_every": every}
    return Scene.model_validate({"pipe": {"length": 3.0}, "run": run, "output": output})


ratios = st.one_of(
    st.sampled_from([0.1, 0.1 + 5e-9, 0.1 * (1 + 2e-7), 0.3, 1 / 3, 0.7, 1.0, 1 - 1e-9]),
    st.floats(0.01, 3.0, allow_nan=False),
)
cadences = st.one_of(st.booleans(), ratios)


@given(
    end=st.sampled_from([1e-9, 0.37, 1.0, 5e6]),
    every=st.one_of(st.none(), ratios),
    asked=st.fixed_dictionaries(dict.fromkeys(GROUPS, cadences)),
    owned=st.sets(st.sampled_from(GROUPS)),
)
def test_schedules(end: float, every: float | None, asked: dict[str, bool | float], owned: set[str]) -> None:
    """0 and the end are there, no two times are one, and each group is due as often as it asks, and when it asks."""
    output = {group: cadence if isinstance(cadence, bool) else cadence * end for group, cadence in asked.items()}
    scene = scene_of(end, None if every is None else every * end, output)
    schedule = Schedule.of(scene, owned)
    assert schedule.times[0] == 0
    assert schedule.times[-1] == end
    assert np.diff(schedule.times).min() > schedule.tolerance > 0
    assert len(schedule.due) == schedule.times.size
    written = {group for group in owned if output[group] is not False}
    assert frozenset().union(*schedule.due) == written
    assert all(schedule.due) == bool(written)
    for group in written:
        wanted, own = scene.times(output[group]), schedule.of_group(group)
        assert set(own) <= set(schedule.times)
        assert own.size == wanted.size
        assert np.abs(own - wanted).max() <= schedule.tolerance
    dimensions = schedule.dimensions(scene)
    assert dimensions.keys() == written
    # One dimension has one set of times, whichever group of it is asked.
    by_name: dict[str, np.ndarray] = {}
    for group, name in dimensions.items():
        assert np.array_equal(by_name.setdefault(name, schedule.of_group(group)), schedule.of_group(group))
    assert all(name == "time" for group, name in dimensions.items() if output[group] is True)
    again = Schedule.of(scene, sorted(owned, reverse=True))
    assert np.array_equal(again.times, schedule.times)
    assert again.due == schedule.due


def test_cadences_that_differ_by_rounding_are_one() -> None:
    scene = scene_of(1.0, 0.1, {"f": 0.100000005, "budgets": 0.3})
    schedule = Schedule.of(scene, ("f", "moments"))
    assert schedule.times == pytest.approx(np.arange(11) / 10, abs=1e-7)
    assert schedule.due == (frozenset({"f", "moments"}),) * 11
    assert schedule.dimensions(scene) == {"f": "time", "moments": "time"}
    with_budgets = Schedule.of(scene, ("f", "moments", "budgets"))
    assert with_budgets.of_group("budgets") == pytest.approx([0, 0.3, 0.6, 0.9, 1.0], abs=1e-7)
    assert with_budgets.dimensions(scene)["budgets"] == "time_budgets"


def test_cadences_that_drift_apart_are_two_where_they_are() -> None:
    """5e-9 a frame: after 20 frames 1e-7, a millionth of the cadence, and from there on each has frames of its own."""
    schedule = Schedule.of(scene_of(5.0, 0.1, {"f": 0.100000005}), ("f", "moments"))
    both = [len(due) == 2 for due in schedule.due]
    assert both[:20] == [True] * 20
    assert not any(both[22:-1])
    assert both[-1]


def test_three_near_times_are_not_strung_together() -> None:
    """Each is within the tolerance of the next, and the last not of the first."""
    output = {"f": 0.1, "moments": 0.1 * (1 + 8e-7), "scalars": 0.1 * (1 + 1.6e-6)}
    schedule = Schedule.of(scene_of(0.25, 0.1, output), ("f", "moments", "scalars"))
    assert [due for due in schedule.due if "scalars" in due][1] == {"scalars"}
    assert schedule.due[1] == {"f", "moments"}


@pytest.mark.parametrize(
    ("end", "every", "f"), [(10_000.0, 0.1, 0.3), (20_000.0, 0.7, 2.1), (1e-13, 1e-14, 3e-14), (1.0, 0.3, 0.2)]
)
def test_long_and_short_runs(end: float, every: float, f: float) -> None:
    """No time twice and none lost, after a hundred thousand multiples of a cadence and in any unit of time."""
    scene = scene_of(end, every, {"f": f})
    schedule = Schedule.of(scene, ("f", "moments"))
    assert np.diff(schedule.times).min() > 1e-6 * min(every, f)
    for group, wanted in (("f", scene.times(f)), ("moments", scene.times())):
        own = schedule.of_group(group)
        assert own.size == wanted.size
        assert np.abs(own - wanted).max() <= 1e-6 * min(every, f)


def test_nothing_asked_for_has_the_frames_of_output_every() -> None:
    schedule = Schedule.of(scene_of(1.0, 0.4, {"f": False}), ("f",))
    assert schedule.times == pytest.approx([0, 0.4, 0.8, 1.0])
    assert schedule.due == (frozenset(),) * 4
    assert schedule.dimensions(scene_of(1.0, 0.4, {"f": False})) == {}


# -- every method


def in_memory(method: str, scene: Scene) -> xr.Dataset:
    return {"grid": solve, "exact": exact.solve, "particles": simulate}[method](scene)


METHODS = pytest.mark.parametrize("method", ["grid", "exact", "particles"])


@METHODS
def test_every_method_has_the_same_times(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """11 frames of both cadences, in memory and in a file."""
    scene = make_scene(**NEAR, **SMALL)
    expected = Schedule.of(scene, ("f", "moments", "scalars")).times
    assert expected.size == 11
    run_to_file(scene, tmp_path / "run.nc", method)
    with xr.open_dataset(tmp_path / "run.nc") as written:
        for found in (in_memory(method, scene), written):
            assert np.array_equal(found["time"].values, expected)
            assert found["f"].dims == ("time", "x", "v")
            assert np.isfinite(found["f"].values).all()


@pytest.mark.parametrize("method", ["grid", "exact", "particles"])
def test_every_method_keeps_the_cadences_of_its_groups(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    output = {"f": 0.5, "moments": 0.25, "budgets": False}
    scene = make_scene(run={"end_time": 1.5, "output_every": 0.3}, output=output, **SMALL)
    run_to_file(scene, tmp_path / "run.nc", method)
    with xr.open_dataset(tmp_path / "run.nc") as written:
        for found in (in_memory(method, scene), written):
            assert found["time_f"].values == pytest.approx([0, 0.5, 1.0, 1.5])
            assert found["time_moments"].values == pytest.approx(0.25 * np.arange(7))
            assert found["time"].values == pytest.approx(0.3 * np.arange(6))
            assert found["f"].dims == ("time_f", "x", "v")
            assert found["velocity_distribution"].dims == ("time_moments", "v")
            assert found["mass"].dims == ("time",)
            for name in ("f", "density", "velocity_distribution", "mass"):
                assert np.isfinite(found[name].values).all(), name


def test_the_closed_form_computes_f_only_where_it_is_needed(make_scene: MakeScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """For f itself, and for w(v) = ∫f dx, which is that of f at the same time."""
    made: list[float] = []
    distribution = exact.Solution.distribution

    def counted(self: exact.Solution, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        made.append(self.time)
        return distribution(self, x, v)

    monkeypatch.setattr(exact.Solution, "distribution", counted)
    output = {"f": 0.75, "moments": 0.5}
    scene = make_scene(run={"end_time": 1.5, "output_every": 0.1}, output=output, **SMALL)
    found = exact.solve(scene)
    assert made == pytest.approx([0, 0.5, 0.75, 1.0, 1.5])
    f, w = found["f"].sel(time_f=1.5), found["velocity_distribution"].sel(time_moments=1.5)
    places = 9.0 * np.arange(72) / 72
    np.testing.assert_allclose(w, distribution(exact.Solution(scene, 1.5), places, f["v"].values).sum(axis=0) / 8, rtol=1e-12)
    made.clear()
    found = exact.solve(make_scene(run={"end_time": 1.5, "output_every": 0.1}, output={"f": False, "moments": False}, **SMALL))
    assert found.sizes["time"] == 16
    assert made == []
    assert not {"f", "density"} & set(found.variables)


def test_a_file_holds_the_times_recorded(make_scene: MakeScene, tmp_path: Path) -> None:
    """The later of two near times is not in the file: f was recorded at the moments' times."""
    scene = make_scene(run={"end_time": 2.5, "output_every": 0.1}, output={"f": 0.100000005}, **SMALL)
    schedule = Schedule.of(scene, ("f", "moments", "scalars"))
    assert not np.array_equal(schedule.of_group("f"), scene.times(0.100000005))
    run_to_file(scene, tmp_path / "run.nc", "particles")
    with xr.open_dataset(tmp_path / "run.nc") as written:
        assert written["f"].dims == ("time_f", "x", "v")
        assert np.array_equal(written["time_f"].values, schedule.of_group("f"))
        assert np.array_equal(written["time"].values, schedule.of_group("moments"))
