"""Base methods, which compose substeps into equal steps over an interval, and Richardson extrapolation of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.stepping.protocol import BaseMethod, Integral, Rate, Substep


def strang(outer: Substep, inner: Substep) -> BaseMethod:
    """Strang's (1968) splitting outer(h/2) inner(h) outer(h/2); the outer half steps of neighbouring steps are done as one.

    Order 2, error in even powers of h where both substeps are exact; positive where they are. It has no rates to integrate.
    Test: tests/convergence/test_stepping.py.
    """

    def over(f: Array, interval: float, steps: int, integral: Integral | None = None) -> Array:
        h = interval / steps
        f = outer(f, h / 2)
        for _ in range(steps - 1):
            f = outer(inner(f, h), h)
        return outer(inner(f, h), h / 2)

    return BaseMethod(over, order=2, stride=2)


def lawson(rate: Rate, linear: Substep) -> BaseMethod:
    """The classical fourth-order Runge-Kutta method in Lawson's (1967) variable exp(-tL) f: the linear part L is exact.

    Four rates and four linear half steps a step, none backwards in time. What rate and linear step both conserve is conserved to
    round-off. Stable for steps below about 2.8/|the rate's eigenvalue|. Order 4. Test: tests/convergence/test_stepping.py.
    """

    def over(f: Array, interval: float, steps: int, integral: Integral | None = None) -> Array:
        h = interval / steps
        for step in range(steps):

            def seen(stage: Array, share: float, place: float, begun: float = step * h) -> Array:
                """The rate of a stage at begun + place·h, whose weight is share·h."""
                found = rate(stage)
                if integral is not None:
                    integral.add(share * h, stage, found, begun + place * h)
                return found

            k1 = seen(f, 1 / 6, 0.0)
            f, k1 = linear(f, h / 2), linear(k1, h / 2)
            k2 = seen(f + h / 2 * k1, 1 / 3, 0.5)
            k3 = seen(f + h / 2 * k2, 1 / 3, 0.5)
            k4 = seen(linear(f + h * k3, h / 2), 1 / 6, 1.0)
            f = linear(f + h / 6 * k1 + h / 3 * (k2 + k3), h / 2) + h / 6 * k4
        return f

    return BaseMethod(over, order=4, stride=1)


class Extrapolated:
    """Richardson extrapolation: results of a base method with `counts` steps, combined so that the leading errors cancel.

    One error term h^p less for every count after the first. Strang's method with counts (1, 2, 3, 4) has order 8, Lawson's with
    (1, 2) order 5; with one count the base method is taken as it is. Positivity is lost by terms of the order of the error.

    What results without the last cancellation differ by belongs to the order below. With a `gain` G the error of the best result
    is estimated instead: a step that errs by e h^(p+1) without it, over max f, errs by about G e^((p+2)/(p+1)) with it.
    Orders, two-sided, and that estimate: tests/convergence/test_stepping.py.
    """

    def __init__(self, base: BaseMethod, counts: Sequence[int] = (1,), gain: float | None = None) -> None:
        self.base = base
        self.counts = tuple(counts)
        self.gain = gain
        powers = [base.order + base.stride * n for n in range(len(self.counts) - 1)]
        self.order = base.order + base.stride * len(powers)
        self._below = powers[-1] if powers else None
        self.error_order = self.order if powers and gain is not None else self._below
        """Of the error that `step` estimates: that of the result without the last cancellation, or with a gain its own."""
        self._weights = _weights(self.counts, powers)
        self._lower = np.append(0.0, _weights(self.counts[1:], powers[:-1])) if powers else self._weights

    def onward(
        self, f: Array, h: float, integral: Integral | None = None, known: Array | None = None
    ) -> tuple[Array, float, None]:
        """As `step`; no rate is handed on."""
        return *self.step(f, h, integral), None

    def step(self, f: Array, h: float, integral: Integral | None = None) -> tuple[Array, float]:
        """(f after h, the estimated max|error|, without a gain that of the next lower order; 0 where nothing is extrapolated).

        What is watched is added to `integral`, extrapolated likewise.
        """
        finest = self.base.over(f, h, self.counts[-1], integral)
        watched = np.zeros(()) if integral is None else integral.value
        best, lower = finest.copy(), np.zeros_like(f)
        # Corrections to the finest result: what all results conserve stays, though the weights are rounded.
        for n, weight, low in zip(self.counts[:-1], self._weights, self._lower, strict=False):
            coarser = None if integral is None else Integral(integral.quantities, integral.start)
            correction = self.base.over(f, h, n, coarser) - finest
            best += weight * correction
            lower += (weight - low) * correction
            if integral is not None and coarser is not None:
                integral.value = integral.value + weight * (coarser.value - watched)
        error = float(np.abs(lower).max())
        if self.gain is not None and self._below is not None:
            top = float(np.abs(f).max())
            error = self.gain * top * (error / top) ** ((self.order + 1) / (self._below + 1))
        return best, error


def _weights(counts: Sequence[int], powers: Sequence[int]) -> Array:
    """w with Σ w = 1 and Σ w n^(-p) = 0 for each power p."""
    rows = [[float(n) ** -p for n in counts] for p in (0, *powers)]
    return np.asarray(np.linalg.solve(rows, np.eye(len(counts))[0]))
