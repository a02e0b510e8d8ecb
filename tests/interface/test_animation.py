"""Movies: every frame of the file, what is drawn is what is in it, on axes and scales that stay."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from PIL import Image

from kinetic_solver import OutputExistsError, Scene, SceneError, hydrodynamics, solve
from kinetic_solver.analysis import animation, moving_picture
from kinetic_solver.analysis.animation import save_animation
from kinetic_solver.analysis.movie_frames import MovieFrames
from kinetic_solver.analysis.moving_picture import MovingPicture
from kinetic_solver.dataset import STOPPED, open_run, write_dataset
from kinetic_solver.errors import OutputFailed
from particles import simulate

MakeScene = Callable[..., Scene]
Command = Callable[..., subprocess.CompletedProcess[str]]
LAW = {"operator": "follow-the-leader", "cross_section": 0.9}
RUN = {"end_time": 1.5, "output_every": 0.5}


@pytest.fixture(scope="module")
def run() -> xr.Dataset:
    return solve(
        Scene.model_validate(
            {
                "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
                "collisions": LAW,
                "pipe": {"length": 9.0},
                "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}]},
                "run": RUN,
                "accuracy": {"rtol": 1e-2},
            }
        )
    )


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("modes", [[], [{"mode": 1, "cos": 0.3}]])
def test_a_gas_that_cools(modes: list[dict[str, float]], tmp_path: Path) -> None:
    """Over scaled velocities, which the axes say."""
    cooling = Scene.model_validate(
        {
            "model": {"friction": 0.0, "noise": 0.0},
            "collisions": {"operator": "inelastic", "cross_section": 1.3, "restitution": 0.4},
            "pipe": {"length": 3.0},
            "initial": {"modes": modes, "temperature": 0.8},
            "run": {"end_time": 12.0, "output_every": 4.0},
            "accuracy": {"rtol": 1e-2},
        }
    )
    cool = solve(cooling)
    assert "scaled_velocity" in cool.dims
    assert save_animation(cool, tmp_path / "cool.gif") == 4
    axes = MovingPicture(cool).figure.axes
    assert any("scaled velocity" in label for one in axes for label in (one.get_xlabel(), one.get_ylabel()))
    assert any(one.get_xlabel() == "s w(v)" or one.get_ylabel() == "s w(v)" for one in axes)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures that are drawn sooner."""
    monkeypatch.setattr(moving_picture, "DPI", 40)


def pictures(path: Path) -> list[np.ndarray]:
    with Image.open(path) as movie:
        frames = []
        for n in range(movie.n_frames):
            movie.seek(n)
            frames.append(np.array(movie.convert("RGB")))
        return frames


def test_every_frame_is_a_picture_of_its_data(run: xr.Dataset, tmp_path: Path) -> None:
    """The colour at a place of the map is that of f there, on one scale for all frames, to the palette's steps."""
    told: list[tuple[float, float]] = []
    assert save_animation(run, tmp_path / "a.gif", progress=lambda done, end: told.append((done, end))) == 4
    assert told == [(0, 4)] * 4 + [(n, 4) for n in (1, 2, 3, 4)]
    frames = pictures(tmp_path / "a.gif")
    assert [frame.shape for frame in frames] == [(560, 900, 3)] * 4
    with Image.open(tmp_path / "a.gif") as movie:
        assert movie.info["duration"] == 500
        assert movie.info["loop"] == 0
    picture = MovingPicture(run)
    picture.pixels(0)
    axes = next(axes for axes in picture.figure.axes if axes.get_xlabel() == "x")
    top = float(run["f"].max())
    for n, frame in enumerate(frames):
        for i, j in ((3, 20), (17, 31), (40, 34), (60, 28)):
            place = axes.transData.transform((float(run["x"][i]), float(run["v"][j])))
            shown = frame[559 - int(place[1]), int(place[0])]
            expected = 255 * np.array(colormaps["magma"](float(run["f"][n, i, j]) / top))[:3]
            assert np.abs(shown - expected).max() < 12, (n, i, j)
    # The curve of the density passes the points of the data.
    line = picture.figure.axes[1].get_lines()[1]
    for n in (0, 3):
        picture.show(n)
        x, rho = line.get_data()
        np.testing.assert_allclose(np.interp(run["x"], x, rho), run["density"][n], rtol=1e-3)


