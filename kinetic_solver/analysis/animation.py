"""A run as a movie: f(x, v) with the density above and w(v) beside it, a picture for every frame of the file.

A file is read a frame at a time, twice: once for the scales, which stay the same through the movie, and once to draw.
Tests: tests/interface/test_animation.py.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from kinetic_solver.analysis.movie_files import gif, mp4
from kinetic_solver.analysis.moving_picture import MovingPicture
from kinetic_solver.dataset import refuse_existing
from kinetic_solver.errors import SceneError
from kinetic_solver.progress import Progress, telling

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.animation import FuncAnimation

SECONDS = 10.0
"""That a movie lasts by default, within `SLOWEST` and `FASTEST`. Chosen."""
SLOWEST, FASTEST = 2.0, 25.0
"""Pictures a second by default: at least, and at most."""
MOST_A_SECOND = 50.0
"""GIF counts in hundredths of a second, and players take one for ten."""
WRITERS: dict[str, Callable[[MovingPicture, Path, float, Progress], None]] = {".gif": gif, ".mp4": mp4}
"""Ending of a name → what writes such a file."""


def save_animation(
    dataset: xr.Dataset,
    path: str | Path,
    fps: float | None = None,
    overwrite: bool = False,
    progress: bool | Progress | None = None,
) -> int:
    """Write a movie of a run, GIF or MP4 by the ending of its name; returns the number of its pictures, one for each frame.

    `fps`: pictures a second, by default so many that it lasts ten seconds, from 2 to 25. `progress` as of `kinetic_solver.solve`,
    told of (pictures, of how many). The file is there when it is whole.

    Raises SceneError for another ending, for MP4 where matplotlib finds no ffmpeg, and where the dataset has nothing over x to
    show; OutputExistsError where the file exists and may not be replaced; OutputFailed where it cannot be written.
    """
    path = Path(path)
    write = WRITERS.get(path.suffix.lower())
    if write is None:
        raise SceneError(f"{path}: allowed: a name that ends in .gif or .mp4")
    if write is mp4:
        _refuse_without_ffmpeg(path)
    _refuse_speed(fps)
    refuse_existing(path, overwrite)
    if not path.parent.is_dir():
        raise SceneError(f"{path}: cannot be created (its folder does not exist)")
    with telling(progress, "picture") as told:
        tell: Progress = told or (lambda done, end: None)
        picture = MovingPicture(dataset, look=lambda count: tell(0, count))
        part = path.with_name(f"{path.stem}.part{path.suffix}")
        try:
            write(picture, part, _speed(picture.count, fps), tell)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    return picture.count


def animation(dataset: xr.Dataset, fps: float | None = None) -> FuncAnimation:
    """The same movie as matplotlib's animation: for notebooks, `HTML(animation(ds).to_jshtml())`, or to be shown in a window."""
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    _refuse_speed(fps)
    picture = MovingPicture(dataset, plt.figure)
    speed = _speed(picture.count, fps)
    return FuncAnimation(picture.figure, picture.show, frames=picture.count, interval=1000 / speed, blit=True)


def _speed(count: int, fps: float | None) -> float:
    return min(max(count / SECONDS, SLOWEST), FASTEST) if fps is None else fps


def _refuse_speed(fps: float | None) -> None:
    if fps is not None and not 0 < fps <= MOST_A_SECOND:
        raise SceneError(f"fps = {fps:g}: allowed: above 0, up to {MOST_A_SECOND:g}")


def _refuse_without_ffmpeg(path: Path) -> None:
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise SceneError(
            f"{path}: needs the program ffmpeg, which is not found; install it (apt install ffmpeg, conda install ffmpeg, "
            "brew install ffmpeg), or name a file that ends in .gif"
        )
