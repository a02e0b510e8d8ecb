"""The picture of one frame of a run, and how it becomes that of another one: axes and scales stay.

Over x: the density, below it f(x, v), or where there is no f the mean velocity and one thermal velocity on both sides of it;
beside that, over the same velocities, w(v). Of a homogeneous run the temperature over time, and w(v).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from kinetic_solver.analysis.drawing import BLUE, DASHES, GREY, ORANGE
from kinetic_solver.analysis.frames import fine_v, fine_x, is_counted, some
from kinetic_solver.analysis.movie_frames import MovieFrames
from kinetic_solver.analysis.panels import SCALED_LABEL
from kinetic_solver.analysis.titles import in_words, method_in_words, stopped_in_words
from kinetic_solver.arrays import Array

if TYPE_CHECKING:
    import xarray as xr

SHADES = "magma"
CURVES = (BLUE, ORANGE, GREY)
SIZE, DPI = (9.0, 5.6), 100
"""Inches, and dots to one: an even number of them, as MP4 needs."""
MOST_DOTS = 900
"""Of a map along either axis: there are no more on the picture."""


class MovingPicture:
    """`show(n)` draws frame n, `pixels(n)` returns it as (height, width, 3) bytes; there are `count` frames."""

    def __init__(
        self,
        dataset: xr.Dataset,
        figure: Callable[..., Figure] | None = None,
        look: Callable[[int], None] = lambda count: None,
    ) -> None:
        """`figure` makes a figure, by default one without a display; `look` and errors as of `MovieFrames`."""
        self._of = MovieFrames(dataset, look)
        self.count = self._of.count
        self._velocity = SCALED_LABEL if self._of.scaled else "velocity v"
        self.figure = (Figure if figure is None else figure)(figsize=SIZE, dpi=DPI)
        self.figure.set_layout_engine(ConstrainedLayoutEngine(rect=(0, 0, 1, 0.92)))  # above is room for two lines
        self._canvas = FigureCanvasAgg(self.figure) if figure is None else None
        self._updates: list[Callable[[int], None]] = []
        self._artists: list[Any] = []
        (self._over_x if self._of.with_x else self._homogeneous)()
        # What comes after the first semicolon is of the picture of a run, or too long for a movie.
        said = [words.partition(";")[0] for words in (method_in_words(dataset), stopped_in_words(dataset))]
        above = f"{in_words(self._of.scene)}\n{'; '.join(filter(None, said))}"
        self.figure.text(0.012, 0.985, above, fontsize=8, color=GREY, va="top")
        self._clock()
        self._background: Any = None

    def show(self, n: int) -> list[Any]:
        """Draw frame n into the figure; returns what has changed."""
        for update in self._updates:
            update(n)
        return self._artists

    def pixels(self, n: int) -> np.ndarray:
        """Axes and what stays are drawn once."""
        assert self._canvas is not None
        if self._background is None:
            for artist in self._artists:
                artist.set_animated(True)
            self.show(0)
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._background)
        for artist in self.show(n):
            (artist.axes or self.figure).draw_artist(artist)
        for axes in self.figure.axes:  # lines of the frame over what was drawn into it
            for spine in axes.spines.values() if axes.axison else ():
                axes.draw_artist(spine)
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()

    # -- panels

    def _add(self, artist: Any, update: Callable[[int], None]) -> None:
        self._artists.append(artist)
        self._updates.append(update)

    def _clock(self) -> None:
        times = self._of.clock
        step = float(np.diff(times).min()) if times.size > 1 else 1.0
        digits = max(0, min(12, 1 - math.floor(math.log10(step)))) if step > 0 else 6
        if abs(times).max() < 1e6 and digits < 7:
            shown = [f"t = {time:.{digits}f}" for time in times]
        else:
            shown = [f"t = {time:.9g}" for time in times]
        text = self.figure.text(0.985, 0.985, "", fontsize=12, ha="right", va="top", family="monospace")
        self._add(text, lambda n: text.set_text(shown[n]))

    def _over_x(self) -> None:
        beside, shown = self._of.has_w, self._of.dataset
        columns = 2 if beside else 1
        grid = self.figure.add_gridspec(2, columns, height_ratios=[1, 2.2], width_ratios=[3.4, 1][:columns])
        below = self.figure.add_subplot(grid[1, 0]) if "f" in shown or "mean_velocity" in shown else None
        above = self.figure.add_subplot(grid[0, 0], sharex=below)
        self._draw_density(above)
        corner = self.figure.add_subplot(grid[0, 1]) if beside else None
        if corner is not None:
            corner.set_axis_off()
        if below is not None:
            above.tick_params(labelbottom=False)
            if "f" in shown:
                self._draw_f(below, corner)
            else:
                self._draw_band(below)
            below.set(xlabel="x", ylabel=self._velocity, xlim=(0, self._of.length), ylim=self._of.speeds)
        if corner is not None:
            axes = self.figure.add_subplot(grid[1, 1], sharey=below)
            self._draw_w(axes, along_y=True)
            corner.legend(*axes.get_legend_handles_labels(), frameon=False, fontsize=7.5, loc="lower left", borderaxespad=0)

    def _homogeneous(self) -> None:
        columns = 2 if self._of.has_w else 1
        self._draw_history(self.figure.add_subplot(1, columns, 1))
        if self._of.has_w:
            axes = self.figure.add_subplot(1, columns, 2)
            self._draw_w(axes, along_y=False)
            axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3)

    def _draw_density(self, axes: Any) -> None:
        def curve(n: int) -> tuple[Array, Array]:
            return fine_x(self._of.dataset, self._of.density(n), axis=0)

        axes.plot(*curve(0), color=GREY, lw=1, alpha=0.45)
        (line,) = axes.plot([], [], color=BLUE, lw=1.8)
        axes.set(
            ylabel="density ρ" if "density" in self._of.dataset else "∫f dv, as shown",
            ylim=self._of.densities,
            xlim=(0, self._of.length),
        )
        self._add(line, lambda n: line.set_data(*curve(n)))
        self._say_other_time(axes, "density")

    def _draw_f(self, axes: Any, corner: Any) -> None:
        def map_of(n: int) -> tuple[Array, Array, Array]:
            x, f = fine_x(self._of.dataset, self._of.frame("f", n), axis=0)
            fine, f = fine_v(self._of.dataset, f)
            columns, rows = some(x.size, MOST_DOTS), some(fine.size, MOST_DOTS)
            return x[columns], fine[rows], f[np.ix_(columns, rows)].T

        x, fine, values = map_of(0)
        half = (x[1] - x[0]) / 2, (fine[1] - fine[0]) / 2
        extent = (x[0] - half[0], x[-1] + half[0], fine[0] - half[1], fine[-1] + half[1])
        between = "nearest" if is_counted(self._of.dataset) else "bilinear"
        style = {"origin": "lower", "aspect": "auto", "interpolation": between, "cmap": SHADES}
        image = axes.imshow(values, extent=extent, vmin=0, vmax=self._of.largest_f, **style)
        bar = corner.inset_axes((0.0, 0.82, 1.0, 0.12))
        self.figure.colorbar(image, cax=bar, orientation="horizontal").set_label(
            "s f(x, v)" if self._of.scaled else "f(x, v)", labelpad=1
        )
        self._add(image, lambda n: image.set_data(map_of(n)[2]))
        self._say_other_time(axes, "f", "white")

    def _draw_band(self, axes: Any) -> None:
        x = np.append(self._of.dataset["x"].values, self._of.length)
        for place, label in ((0, None), (1, "u"), (2, "u ± √θ")):
            (line,) = axes.plot([], [], color=BLUE if label == "u" else ORANGE, lw=1.8 if label == "u" else 1, label=label)

            def update(n: int, line: Any = line, place: int = place) -> None:
                values = self._of.band(n)[place]
                line.set_data(x, np.append(values, values[0]))

            self._add(line, update)
        axes.legend(frameon=False, fontsize=9, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0, ncols=2)

    def _draw_w(self, axes: Any, along_y: bool) -> None:
        """w(v), the Gaussian of the same mean and variance, and where it began; the velocities upwards beside f."""
        v = self._of.v
        assert v is not None

        def both(n: int) -> tuple[Array, Array, Array]:
            w = self._of.w(n)
            fine, curve = fine_v(self._of.dataset, w)
            mass = w.sum()
            mean = (v * w).sum() / mass
            variance = max(float(((v - mean) ** 2 * w).sum() / mass), 1e-300)
            height = mass * (v[1] - v[0]) / math.sqrt(2 * math.pi * variance)
            return fine, curve, height * np.exp(-((fine - mean) ** 2) / (2 * variance))

        def place(fine: Array, curve: Array) -> tuple[Array, Array]:
            return (curve, fine) if along_y else (fine, curve)

        fine, curve, _ = both(0)
        axes.plot(*place(fine, curve), color=GREY, lw=1, alpha=0.45, label="at the start")
        (line,) = axes.plot([], [], color=BLUE, lw=3, alpha=0.7, label="w(v)")
        top, label = (0, 1.05 * self._of.largest_w), "s w(v)" if self._of.scaled else "w(v)"
        if along_y:
            axes.set(xlabel=label, xlim=top, ylim=self._of.speeds)
            axes.tick_params(labelleft=False)
        else:
            axes.set(xlabel=self._velocity, ylabel=label, ylim=top, xlim=self._of.speeds)
        self._add(line, lambda n: line.set_data(*place(*both(n)[:2])))
        if not self._of.cut:  # else it is not known
            (gaussian,) = axes.plot([], [], color="k", lw=0.9, ls=DASHES, label="Gaussian, same moments")
            self._add(gaussian, lambda n: gaussian.set_data(*place(both(n)[0], both(n)[2])))
        self._say_other_time(axes, "velocity_distribution")

    def _draw_history(self, axes: Any) -> None:
        """The temperature over time, and where on it the movie is."""
        if "temperature" not in self._of.dataset:
            axes.set_axis_off()
            return
        times = self._of.times["temperature"]
        theta = np.asarray(self._of.dataset["temperature"].values[: times.size, 0])
        axes.plot(times, theta, color=BLUE, lw=1.5)
        (dot,) = axes.plot([], [], "o", color=ORANGE, ms=8)
        axes.set(xlabel="time t", ylabel="temperature θ")
        if theta.min() > 0 and theta.max() > 30 * theta.min():
            axes.set_yscale("log")
        clock = self._of.clock
        self._add(dot, lambda n: dot.set_data([clock[n]], [np.interp(clock[n], times, theta)]))

    def _say_other_time(self, axes: Any, name: str, colour: str = GREY) -> None:
        """In the panel, where its field is that of another time than the movie's."""
        if name not in self._of.times or self._of.times[name].size == self.count:
            return
        text = axes.text(0.02, 0.95, "", transform=axes.transAxes, va="top", fontsize=8, color=colour)

        def update(n: int) -> None:
            shown = self._of.times[name][self._of.index(name, n)]
            text.set_text("" if abs(shown - self._of.clock[n]) <= self._of.same else f"at t = {shown:.6g}")

        self._add(text, update)