def test_axes_stay(run: xr.Dataset) -> None:
    picture = MovingPicture(run)
    before = [(axes.get_xlim(), axes.get_ylim()) for axes in picture.figure.axes]
    first = picture.pixels(0)
    last = picture.pixels(3)
    assert [(axes.get_xlim(), axes.get_ylim()) for axes in picture.figure.axes] == before
    assert (first != last).any()
    assert np.array_equal(picture.pixels(0), first)  # and nothing is left of other frames
    labels = [text.get_text() for text in picture.figure.texts]
    assert labels[1] == "t = 0.00"


def test_times_of_every_field(make_scene: MakeScene, small: None, tmp_path: Path) -> None:
    """f has a cadence of its own: no frame of the density is skipped, and the map says of which time it is."""
    run = solve(make_scene(run={"end_time": 1.5, "output_every": 0.25}, output={"f": 0.75}))
    assert run["f"].dims[0] == "time_f"
    assert save_animation(run, tmp_path / "a.gif") == 7
    picture = MovingPicture(run)
    (below,) = [axes for axes in picture.figure.axes if axes.get_xlabel() == "x"]
    said = []
    for n in range(7):
        picture.show(n)
        said.append(below.texts[0].get_text())
    assert said == ["", "at t = 0", "at t = 0.75", "", "at t = 0.75", "at t = 1.5", ""]


def _hydrodynamics(make: MakeScene) -> xr.Dataset:
    return hydrodynamics.solve(make(collisions=LAW, run=RUN, accuracy={"rtol": 1e-2}))


def _homogeneous(make: MakeScene) -> xr.Dataset:
    return solve(make(initial={"modes": [], "temperature": 0.1}, run=RUN))


def _particles(make: MakeScene) -> xr.Dataset:
    return simulate(make(run=RUN, particles={"count": 500, "replicas": 2}, grid={"nx": 9, "nv": 32}))


