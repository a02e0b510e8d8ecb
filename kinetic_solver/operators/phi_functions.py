"""φ-functions of matrices, for exponential integrators: tables for step lengths that are one another's doubles.

φ_0 = exp, φ_(n+1)(z) = [φ_n(z) - 1/n!]/z. Scaling and squaring: a Taylor polynomial where |hM| < 4, then doublings
(L. A. Skaflestad and W. M. Wright 2009),

    φ_n(2z) = 2^(-n) [exp(z) φ_n(z) + Σ_(j=1)^n φ_j(z)/(n - j)!],

so that each step length costs four products of matrices more than half of it. exp(2z) is the square of exp(z): by 1 + zφ_1(z)
each doubling would raise rounding errors |z| times. Tests: tests/invariants/test_relaxation.py.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.rounding import rounded

Matrices = NDArray[np.complex128] | NDArray[np.float64]

Functions = tuple[Matrices, Matrices, Matrices, Matrices]
"""exp, φ_1, φ_2, φ_3."""

DEGREE, REACH = 27, 4.0
"""Of the Taylor polynomial of φ_3, and the |z| up to which it serves: the first term left out is 4^28/31! = 9e-18. It is
evaluated in powers of z⁴, which costs less than the doublings from a shorter length."""
LEVELS = 2
"""Tables that are kept in any case: a step takes those of its length and of half of it."""
MOST_BYTES = 2e8
"""Of all tables of one stack of matrices that are kept. Chosen."""


class PhiTables:
    """φ_1, φ_2, φ_3 of hM for each matrix M of a stack (count, n, n).

    The bits of a table depend on M and h alone, not on what was asked for before.
    """

    def __init__(self, matrices: Matrices) -> None:
        self.matrices = matrices
        self._norm = float(np.abs(matrices).sum(axis=1).max())
        if not math.isfinite(self._norm):
            # a programming error: operators/relaxation.py has looked
            raise ValueError("φ-functions of a matrix that is not finite")
        self._kept: OrderedDict[tuple[float, int], Functions] = OrderedDict()
        self._most = max(LEVELS, int(MOST_BYTES / (4 * matrices.nbytes)))
        self._lock = threading.Lock()

    def get(self, h: float) -> tuple[Matrices, Matrices, Matrices]:
        """(φ_1, φ_2, φ_3) of hM."""
        mantissa, exponent = math.frexp(rounded(h))
        with self._lock:
            return self._get(mantissa, exponent)[1:]

    def _get(self, mantissa: float, exponent: int) -> Functions:
        key = (mantissa, exponent)
        if key not in self._kept:
            first = math.floor(-math.log2(max(self._norm * mantissa / REACH, 1e-300)))
            self._kept[key] = self._taylor(mantissa * 2.0**exponent) if exponent <= first else self._doubled(mantissa, exponent)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]

    def _taylor(self, h: float) -> Functions:
        z, one = self.matrices * h, np.eye(self.matrices.shape[-1])
        square = z @ z
        powers = (one, z, square, square @ z)
        fourth: Matrices = square @ square
        third: Any = np.zeros_like(z)
        for n in range(DEGREE - 3, -1, -4):
            part = sum(power / math.factorial(n + m + 3) for m, power in enumerate(powers))
            third = (fourth @ third if n < DEGREE - 3 else third) + part
        second = z @ third + one / 2
        first = z @ second + one
        return z @ first + one, first, second, third

    def _doubled(self, mantissa: float, exponent: int) -> Functions:
        exponential, first, second, third = self._get(mantissa, exponent - 1)
        return (
            exponential @ exponential,
            (exponential @ first + first) / 2,
            (exponential @ second + first + second) / 4,
            (exponential @ third + first / 2 + second + third) / 8,
        )
