"""The values that a key takes in a sweep, as text."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from kinetic_solver.errors import SceneError
from kinetic_solver.scene import parse_override, shorten

MOST_VALUES = 100_000
"""Of one key. Chosen: more are asked for by a slip of the pen."""


def parse_values(text: str) -> tuple[str, Any]:
    """ "a.b=0.2:3:16": 16 values from 0.2 to 3, both included, as a list; "a.b=1,2,5" a list; "a.b=value" that value alone.

    What begins with a bracket or a quotation mark is one value, in TOML. Raises SceneError for what is none of these.
    """
    key, _, raw = (part.strip() for part in text.partition("="))
    if raw[:1] in ("[", "{", '"', "'") or not re.search("[:,]", raw):
        return parse_override(text)
    if ":" in raw:
        return key, _steps(key, raw)
    return key, [parse_override(f"{key}={part.strip()}")[1] for part in raw.split(",")]


def _steps(key: str, raw: str) -> list[float]:
    try:
        first, last, count = raw.split(":")
        low, high, number = float(first), float(last), int(count)
    except ValueError:
        raise SceneError(f"{shorten(key)} = {shorten(raw)}: allowed: from:to:number, as in 0.2:3:16") from None
    if not 2 <= number <= MOST_VALUES or not np.isfinite([low, high]).all() or low == high:
        raise SceneError(f"{shorten(key)} = {shorten(raw)}: allowed: two different numbers, and 2 to {MOST_VALUES} values")
    return [float(value) for value in np.linspace(low, high, number)]