KINDS: dict[str, tuple[Callable[[MakeScene], xr.Dataset], list[str], bool]] = {
    "moments only": (lambda make: solve(make(run=RUN, output={"f": False})), ["density ρ", "velocity v", "", ""], False),
    "hydrodynamics": (_hydrodynamics, ["density ρ", "velocity v"], False),
    "particles": (_particles, ["density ρ", "velocity v", "", ""], False),
    "nx = 1": (_homogeneous, ["temperature θ", "w(v)"], False),
    "a window that cuts f": (
        lambda make: solve(make(run=RUN, output={"velocity_window": [0.5, 2.0]})),
        ["density ρ", "velocity v", "", ""],
        True,
    ),
    "f only": (
        lambda make: solve(make(run=RUN, output={"moments": False})),
        ["∫f dv, as shown", "velocity v", "", ""],
        False,
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_of_files(make_scene: MakeScene, small: None, tmp_path: Path, kind: str) -> None:
    """From files; the panels are those that the fields are there for, and a cut w(v) has no Gaussian beside it."""
    made, labels, cut = KINDS[kind]
    write_dataset(made(make_scene), tmp_path / "run.nc")
    with open_run(tmp_path / "run.nc") as found:
        assert save_animation(found, tmp_path / "a.gif") == 4
        picture = MovingPicture(found)
        assert sorted(axes.get_ylabel() for axes in picture.figure.axes) == sorted(labels)
        shown = {line.get_label() for axes in picture.figure.axes for line in axes.get_lines()}
        assert ("Gaussian, same moments" in shown) == ("w(v)" in shown and not cut)
    frames = pictures(tmp_path / "a.gif")
    assert len(frames) == 4
    assert (frames[0] != frames[3]).any()


def test_a_file_is_read_a_frame_at_a_time(run: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_dataset(run, tmp_path / "run.nc")
    sizes: list[int] = []
    whole = xr.DataArray.values.fget

    def counted(self: xr.DataArray) -> Any:
        sizes.append(self.size)
        return whole(self)

    with open_run(tmp_path / "run.nc") as found:
        monkeypatch.setattr(xr.DataArray, "values", property(counted))
        picture = MovingPicture(found)
        picture.show(2)
        assert not found["f"].variable._in_memory
    assert max(sizes) == run["f"].isel(time=0).size


def test_scales_hold_all_frames(run: xr.Dataset) -> None:
    frames = MovieFrames(run, lambda count: None)
    assert frames.largest_f == float(run["f"].max())
    assert frames.densities[0] < float(run["density"].min()) < float(run["density"].max()) < frames.densities[1]
    seen = run["v"].values[(run["f"].max(["time", "x"]) > 2e-3 * run["f"].max()).values]
    assert frames.speeds == (seen[0], seen[-1])


def test_a_stopped_run_has_the_frames_that_it_reached(run: xr.Dataset) -> None:
    cut = run.copy(deep=True)
    for name in ("f", "density", "velocity_distribution", "mean_velocity", "temperature"):
        cut[name][2:] = math.nan
    picture = MovingPicture(cut.assign(status=STOPPED))
    assert picture.count == 2
    assert picture.figure.texts[0].get_text().endswith("; stopped at t = 0.5 of 1.5")


def test_mp4(run: xr.Dataset, small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ffmpeg is given every picture, raw. This one keeps what it is given."""
    program = tmp_path / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport shutil, sys\nshutil.copyfileobj(sys.stdin.buffer, open(sys.argv[-1], 'wb'))\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    assert save_animation(run, tmp_path / "a.mp4") == 4
    raw = np.frombuffer((tmp_path / "a.mp4").read_bytes(), dtype=np.uint8).reshape(4, 224, 360, 4)
    assert (raw[0] != raw[3]).any()
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.exit(3)\n")
    with pytest.raises(OutputFailed, match=r"b.part.mp4: ffmpeg could not write it"):
        save_animation(run, tmp_path / "b.mp4")
    assert not list(tmp_path.glob("b*"))


def test_what_is_refused(run: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(SceneError, match=r"a.mp4: needs the program ffmpeg, which is not found; install it \(apt install ffmpeg"):
        save_animation(run, tmp_path / "a.mp4")
    with pytest.raises(SceneError, match=r"a.avi: allowed: a name that ends in .gif or .mp4"):
        save_animation(run, tmp_path / "a.avi")
    with pytest.raises(SceneError, match="fps = 51: allowed: above 0, up to 50"):
        save_animation(run, tmp_path / "a.gif", fps=51)
    (tmp_path / "a.gif").write_text("mine")
    with pytest.raises(OutputExistsError, match=r"a.gif: exists already"):
        save_animation(run, tmp_path / "a.gif")
    with pytest.raises(SceneError, match="its folder does not exist"):
        save_animation(run, tmp_path / "none" / "a.gif")
    with pytest.raises(SceneError, match=r"neither f nor density; allowed: a run with output\.f = true"):
        save_animation(run.drop_vars(["f", "density"]), tmp_path / "b.gif")
    with pytest.raises(SceneError, match=r"f is over S, time, x, v; allowed: one run over time \(of a sweep, one point\)"):
        save_animation(run.expand_dims("S"), tmp_path / "b.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_speed() -> None:
    assert [animation._speed(count, None) for count in (3, 101, 5000)] == [2, 10.1, 25]
    assert animation._speed(101, 7.0) == 7


def test_the_accessor(run: xr.Dataset, small: None, tmp_path: Path) -> None:
    assert run.kinetic.animate(tmp_path / "a.gif", fps=10) == tmp_path / "a.gif"
    with Image.open(tmp_path / "a.gif") as movie:
        assert (movie.n_frames, movie.info["duration"]) == (4, 100)
    with pytest.raises(OutputExistsError):
        run.kinetic.animate(tmp_path / "a.gif")
    run.kinetic.animate(tmp_path / "a.gif", overwrite=True)
    found = run.kinetic.animate()
    assert isinstance(found, FuncAnimation)
    found.save(tmp_path / "b.gif", PillowWriter(5))
    frames = pictures(tmp_path / "b.gif")
    assert len(frames) == 4
    assert (frames[0] != frames[3]).any()
    plt.close("all")


def test_the_command(run: xr.Dataset, small: None, command: Command, tmp_path: Path) -> None:
    write_dataset(run, tmp_path / "out.nc")
    done = command("animate", "out.nc", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "wrote out.gif: 4 pictures\n")
    done = command("animate", "out.nc", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "error: out.gif: exists already; use --overwrite to replace it, or name another file with -o\n"
    assert command("animate", "out.nc", "--overwrite", "--fps", "5", folder=tmp_path).returncode == 0
    done = command("animate", "none.nc", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, "error: none.nc: there is no such file\n")
