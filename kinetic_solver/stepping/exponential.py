"""An exponential Runge-Kutta method: the linear part, however stiff, by its exponential, for which steps need not be short."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.stepping.embedded import LATER, OneStep, Taken
from kinetic_solver.stepping.protocol import Integral, Rate


class LinearPart(Protocol):
    """f' = Mf + remainder in a frame of its own, with states as modes of which each has a matrix of its own; `rate` is what the
    method is given, and the same in every frame."""

    def forward(self, f: Array) -> Any:
        """The modes of f, (modes, n)."""
        ...

    def inverse(self, modes: Any) -> Array: ...

    def moved(self, modes: Any, time: float) -> Any:
        """From that frame, after this time, to the one in which f is given."""
        ...

    def remainder(self, f: Array, rate: Array) -> Any:
        """Modes of the rest of f', the rate of f being known."""
        ...

    def whole(self, modes: Any, remainder: Any) -> Any:
        """Modes of f'."""
        ...

    def functions(self, h: float) -> tuple[Any, Any, Any]:
        """(φ_1, φ_2, φ_3) of hM, (modes, n, n) each."""
        ...


def krogstad(rate: Rate, linear: LinearPart) -> OneStep:
    """Krogstad's (2005) ETDRK4 for f' = Mf + N(f): exact where N is constant, so that a stationary state stays.

    Written in f' and differences of N: no exponential is needed, and what f' and N conserve is conserved.
    Order 4, from 3 on where the remainder is stiff (M. Hochbruck and A. Ostermann 2005).
    Tests: tests/convergence/test_exponential.py.
    """

    def one(f: Array, h: float, known: Array | None, integral: Integral | None) -> Taken:
        (half1, half2, _), (phi1, phi2, phi3) = linear.functions(h / 2), linear.functions(h)
        modes = linear.forward(f)

        def rest(stage: Array, share: float, place: float, found: Array | None = None) -> Any:
            """N of a stage at place·h, whose weight in integrals is share·h."""
            found = rate(stage) if found is None else found
            if integral is not None:
                integral.add(share * h, stage, found, place * h)
            return linear.remainder(stage, found)

        def curved(of: Any) -> Any:
            """(4 φ_3 - φ_2) of the modes of a second difference of N."""
            return 4 * _product(phi3, of) - _product(phi2, of)

        n1 = rest(f, 1 / 6, 0.0, known)
        whole = linear.whole(modes, n1)
        a = modes + h / 2 * _product(half1, whole)
        n2 = rest(linear.inverse(a), 1 / 3, 0.5)
        n3 = rest(linear.inverse(a + h * _product(half2, n2 - n1)), 1 / 3, 0.5)
        c = modes + h * _product(phi1, whole)
        n4 = rest(linear.inverse(c + 2 * h * _product(phi2, n3 - n1)), 1 / 6, 1.0)
        middle = n2 + n3
        bend = h * curved(n1 - middle + n4)
        new = linear.inverse(linear.moved(c + h * _product(phi2, middle - 2 * n1) + bend, h))
        last = rate(new)
        lower = LATER * h * curved(linear.moved(linear.remainder(new, last), -h) - n4)
        return Taken(new, last, linear.inverse(lower), linear.inverse(bend), linear.inverse(h * n4))

    return one


def _product(matrices: Any, modes: Any) -> Any:
    return np.matmul(matrices, modes[:, :, None])[:, :, 0]
