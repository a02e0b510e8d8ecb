"""Pictures one after the other into a file: GIF by Pillow, MP4 by ffmpeg. None of them is kept."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from PIL import GifImagePlugin, Image, ImageChops

from kinetic_solver.analysis.moving_picture import CURVES, SHADES
from kinetic_solver.errors import OutputFailed
from kinetic_solver.progress import Progress

if TYPE_CHECKING:
    from kinetic_solver.analysis.moving_picture import MovingPicture

OF_THE_MAP, OF_A_CURVE = 176, 20
"""Of the 256 colours of a GIF: those of the map, and steps from white to each curve's colour."""
BIT_RATE = 2500
"""Of MP4, kbit/s: curves stay sharp. Chosen."""


def gif(picture: MovingPicture, path: Path, fps: float, progress: Progress) -> None:
    """One palette for all frames, so that no colour flickers; of each frame what differs from the one before it.

    Pillow's own way to save many frames keeps them all in memory until the last.
    """
    palette = _palette()
    delay = 10 * max(2, round(100 / fps))
    last: Image.Image | None = None
    try:
        with path.open("wb") as file:
            for n in range(picture.count):
                shown = Image.fromarray(picture.pixels(n)).quantize(palette=palette, dither=Image.Dither.NONE)
                if last is None:
                    file.writelines(GifImagePlugin.getheader(shown, info={"loop": 0})[0])
                    box = (0, 0, *shown.size)
                else:
                    box = ImageChops.difference(shown.convert("RGB"), last.convert("RGB")).getbbox() or (0, 0, 1, 1)
                file.writelines(GifImagePlugin.getdata(shown.crop(box), offset=box[:2], duration=delay))
                last = shown
                progress(n + 1, picture.count)
            file.write(b";")
    except OSError as error:
        raise OutputFailed(f"{path}: cannot be written ({error.strerror})") from None


def _palette() -> Image.Image:
    colours = [np.array(colormaps[SHADES](np.linspace(0, 1, OF_THE_MAP)))[:, :3]]
    for name in CURVES:
        share = np.linspace(1 / OF_A_CURVE, 1, OF_A_CURVE)[:, None]
        colours.append(1 + share * (np.array(to_rgb(name)) - 1))
    flat = (255 * np.concatenate([*colours, np.ones((1, 3))])).round().astype(np.uint8)
    image = Image.new("P", (1, 1))
    image.putpalette(flat.ravel().tolist())
    return image


def mp4(picture: MovingPicture, path: Path, fps: float, progress: Progress) -> None:
    from matplotlib.animation import FFMpegWriter

    writer = FFMpegWriter(
        fps=fps,  # type: ignore[arg-type]
        codec="h264",
        bitrate=BIT_RATE,
    )
    try:
        with writer.saving(picture.figure, str(path), picture.figure.dpi):
            for n in range(picture.count):
                picture.show(n)
                writer.grab_frame()
                progress(n + 1, picture.count)
    except (OSError, subprocess.CalledProcessError) as error:
        raise OutputFailed(f"{path}: ffmpeg could not write it ({error})") from None
