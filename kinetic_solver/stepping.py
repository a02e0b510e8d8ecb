"""How substeps are composed in time. Knows no physics: a substep is any callable (f, dt) → f."""

from __future__ import annotations

from collections.abc import Callable

from kinetic_solver.arrays import Array

Substep = Callable[[Array, float], Array]
Observer = Callable[[Array, int], None]
"""Called as observer(f, n) when n steps are done, up to an outer half step: fit for checks, not for output."""


def strang(outer: Substep, inner: Substep, f: Array, interval: float, steps: int, observer: Observer) -> Array:
    """f after `interval`, by Strang's (1968) splitting in equal steps: outer(h/2) inner(h) outer(h/2), second order in h.

    The outer half steps of neighbouring steps are done as one. Test: tests/convergence/test_grid_against_exact.py.
    """
    h = interval / steps
    f = outer(f, h / 2)
    for n in range(1, steps):
        f = outer(inner(f, h), h)
        observer(f, n)
    return outer(inner(f, h), h / 2)
