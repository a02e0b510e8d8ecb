"""Tables that a substep makes for a step length and keeps for when that length comes again."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

Table = TypeVar("Table")


class Tables(Generic[Table]):
    """Step length h → table, for the `most` lengths that were asked for last: the one not asked for longest makes room.

    A table is as large as a matrix over v, or over v for each wave. Its maker is named with each request, not kept: an object
    that held a method of its own would be freed late, and the tables of a grid that was left behind with it.
    Test: tests/invariants/test_tables.py.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[float, Table] = OrderedDict()

    def get(self, h: float, make: Callable[[float], Table]) -> Table:
        """The table of h; `make(h)` where it is not there."""
        if h not in self._kept:
            self._kept[h] = make(h)
            if len(self._kept) > self._most:
                self._kept.popitem(last=False)
        self._kept.move_to_end(h)
        return self._kept[h]
