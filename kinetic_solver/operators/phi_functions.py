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
        z = self.matrices * h
        square = z @ z
        powers, fourth = (z, square, square @ z), square @ square
        diagonal = np.arange(z.shape[-1])
        third: Any = None
        for n in range(DEGREE - 3, -1, -4):
            part = z / math.factorial(n + 4)
            part[:, diagonal, diagonal] += 1 / math.factorial(n + 3)
            for m, power in enumerate(powers[1:], 2):
                part += power / math.factorial(n + m + 3)
            if third is not None:
                part += fourth @ third
            third = part
        second = z @ third
        second[:, diagonal, diagonal] += 1 / 2
        first = z @ second
        first[:, diagonal, diagonal] += 1
        exponential = z @ first
        exponential[:, diagonal, diagonal] += 1
        return exponential, first, second, third

    def _doubled(self, mantissa: float, exponent: int) -> Functions:
        exponential, first, second, third = self._get(mantissa, exponent - 1)
        # In place: passes over memory cost more than products of small matrices.
        one, two, three = exponential @ first, exponential @ second, exponential @ third
        one += first
        one /= 2
        two += first
        two += second
        two /= 4
        three += first / 2
        three += second
        three += third
        three /= 8
        return exponential @ exponential, one, two, three
