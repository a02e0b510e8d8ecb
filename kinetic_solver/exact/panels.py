"""Gauss-Legendre panels of many integrals at once, halved until what is integrated over them is resolved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError

ORDER = 20
"""Nodes of a panel."""
NODES, GAUSS = np.polynomial.legendre.leggauss(ORDER)
_DEGREES = np.arange(ORDER - 3, ORDER)
TAIL: Array = (_DEGREES + 0.5)[:, None] * GAUSS * np.polynomial.legendre.legvander(NODES, ORDER - 1)[:, _DEGREES].T
"""From values at a panel's nodes to their last three Legendre coefficients."""
RESOLVED = 1e-9
"""These coefficients over the integrand's largest value, below which a panel is resolved: coefficients fall geometrically, and
the rule leaves those from the 40th on, about the square of the 20th."""
NOTHING = 1e-290
"""Values below this have lost digits, as numbers end at 1e-308."""
MOST = 400_000
"""Panels alive at once: beyond it places cost too much, about a second each. Chosen, for a gigabyte of memory."""
MOST_HALVINGS = 60
"""Of a panel: then it is as narrow as numbers are apart."""

Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Panels:
    """Intervals, each a part of one integral."""

    owner: Integers
    """The integral's number."""
    low: Array
    high: Array

    @classmethod
    def between(cls, edges: Array) -> Panels:
        """Those between neighbours of the rows of `edges`, (integrals, edges), in any order; edges that coincide leave none."""
        edges = np.sort(edges, axis=1)
        owner, at = np.nonzero(edges[:, 1:] > edges[:, :-1])
        return cls(owner, edges[owner, at], edges[owner, at + 1])

    @property
    def size(self) -> int:
        return self.owner.size

    @property
    def centre(self) -> Array:
        return (self.low + self.high) / 2

    @property
    def half(self) -> Array:
        return (self.high - self.low) / 2

    @property
    def nodes(self) -> Array:
        """Shape (panels, ORDER)."""
        return np.asarray(self.centre[:, None] + self.half[:, None] * NODES)

    @property
    def weights(self) -> Array:
        """Of the nodes, likewise."""
        return np.asarray(self.half[:, None] * GAUSS)

    def chosen(self, mask: NDArray[np.bool_]) -> Panels:
        return Panels(self.owner[mask], self.low[mask], self.high[mask])

    def halved(self) -> Panels:
        centre = self.centre
        return Panels(np.tile(self.owner, 2), np.concatenate([self.low, centre]), np.concatenate([centre, self.high]))


def joined(parts: list[Panels]) -> Panels:
    """All of them, ordered by their integral and from low to high."""
    owner, low, high = (np.concatenate([getattr(p, name) for p in parts]) for name in ("owner", "low", "high"))
    order = np.lexsort((low, owner))
    return Panels(owner[order], low[order], high[order])


def resolved(
    panels: Panels, integrands: Callable[[Panels], tuple[Array, NDArray[np.bool_]]], time: float, least: float = NOTHING
) -> Panels:
    """Panels that are narrow enough for every integrand.

    `integrands` gives the values at the nodes, (integrands, panels, ORDER), and whether a panel is too wide whatever they look
    like; values below `least` do not matter. Raises SceneError where there would be too many.
    """
    done: list[Panels] = []
    largest: Array | None = None
    for _ in range(MOST_HALVINGS):
        check(panels.size, time)
        values, wide = integrands(panels)
        if largest is None:
            largest = np.zeros((values.shape[0], int(panels.owner.max()) + 1))
        for of_all, of_one in zip(largest, values, strict=True):
            np.maximum.at(of_all, panels.owner, np.abs(of_one).max(axis=1))
        tail = np.abs(values @ TAIL.T).max(axis=2)
        rough = wide | (tail > RESOLVED * largest[:, panels.owner] + least).any(axis=0)
        done.append(panels.chosen(~rough))
        if not rough.any():
            break
        panels = panels.chosen(rough).halved()
    return joined(done)


def check(count: int, time: float) -> None:
    """Raises SceneError where so many panels would take too long."""
    if count > MOST:
        raise SceneError(
            f"run.end_time: at t = {time:g} so much has met that the closed form takes more than {MOST} panels of starting "
            "points; allowed: an earlier time"
        )
