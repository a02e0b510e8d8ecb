"""`compare`: two datasets of a scene laid over each other, field by field and time by time.

Every field that both have is compared at every time that they share, on points that both can be brought to, and in its mean over
all frames after the first, in which chance has averaged out most. What is tested of each: compare/rows.py.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.comparison import LEVEL, Comparison
from kinetic_solver.compare.recognition import over_the_same_velocities, side_of
from kinetic_solver.compare.rows import LEAST_COUNT, MEAN, Both, Row, W, of_all, over_phase_space, over_v, over_x
from kinetic_solver.compare.shared import common_velocities, differences, listed, shared_times
from kinetic_solver.compare.sides import Side
from kinetic_solver.compare.values import OVER_X, TOTALS, Points, Values, mean_of
from kinetic_solver.dataset import law_of_run
from kinetic_solver.errors import SceneError

UNRESOLVED = 1e-3
"""A frame is not compared where the sum of its shortest waves' amplitudes is more than this share of the maximum. u and θ are
ratios of what has such waves, and are off by several times as much."""
HOPELESS = 0.5
"""A field is not compared where its systematic part may be more than this share of its scale."""
COARSE = 0.1
"""It is pointed out where the systematic part may be more than this share of a field's scale."""
LEAST_VELOCITIES = 8
"""Common points in v without which w and f are not compared."""
MASS = ("mass", "momentum", "energy")
"""What a run must have written for mean and variance of all velocities."""

Seen = dict[str, list[tuple[Values, Values]]]
"""Field → both sides' values at each time after the first, of which the means over frames are made."""


def compare(
    first: str | Path | xr.Dataset,
    second: str | Path | xr.Dataset,
    level: float = LEVEL,
    time: float | None = None,
) -> Comparison:
    """Lay two datasets of a scene over each other: files or Datasets of any method, or positions and velocities of particles.

    `level` is the rate at which datasets of the same scene may be said to differ. `time` is that of particles whose dataset has
    none; the last of the other's by default. Raises SceneError where nothing can be compared: no time, no field, no scene,
    another period, a time that is not in the other.
    """
    names = [str(source) if not isinstance(source, xr.Dataset) else word for source, word in ((first, "A"), (second, "B"))]
    a, b = (side_of(found, name) for found, name in zip(over_the_same_velocities(first, second), names, strict=True))
    scene = a.scene or b.scene
    if scene is None:
        raise SceneError(f"{a.name}, {b.name}: neither has a scene, so the period is not known; allowed: one run of this solver")
    if time is not None and not any(np.isnan(side.times("density")).any() for side in (a, b)):
        raise SceneError(f"time = {time:g}: both have times of their own; allowed: for particles that have none")
    notes = [*differences(a, b), *_unusable(a), *_unusable(b), *_laws(a), *_laws(b)]
    for side in (a, b):
        side.ruling = side.scene or scene
    nx = min(a.nx, b.nx)
    points = Points(nx - 1 + nx % 2, common_velocities(a, b), scene.pipe.length)  # odd: an even nx has a wave without a sine
    rows: list[Row] = []
    if a.fields_usable and b.fields_usable:
        known = _fields(rows, notes, a, b, shared_times(a, b, "density", time, notes), points)
        if all(side.particles or set(MASS) <= set(side.dataset.data_vars) for side in (a, b)):
            _totals(rows, a, b, shared_times(a, b, "mass", time, notes), points)
        else:
            notes.append("not compared: mean and variance of all velocities, in one of them alone (output.scalars)")
        _phase_space(rows, notes, known, shared_times(a, b, "f", time, notes), points)
    hopeless = [row for row in rows if row.bound > HOPELESS * row.scale]
    if hopeless:
        fields, largest = dict.fromkeys(row.field for row in hopeless), max(r.bound / r.scale for r in hopeless if r.scale)
        notes.append(f"not compared: {', '.join(fields)}: the systematic part may be {largest:.2g} of them")
        rows = [row for row in rows if row.bound <= HOPELESS * row.scale]
    if not rows:
        raise SceneError("nothing to compare: " + "; ".join(dict.fromkeys(notes)))
    if (worst := max(row.bound / row.scale if row.scale else 0.0 for row in rows)) > COARSE:
        notes.append(f"the systematic part may be {worst:.2g} of the fields: nothing smaller is seen")
    return Comparison((a.describe(), b.describe()), rows, list(dict.fromkeys(notes)), level, scene)


def _laws(side: Side) -> list[str]:
    """A collision law of its own: then what chance and steps do to particles is bounded as without collisions."""
    name = law_of_run(side.dataset)
    return [] if name is None else [f"{side.name}: law {name!r} is not the scene's own: no prediction is made for its collisions"]


def _unusable(side: Side) -> list[str]:
    if side.fields_usable:
        return []
    return [f"{side.name}: one replica gives no standard errors; set particles.replicas = 8, or output.particles = true"]


