"""When anything of a run is written: the one owner of that, for every method.

Every group of `[output]` has its own times (`Scene.times`). A run stops at all of them, merged; two times nearer than
`SAME_TIME` of the shortest cadence are one, the earlier.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array

if TYPE_CHECKING:
    from kinetic_solver.scene.scene import Scene

SAME_TIME = 1e-6
"""Of the shortest cadence: far above rounding of multiples of a cadence, far below what anyone wants to tell apart."""


def multiples(cadence: float, end: float) -> Array:
    """0, every cadence, and the end; a multiple that is the end but for `SAME_TIME` of a cadence makes no frame beside it."""
    times = cadence * np.arange(math.floor(end / cadence + SAME_TIME) + 1)
    if times.size == 1 or end - times[-1] > SAME_TIME * cadence:
        return np.append(times, end)
    times[-1] = end
    return times


@dataclass(frozen=True)
class Schedule:
    """The times of a run, from 0 to its end, and the groups of `[output]` that are due at each."""

    times: Array
    """(frames,), ascending: 0 and end_time are always among them."""
    due: tuple[frozenset[str], ...]
    """For every time the groups to be written then; empty only where nothing at all is asked for."""

    @classmethod
    def of(cls, scene: Scene, groups: Iterable[str]) -> Schedule:
        """Of the groups that a method has. Where `[output]` asks for none of them, the frames of `run.output_every`, empty."""
        own = {group: scene.times(getattr(scene.output, group)) for group in groups}
        own = {group: times for group, times in own.items() if times.size}
        if not own:
            times = scene.times()
            return cls(times, (frozenset(),) * times.size)
        merged = np.unique(np.concatenate(list(own.values())))
        same = SAME_TIME * min(_cadence(scene, group) for group in own)
        times = merged[np.append(True, np.diff(merged) > same)]
        # A group's time counts as the first of those that are one with it, which is the last that is no later.
        places = {group: np.unique(np.searchsorted(times, own_times, side="right") - 1) for group, own_times in own.items()}
        due: list[set[str]] = [set() for _ in times]
        for group, indices in places.items():
            for n in indices.tolist():
                due[n].add(group)
        times[-1] = scene.run.end_time
        return cls(times, tuple(map(frozenset, due)))

    def of_group(self, group: str) -> Array:
        """The times at which this group is written."""
        return self.times[[group in due for due in self.due]]

    def dimensions(self, scene: Scene) -> Mapping[str, str]:
        """The time dimension of each group that is written: `time` for those of `run.output_every`, else `time_<group>`."""
        result = {}
        base = scene.times()
        same = SAME_TIME * scene.output_every
        for group in sorted(frozenset().union(*self.due)):
            own = self.of_group(group)
            shared = own.size == base.size and bool(np.all(np.abs(own - base) <= same))
            result[group] = "time" if shared else f"time_{group}"
        return result


def _cadence(scene: Scene, group: str) -> float:
    cadence = getattr(scene.output, group)
    return scene.output_every if cadence is True else float(cadence)
