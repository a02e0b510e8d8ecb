"""How substeps are composed in time. Knows no physics: a substep is any callable (f, dt) → f."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Substep = Callable[[Array, float], Array]


def strang(outer: Substep, inner: Substep, f: Array, interval: float, steps: int) -> Iterator[tuple[Array, bool]]:
    """Strang's (1968) splitting over `interval` in `steps` equal steps: outer(h/2) inner(h) outer(h/2), second order in h.

    The outer half steps of neighbouring steps are done as one. Yields (f, whole) after each inner substep, with
    whole = False for states between an inner and an outer substep (fit for checks, not for output), and last (f, True).
    """
    h = interval / steps
    f = outer(f, h / 2)
    for n in range(steps):
        f = inner(f, h)
        if n < steps - 1:
            yield f, False
            f = outer(f, h)
    yield outer(f, h / 2), True