def _fields(rows: list[Row], notes: list[str], a: Side, b: Side, times: list[float], points: Points) -> dict[float, Both]:
    """Rows of the fields over x, and of w(v), at each time and in the mean; time → what is known of both sides there."""
    scatter = a.stochastic or b.stochastic
    seen: Seen = {name: [] for name in (*OVER_X, W)}
    known: dict[float, Both] = {}
    in_v = all(side.v is not None or side.particles for side in (a, b))  # hydrodynamics knows no velocities
    for t in times:
        ours, theirs = (side.over_x(t, points, scatter) for side in (a, b))
        theta = np.concatenate([values["temperature"].points for values in (ours, theirs)])
        theta = theta[np.isfinite(theta) & (theta > 0)]
        hottest, coldest = (float(theta.max()), float(theta.min())) if theta.size else (0.0, math.inf)
        both = known[t] = Both(a, b, hottest, coldest, a.unresolved(t) + b.unresolved(t))
        if both.folded > UNRESOLVED:
            notes.append(f"not compared: t = {t:g}: the grids do not hold the waves of the density (of a step?); raise nx")
            continue
        for name in OVER_X:
            pair = ours[name], theirs[name]
            if _finite(pair):
                seen[name] += [pair] * (t > times[0])
                rows.append(over_x(name, t, points.x, *pair, both))
            else:
                why = "values are not finite, as where the density of few particles is not positive"
                notes.append(f"not compared: {name} at t = {t:g}: {why}")
        if in_v and points.v.size >= LEAST_VELOCITIES:
            pair = a.distribution(t, points), b.distribution(t, points)
            if _finite(pair):
                seen[W] += [pair] * (t > times[0])
                rows.append(over_v(t, points.v, *pair, both))
            else:
                notes.append(f"not compared: w(v) at t = {t:g}: values are not finite")
    if not in_v:
        notes.append("not compared: w(v), which hydrodynamics does not have")
    elif points.v.size < LEAST_VELOCITIES:
        shared = f"the velocity windows share {points.v.size} points; allowed: {LEAST_VELOCITIES} or more"
        notes.append(f"not compared: w(v) and f: {shared}")
    resolved = [both for both in known.values() if both.folded <= UNRESOLVED]
    if resolved:
        hottest, coldest = max(both.hottest for both in resolved), min(both.coldest for both in resolved)
        both = Both(a, b, hottest, coldest, max(both.folded for both in resolved))
        _means(
            rows,
            seen,
            lambda name, left, right: (
                over_v(MEAN, points.v, left, right, both) if name == W else over_x(name, MEAN, points.x, left, right, both)
            ),
        )
    return known


def _totals(rows: list[Row], a: Side, b: Side, times: list[float], points: Points) -> None:
    """Rows of the mean and the variance of all velocities, at each time and in the mean."""
    seen: Seen = {name: [] for name in TOTALS}
    variance, both = 1.0, Both(a, b, 0.0, math.inf)
    for t in times:
        ours, theirs = (side.totals(t, points) for side in (a, b))
        variance = float(ours["variance_of_all"].points[0])
        for name in TOTALS:
            seen[name] += [(ours[name], theirs[name])] * (t > times[0])
            rows.append(of_all(name, t, ours[name], theirs[name], variance, both))
    _means(rows, seen, lambda name, left, right: of_all(name, MEAN, left, right, variance, both))


def _means(rows: list[Row], seen: Seen, row: Callable[[str, Values, Values], Row]) -> None:
    """The row of each field's mean over frames, where there are two or more."""
    for name, pairs in seen.items():
        if len(pairs) > 1:
            left, right = (mean_of([pair[side] for pair in pairs]) for side in (0, 1))
            rows.append(row(name, left, right))


def _phase_space(rows: list[Row], notes: list[str], known: dict[float, Both], times: list[float], points: Points) -> None:
    """Rows of f; `known` has, at some of the times, what is known of both sides."""
    if not known or points.v.size < LEAST_VELOCITIES:
        return
    a, b = next(iter(known.values())).a, next(iter(known.values())).b
    fixed = [side for side in (a, b) if side.stochastic and not side.particles]
    if len(fixed) == 2 and (a.nx != b.nx or not all(side.v is not None and np.isin(points.v, side.v).all() for side in fixed)):
        notes.append("not compared: f, which two particle runs have on different grids")
        return
    if fixed:  # whose f is averaged over its own cells
        points = dataclasses.replace(points, nx=fixed[0].nx)
    empty: list[float] = []
    for t in times:
        left, right = (side.phase_space(t, points, a.stochastic or b.stochastic) for side in (a, b))
        theta = _temperature(right.points if left.freedom else left.points, points.v)
        both = known[t] if t in known else Both(a, b, float(theta.max()), float(theta.min()))
        both = dataclasses.replace(both, folded=max(both.folded, a.unresolved_f(t) + b.unresolved_f(t)))
        if both.folded > UNRESOLVED or not _finite((left, right)):
            notes.append(f"not compared: f at t = {t:g}: values that are not finite, or waves that the grids do not hold")
            continue
        row = over_phase_space(t, points.x, points.v, left, right, both)
        if row is None:
            empty.append(t)
        else:
            rows.append(row)
    if empty:
        notes.append(f"not compared: f at t = {listed(empty)}: no cell of x and v holds {LEAST_COUNT} particles of a replica")


def _finite(pair: tuple[Values, Values]) -> bool:
    return all(bool(np.isfinite(values.points).all()) for values in pair)


def _temperature(f: Array, v: Array) -> Array:
    """θ at the points in x at which f (flattened) has particles."""
    f = np.maximum(f.reshape(-1, v.size), 0)
    f = f[f.sum(axis=1) > 0]
    f /= f.sum(axis=1, keepdims=True)
    return np.asarray(f @ v**2 - (f @ v) ** 2)
