"""An exponential Runge-Kutta method: the linear part, however stiff, by its exponential, for which steps need not be short."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.stepping.protocol import BaseMethod, Integral, Rate


class LinearPart(Protocol):
    """f' = Mf + remainder, with states as modes of which each has a matrix of its own; `rate` is what the method is given."""

    def forward(self, f: Array) -> Any:
        """The modes of f, (modes, n)."""
        ...

    def inverse(self, modes: Any) -> Array: ...

    def remainder(self, f: Array, rate: Array) -> Any:
        """Modes of the rest of f', the rate of f being known."""
        ...

    def whole(self, modes: Any, remainder: Any) -> Any:
        """Modes of f'."""
        ...

    def functions(self, h: float) -> tuple[Any, Any, Any]:
        """(φ_1, φ_2, φ_3) of hM, (modes, n, n) each."""
        ...


def krogstad(rate: Rate, linear: LinearPart) -> BaseMethod:
    """Krogstad's (2005) ETDRK4 for f' = Mf + N(f): exact where N is constant, so that a stationary state stays.

    Four rates a step. Written in f' and differences of N: no exponential is needed, and what f' and N conserve is conserved.
    Order 4, from 3 on where the remainder is stiff (M. Hochbruck and A. Ostermann 2005).
    Tests: tests/convergence/test_exponential.py.
    """

    def over(f: Array, interval: float, steps: int, integral: Integral | None = None) -> Array:
        h = interval / steps
        (half1, half2, _), (phi1, phi2, phi3) = linear.functions(h / 2), linear.functions(h)
        modes = linear.forward(f)
        for step in range(steps):

            def rest(stage: Array, share: float, place: float, begun: float = step * h) -> Any:
                """N of a stage at begun + place·h, whose weight in integrals is share·h."""
                found = rate(stage)
                if integral is not None:
                    integral.add(share * h, stage, found, begun + place * h)
                return linear.remainder(stage, found)

            n1 = rest(f, 1 / 6, 0.0)
            whole = linear.whole(modes, n1)
            a = modes + h / 2 * _product(half1, whole)
            n2 = rest(linear.inverse(a), 1 / 3, 0.5)
            n3 = rest(linear.inverse(a + h * _product(half2, n2 - n1)), 1 / 3, 0.5)
            c = modes + h * _product(phi1, whole)
            n4 = rest(linear.inverse(c + 2 * h * _product(phi2, n3 - n1)), 1 / 6, 1.0)
            middle = n2 + n3
            modes = c + h * (_product(phi2, 2 * middle - 3 * n1 - n4) + 4 * _product(phi3, n1 - middle + n4))
            f = linear.inverse(modes)
        return f

    return BaseMethod(over, order=4, stride=1)


def _product(matrices: Any, modes: Any) -> Any:
    return np.matmul(matrices, modes[:, :, None])[:, :, 0]
