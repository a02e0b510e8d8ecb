"""What all pictures share: colours, readable logarithmic axes, and the writing of a file.

Figures are drawn on canvases of their own, so no display is needed. Modules that draw are imported only when asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from kinetic_solver.errors import SceneError

BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
"""Colours of the palette of Okabe and Ito (2008), which colour-blind readers can tell apart."""
GREY = "0.25"
"""Colour of lines and words that only help to read."""

DASHES = (0, (5, 2))
"""Of curves that are drawn over others, which are seen between the dashes."""


def save(figure: Figure, path: str | Path) -> None:
    """Write one file, whose ending gives the format. Raises SceneError where that cannot be done."""
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be written ({error})") from None


def shades(count: int, lightest: float = 0.8) -> Sequence[Any]:
    """Colours for curves that differ in a number: the darker, the less; `lightest` keeps off the palest yellow at 1."""
    return list(colormaps["viridis"](np.linspace(0.0, lightest, count)))


def plain_logs(axis: Any, decades: float = 1.0) -> None:
    """A logarithmic axis with 0.01, 2, 1000 written so, powers of ten beyond; the shorter it is, the more is labelled."""

    def text(y: float, _: Any) -> str:
        if not 0 < y < math.inf:  # an axis up to the largest of numbers has ticks beyond it
            return ""
        if 1e-4 < y < 1e6 and (decades < 3 or y < 1e4):
            return f"{y:g}"
        power = math.floor(math.log10(y) + 1e-9)
        size = round(y / 10.0**power)
        return f"${size} \\cdot 10^{{{power}}}$" if size > 1 else f"$10^{{{power}}}$"

    subs = range(1, 10) if decades < 0.7 else (1, 2, 5) if decades < 3 else (1,)
    axis.set_major_locator(LogLocator(subs=[float(n) for n in subs]))
    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(NullFormatter())
