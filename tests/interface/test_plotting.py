"""Pictures: what is drawn is what is in the data."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, solve
from kinetic_solver.analysis.frames import fine_v, fine_x, some
from kinetic_solver.analysis.plotting import _frames, overview
from kinetic_solver.dataset import open_run, write_dataset

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize("nx", [7, 8, 480, 481])
def test_fields_are_drawn_through_the_grid_points(nx: int) -> None:
    """The trigonometric interpolant keeps every value and is exact between them."""
    length = 9.0

    def field(x: np.ndarray) -> np.ndarray:
        return 1 + 0.4 * np.cos(2 * np.pi * x / length) + 0.2 * np.sin(6 * np.pi * x / length)

    x = length * np.arange(nx) / nx
    fine, values = fine_x(field(x)[None], length, axis=1)
    assert fine.size > 240
    assert (fine[0], fine[-1]) == (0.0, length)
    assert values[0] == pytest.approx(field(fine), abs=1e-13)
    # An even nx's Nyquist cosine keeps its values, too.
    saw = np.cos(np.pi * np.arange(nx)) if nx % 2 == 0 else field(x)
    _, drawn = fine_x(saw, length, axis=0)
    assert drawn[: -1 : (drawn.size - 1) // nx] == pytest.approx(saw, abs=1e-12)


def test_velocities_are_drawn_through_the_grid_points() -> None:
    v = np.linspace(-5, 5, 64)
    fine, values = fine_v(v, np.exp(-(v**2) / 2), axis=0)
    assert values == pytest.approx(np.exp(-(fine**2) / 2), abs=2e-5)


def test_default_times_share_the_change_equally(make_scene: MakeScene) -> None:
    """A run that relaxes in a tenth of its time is shown mostly in that tenth."""
    run = solve(make_scene(initial={"modes": [], "temperature": 0.1}, run={"end_time": 10.0, "output_every": 0.1}))
    frames = _frames(run, "velocity_distribution", None)
    assert (frames[0], frames[-1]) == (0, 100)
    assert all(n < 30 for n in frames[:3])
    assert _frames(run, "velocity_distribution", [0.31, 5.0, 10.0]) == [3, 50, 100]
    for time in (-0.5, 10.5):
        with pytest.raises(SceneError, match=rf"^time {time:g}: is beyond the frames of the file; allowed: 0 to 10$"):
            _frames(run, "velocity_distribution", [5.0, time])


@pytest.mark.parametrize("homogeneous", [True, False])
def test_panels(make_scene: MakeScene, homogeneous: bool) -> None:
    start = {"modes": [], "temperature": 0.3} if homogeneous else {}
    run = solve(make_scene(initial=start, run={"end_time": 1.0, "output_every": 0.25}))
    titles = [axes.get_title() for axes in overview(run).axes]
    assert ("temperature θ(t)" in titles) == homogeneous
    assert ("density ρ(x, t)" in titles) != homogeneous
    assert sum(title.startswith("f(x, v)") for title in titles) == (0 if homogeneous else 4)
    curves = next(axes for axes in overview(run).axes if axes.get_title() == "velocity distribution").get_lines()
    theta = 0.3 if homogeneous else 0.5
    assert float(np.max(curves[0].get_ydata())) == pytest.approx(0.8 * 9.0 / np.sqrt(2 * np.pi * theta), rel=1e-3)


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
        mesh = next(axes for axes in figure.axes if axes.get_title() == "density ρ(x, t)").collections[0]
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
