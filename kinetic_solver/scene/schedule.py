"""When anything of a run is written: the one owner of that, for every method.

Every group of `[output]` has its own times: 0, every multiple of its cadence, and the end of the run. A run stops at all of
them, merged. Two cadences may ask for times that differ by rounding, or by digits that nobody means (0.1 and 0.100000005):
times within `SAME_TIME` of the shortest cadence are one, the first of them.
Tests: tests/interface/test_schedule.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.scene.cadence import SAME_TIME
from kinetic_solver.scene.scene import Scene


@dataclass(frozen=True)
class Schedule:
    """The times of a run, from 0 to its end, and the groups of `[output]` that are due at each."""

    times: Array
    """(frames,), ascending, further apart than `tolerance`: 0 and end_time are always among them."""
    due: tuple[frozenset[str], ...]
    """For every time the groups to be written then; empty only where nothing at all is asked for."""
    tolerance: float
    """Times no further apart than this are one. Every group is written within it of the times that it asks for."""

    @classmethod
    def of(cls, scene: Scene, groups: Iterable[str]) -> Schedule:
        """Of the groups that a method has. Where `[output]` asks for none of them, the frames of `run.output_every`, empty."""
        end = scene.run.end_time
        own = {group: scene.times(getattr(scene.output, group)) for group in groups}
        own = {group: times for group, times in own.items() if times.size}
        # A cadence beyond the end has frames at 0 and at the end, which stay two times however short the run.
        tolerance = SAME_TIME * min(end, scene.output_every, *(_cadence(scene, group) for group in own))
        if not own:
            times = scene.times()
            return cls(times, (frozenset(),) * times.size, tolerance)
        times = _apart(np.unique(np.concatenate(list(own.values()))), tolerance)
        # Each time's groups as the bits of a number: a long run has a million times, and but a few sets of groups.
        bits = np.zeros(times.size, dtype=np.int64)
        for n, own_times in enumerate(own.values()):
            bits[np.searchsorted(times, own_times, side="right") - 1] |= 1 << n
        sets = {number: frozenset(g for n, g in enumerate(own) if number >> n & 1) for number in np.unique(bits).tolist()}
        times[-1] = end
        return cls(times, tuple(sets[number] for number in bits.tolist()), tolerance)

    def of_group(self, group: str) -> Array:
        """The times at which this group is written, a subset of `times`."""
        return self.times[self._places(group)]

    def dimensions(self, scene: Scene) -> Mapping[str, str]:
        """The time dimension of each group that is written: `time` for those of `run.output_every`, else `time_<group>`."""
        base = scene.times()
        if len(sets := set(self.due)) == 1 and np.array_equal(self.times, base):
            return dict.fromkeys(sorted(*sets), "time")
        nearest = _nearest(self.times, base)
        found = bool(np.all(np.abs(self.times[nearest] - base) <= self.tolerance))
        result = {}
        for group in sorted(frozenset().union(*self.due)):
            shared = found and np.array_equal(np.flatnonzero(self._places(group)), nearest)
            result[group] = "time" if shared else f"time_{group}"
        return result

    def _places(self, group: str) -> np.ndarray:
        return np.array([group in due for due in self.due])


def _cadence(scene: Scene, group: str) -> float:
    cadence = getattr(scene.output, group)
    return scene.output_every if cadence is True else float(cadence)


def _apart(times: Array, tolerance: float) -> Array:
    """Of ascending times the first, and each that follows the last one kept by more than the tolerance."""
    kept, last = [], -math.inf
    for time in times.tolist():
        if time - last > tolerance:
            kept.append(time)
            last = time
    return np.array(kept)


def _nearest(times: Array, wanted: Array) -> np.ndarray:
    """For each wanted time the index of the nearest among ascending ones, of which there are at least two."""
    after = np.clip(np.searchsorted(times, wanted), 1, times.size - 1)
    return np.where(wanted - times[after - 1] <= times[after] - wanted, after - 1, after)
