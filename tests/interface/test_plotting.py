"""Pictures: what is drawn is what is in the data."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from kinetic_solver import Scene, SceneError, solve, sweep
from kinetic_solver.analysis.frames import chosen_frames, some
from kinetic_solver.analysis.info import summary
from kinetic_solver.analysis.measured_rates import measured_rates
from kinetic_solver.analysis.plotting import overview
from kinetic_solver.dataset import STOPPED, open_run, write_dataset
from particles import simulate

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]


def test_default_times_share_the_change_equally(make_scene: MakeScene) -> None:
    """A run that relaxes in a tenth of its time is shown mostly in that tenth."""
    run = solve(make_scene(initial={"modes": [], "temperature": 0.1}, run={"end_time": 10.0, "output_every": 0.1}))
    frames = chosen_frames(run, "velocity_distribution", None)
    assert (frames[0], frames[-1]) == (0, 100)
    assert all(n < 30 for n in frames[:3])
    assert chosen_frames(run, "velocity_distribution", [0.31, 5.0, 10.0]) == [3, 50, 100]
    for time in (-0.5, 10.5):
        with pytest.raises(SceneError, match=rf"^time {time:g}: is beyond the frames of the file; allowed: 0 to 10$"):
            chosen_frames(run, "velocity_distribution", [5.0, time])


def test_times_of_one_frame_are_said(make_scene: MakeScene) -> None:
    run = solve(make_scene(run={"end_time": 1.0, "output_every": 0.25}))
    with pytest.warns(UserWarning, match=r"^times: some are nearest to the same frame, which is drawn once; drawn: 0.25, 1$"):
        assert chosen_frames(run, "density", [0.24, 0.26, 1.0]) == [1, 4]


def test_a_scene_is_no_run(command: Command, tmp_path: Path) -> None:
    """Said before anything else, whatever pictures there are."""
    (tmp_path / "scene.toml").write_text("[pipe]\nlength = 9.0\n[run]\nend_time = 1.0\n")
    (tmp_path / "scene.png").write_text("mine")
    done = command("plot", "scene.toml", folder=tmp_path)
    expected = "error: scene.toml: is a scene, no dataset; run it first, and give the file that it writes"
    assert (done.returncode, done.stderr.strip()) == (2, expected)


def titled(figure: Figure, title: str) -> Any:
    return next(axes for axes in figure.axes if axes.get_title() == title)


@pytest.mark.parametrize("homogeneous", [True, False])
def test_panels(make_scene: MakeScene, homogeneous: bool) -> None:
    start = {"modes": [], "temperature": 0.3} if homogeneous else {}
    run = solve(make_scene(initial=start, run={"end_time": 1.0, "output_every": 0.25}))
    figure = overview(run)
    titles = [axes.get_title() for axes in figure.axes]
    assert ("density" in titles) != homogeneous
    assert {"mean velocity", "temperature"} < set(titles)
    assert sum(title.startswith("f(x, v)") for title in titles) == (0 if homogeneous else 4)
    curves = titled(figure, "velocity distribution").get_lines()
    theta = 0.3 if homogeneous else 0.5
    assert float(np.max(curves[0].get_ydata())) == pytest.approx(0.8 * 9.0 / np.sqrt(2 * np.pi * theta), rel=1e-3)
    assert "rtol = 0.0001" in figure.get_suptitle()


def test_both_rows_show_the_same_times(make_scene: MakeScene) -> None:
    """f has a cadence of its own: w(v) is shown at f's times."""
    run = solve(make_scene(run={"end_time": 1.0, "output_every": 0.05}, output={"f": 0.25}))
    for times in (None, [0.25, 0.75], [0.0, 0.25, 0.5, 0.75, 1.0]):
        figure = overview(run, times)
        below = [axes.get_title() for axes in figure.axes if axes.get_title().startswith("f(x, v)")]
        beside = [line.get_label() for line in titled(figure, "velocity distribution").get_lines() if "t =" in line.get_label()]
        assert [title.removeprefix("f(x, v), ") for title in below] == beside
        assert len(below) == (4 if times is None else len(times))


def test_fields_are_drawn_through_their_points(make_scene: MakeScene) -> None:
    run = solve(make_scene(run={"end_time": 1.0, "output_every": 0.25}, output={"nx": 16}))
    mesh = titled(overview(run), "mean velocity").collections[0]
    x, drawn = mesh.get_coordinates()[0, :, 0], np.asarray(mesh.get_array()).reshape(5, -1)
    assert (x[0], x[-1]) == (0.0, 9.0)
    assert drawn[:, ::15][:, :16] == pytest.approx(run["mean_velocity"].values, abs=1e-12)


