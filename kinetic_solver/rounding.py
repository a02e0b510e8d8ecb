"""Numbers that differ by rounding alone, made one: for tables that are kept by them."""

from __future__ import annotations

import math

DIGITS = 40
"""Binary digits that count: numbers that differ relatively by 1e-12. Chosen: far above rounding."""


def rounded(value: float, digits: int = DIGITS) -> float:
    """The nearest number of so many binary digits. Of decimal ones it would depend on the units of a scene: 2^n times the value
    gives 2^n times the result, to the last bit (tests/invariants/test_units_of_scenes.py)."""
    mantissa, exponent = math.frexp(value)
    return math.ldexp(round(math.ldexp(mantissa, digits)), exponent - digits)
