"""What two sides have in common: times, velocities, and the scene but for what notes say."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.compare.sides import Side
from kinetic_solver.errors import SceneError

SAME_TIME = 1e-9
"""Difference between two times, relative to the longest, below which they are the same."""
MOST_VELOCITIES = 64
"""Velocities on which particles are counted, where the other side has more or none."""


def differences(a: Side, b: Side) -> list[str]:
    """What is not the same in the two scenes, a line each. Raises SceneError where the period is not."""
    if a.scene is None or b.scene is None:
        return []
    if not math.isclose(a.scene.pipe.length, b.scene.pipe.length, rel_tol=1e-9):
        raise SceneError(
            f"pipe.length: {a.scene.pipe.length:g} in {a.name}, {b.scene.pipe.length:g} in {b.name}; allowed: the same"
        )
    notes = []
    for table in ("model", "collisions", "initial"):
        ours, theirs = (getattr(side.scene, table) for side in (a, b))
        if ours != theirs:
            one, other = (part.model_dump(exclude_none=True) if part is not None else {} for part in (ours, theirs))
            keys = sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))
            notes += [f"the scenes differ: {table}.{key} is {one.get(key)} and {other.get(key)}" for key in keys]
    return notes


def common_velocities(a: Side, b: Side) -> Array:
    """The velocities of the one with chance in it, else of the coarser one, that lie within the other's."""
    known = [v for v in (a.v, b.v) if v is not None]
    if not known:
        lowest, highest = zip(a.velocity_range, b.velocity_range, strict=True)
        return np.asarray(np.linspace(min(lowest), max(highest), MOST_VELOCITIES))
    low, high = max(float(v[0]) for v in known), min(float(v[-1]) for v in known)
    if len(known) == 1:
        return known[0] if known[0].size <= MOST_VELOCITIES else np.asarray(np.linspace(low, high, MOST_VELOCITIES))
    fixed = [v for side, v in zip((a, b), known, strict=True) if side.stochastic]
    chosen = fixed[0] if len(fixed) == 1 else max(known, key=lambda v: float(v[1] - v[0]))
    return chosen[(chosen >= low - 1e-12) & (chosen <= high + 1e-12)]


def shared_times(a: Side, b: Side, field: str, time: float | None, notes: list[str]) -> list[float]:
    """Times at which both have a field. A single frame without a time takes `time`, or the other side's last. Adds to `notes`
    what only one of them has."""
    ours, theirs = a.times(field), b.times(field)
    for side, own, other in ((a, ours, theirs), (b, theirs, ours)):
        if own.size == 1 and math.isnan(own[0]) and other.size:
            own[0] = other[-1] if time is None else time
            if time is None and not math.isnan(own[0]):
                notes.append(f"{side.name} has no time: taken as the other's last, t = {own[0]:g}; another time can be given")
    if ours.size == 1 and theirs.size == 1 and math.isnan(ours[0]):
        return [math.nan]
    span = max([SAME_TIME, *(abs(float(t)) for t in (*ours, *theirs) if math.isfinite(t))])
    shared = [float(t) for t in ours if theirs.size and np.abs(theirs - t).min() <= SAME_TIME * span]
    alone = sorted({float(t) for own, other in ((ours, theirs), (theirs, ours)) for t in own
                    if not other.size or np.abs(other - t).min() > SAME_TIME * span})  # fmt: skip
    if not shared and (not ours.size or not theirs.size) and field != "density":
        notes.append(f"not compared: {field}, in one of them alone")
    elif alone:
        notes.append(f"not compared: {len(alone)} time{'s' * (len(alone) > 1)} that one of them alone has (t = {listed(alone)})")
    return shared


def listed(times: list[float]) -> str:
    """The first five of them in words."""
    return ", ".join(f"{t:g}" for t in times[:5]) + (", …" if len(times) > 5 else "")