def test_particles_are_drawn_as_they_were_counted(make_scene: MakeScene) -> None:
    scene = make_scene(particles={"count": 500, "replicas": 3}, run={"end_time": 0.5, "output_every": 0.1})
    run = simulate(scene)
    figure = overview(run)
    mesh = titled(figure, "density").collections[0]
    assert np.asarray(mesh.get_array()).reshape(6, -1)[:, :-1] == pytest.approx(run["density"].values, abs=1e-12)
    steps = [patch for patch in titled(figure, "velocity distribution").patches if patch.get_label().startswith("t =")]
    assert steps[0].get_data().values == pytest.approx(run["velocity_distribution"].values[0])
    assert "500 × 3; bands: one standard error, at most " in figure.get_suptitle()
    one = overview(simulate(scene.replace(**{"particles.replicas": 1})))
    assert "no standard errors of one replica" in one.get_suptitle()


def test_what_a_reader_must_know_is_said(make_scene: MakeScene) -> None:
    fast = {"modes": [{"mode": 1, "cos": 0.5}], "mean_velocity": 20.0}
    scene = make_scene(model={"friction": 0.0, "gravity": 0.0}, collisions=None, initial=fast)
    far, near = (solve(scene.replace(run={"end_time": 1.0, "output_every": every})) for every in (0.2, 0.02))
    assert "beads" in overview(far).get_supxlabel()
    assert overview(near).get_supxlabel() == ""
    stopped = near.assign(status=STOPPED).isel(time=slice(0, 20))
    assert overview(stopped).get_supxlabel() == "stopped at t = 0.38 of 1"
    said = overview(stopped.assign_attrs(stopped="raise grid.nv to 39 or more")).get_supxlabel()
    assert said == "stopped at t = 0.38 of 1; raise grid.nv to 39 or more"
    for reason, wanted in (
        ("t = 0.3917: f has run out; raise nx", "stopped at t = 0.3917 of 1: f has run out; raise nx"),
        ("between t = 0.38 and 0.4: lost; lower S", "stopped between t = 0.38 and 0.4 of 1: lost; lower S"),
    ):
        told = stopped.assign_attrs(stopped=reason)
        assert overview(told).get_supxlabel() == wanted
        assert f"status      {wanted}" in summary(told)


def test_rounding_is_drawn_level(make_scene: MakeScene) -> None:
    """A field that is level but for rounding has the axis of a level one, as a map, as profiles, and over time."""
    run = solve(make_scene(run={"end_time": 1.0, "output_every": 0.25}))
    rounding = 1e-15 * np.cos(np.arange(run["mean_velocity"].size)).reshape(run["mean_velocity"].shape)
    run["mean_velocity"][:] = rounding
    mesh = titled(overview(run), "mean velocity").collections[0]
    assert mesh.norm.vmax - mesh.norm.vmin > 0.5
    assert np.ptp(titled(overview(run.isel(time=slice(0, 2))), "mean velocity").get_ylim()) > 0.5
    still = solve(make_scene(initial={"modes": [], "temperature": 0.3}, run={"end_time": 1.0, "output_every": 0.25}))
    still["mean_velocity"][:] = rounding[:, :1]
    assert np.ptp(titled(overview(still), "mean velocity").get_ylim()) > 0.5


def test_few_particles_leave_places_white(make_scene: MakeScene) -> None:
    """Quotients where few particles are: without a temperature they are left out, and the rest sets the colours."""
    run = simulate(make_scene(particles={"count": 500, "replicas": 3}, run={"end_time": 0.5, "output_every": 0.1}))
    run["temperature"][1, 3] = -80.0
    run["mean_velocity"][1, 3] = 900.0
    run["mean_velocity"][2, 4] = -700.0
    axes = titled(overview(run), "mean velocity")
    mesh = axes.collections[0]
    assert np.ma.getmaskarray(mesh.get_array()).reshape(6, -1)[1, 3]
    assert -20 < mesh.norm.vmin < mesh.norm.vmax < 20
    assert axes.get_xlabel() == "x (white: too few particles)"


def test_a_sweep_is_no_run(make_scene: MakeScene) -> None:
    found = sweep(make_scene(run={"end_time": 0.5}), {"initial.density": [0.5, 0.8]})
    for draw in (overview, summary, measured_rates):
        with pytest.raises(SceneError, match=r"^the file is a sweep over initial\.density; allowed: the file of one run"):
            draw(found)


