"""A value, and the reason for it: what every rule of this folder returns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Criterion:
    """A number that something may be at most, or must be at least, and why: in words that complete the sentence of `describe`."""

    value: float
    reason: str


def strictest(criteria: Iterable[Criterion]) -> Criterion:
    """The one with the least value."""
    return min(criteria, key=lambda criterion: criterion.value)