def test_missing_values_and_wide_temperatures(make_scene: MakeScene) -> None:
    run = solve(make_scene(run={"end_time": 1.0, "output_every": 0.25}))
    run["temperature"][2, 0] = np.nan
    run["temperature"][1, 5] = 40.0
    mesh = titled(overview(run), "temperature").collections[0]
    assert np.ma.count_masked(mesh.get_array()) == 2  # x = 0 is drawn at both ends
    assert mesh.norm.vmax == 40.0
    assert isinstance(mesh.norm, LogNorm)


def test_more_times_than_fit_into_a_row(make_scene: MakeScene) -> None:
    """Each of them is drawn, in the order of time; where there are too many, none."""
    run = solve(make_scene(run={"end_time": 1.5, "output_every": 0.25}, accuracy={"rtol": 1e-2}))
    titles = [axes.get_title() for axes in overview(run, [1.5, 0.25, 0.5, 1.0, 0.75, 1.25]).axes]
    expected = [f"f(x, v), t = {time:.3g}" for time in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)]
    assert [title for title in titles if title.startswith("f(x, v)")] == expected
    with pytest.raises(SceneError, match=r"^times: 13 are given; allowed: up to 12 \(a movie has all of them\)$"):
        overview(run, [0.1 * n for n in range(13)])


def test_pictures_are_not_overwritten(make_scene: MakeScene, command: Command, tmp_path: Path) -> None:
    """By none of the commands that draw; with --overwrite they are."""
    law = {"operator": "follow-the-leader", "cross_section": 0.9}
    scene = make_scene(collisions=law, accuracy={"rtol": 1e-2})
    (tmp_path / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    for name in ("a.nc", "b.nc"):
        write_dataset(solve(scene), tmp_path / name)
    commands = {
        "a.png": ("plot", "a.nc"),
        "a-b.png": ("compare", "a.nc", "b.nc", "--figure"),
        "scene-stability.png": ("stability", "scene.toml", "--figure"),
        "figure_1.png": ("stability", "--figure"),
        "figure_2.png": ("figure", "2", "--count", "100"),
    }
    for picture, arguments in commands.items():
        (tmp_path / picture).write_text("mine")
        done = command(*arguments, folder=tmp_path)
        assert done.returncode == 2
        assert done.stderr.startswith(f"error: {picture}: exists already; use --overwrite to replace it")
        assert (tmp_path / picture).read_text() == "mine"
    for picture in list(commands)[:3]:
        assert command(*commands[picture], "--overwrite", folder=tmp_path).returncode == 0
        assert (tmp_path / picture).read_bytes()[:4] == b"\x89PNG"


def test_a_file_without_the_fields_is_refused(make_scene: MakeScene) -> None:
    run = solve(make_scene(output={"moments": False}))
    with pytest.raises(SceneError, match=r"output\.moments = true"):
        overview(run)


def test_the_cost_goes_with_the_picture(make_scene: MakeScene, tmp_path: Path) -> None:
    """Of 5001 frames a thousand rows are drawn, at the times at which they were, and no field over x and v is read as a whole."""
    few = solve(
        make_scene(run={"end_time": 1.0, "output_every": 0.25}, grid={"nx": 15, "nv": 40, "velocity_window": (-6.0, 8.0)})
    )
    times = np.linspace(0, 1, 5001)
    many = few[["density", "velocity_distribution", "f"]].interp(time=times).assign_attrs(few.attrs)
    write_dataset(many, tmp_path / "many.nc")
    with open_run(tmp_path / "many.nc") as run:
        figure = overview(run)
        assert not run["f"].variable._in_memory
        assert not run["velocity_distribution"].variable._in_memory
        mesh = titled(figure, "density").collections[0]
        shown = mesh.get_coordinates()[:, 0, 1]
        assert mesh.get_coordinates().shape == (1000, 241, 2)
        assert np.isin(shown, times).all()
        assert (shown[0], shown[-1]) == (0.0, 1.0)
        assert np.diff(shown).max() < 1.3e-3
        drawn = np.asarray(mesh.get_array()).reshape(1000, 241)[371, :-1:16]
        assert drawn == pytest.approx(run["density"].values[int(np.searchsorted(times, shown[371]))], abs=1e-12)


def test_some_of_many() -> None:
    assert some(3, 10).tolist() == [0, 1, 2]
    assert some(1, 10).tolist() == [0]
    assert some(11, 3).tolist() == [0, 5, 10]
