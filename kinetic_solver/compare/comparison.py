"""`compare`: every field that two datasets share, at every time that they share, on a common grid, and one verdict.

For each field and time, and for the mean over all frames after the first, three things are tested: the values at the points, the
Fourier amplitudes (of fields over x), and χ² of the first few amplitudes, or of the shares of w(v) in as many ranges of v. Mean
and variance of all velocities are fields of one point. The p of a field is the least of theirs times how many there are, that of
the comparison the least of all times their number (Bonferroni), where means over frames and single times have half of the level
each: whatever is correlated with what, datasets of the same scene are said to differ at most at the rate `level`. Where neither
has chance in it, they differ if a point does by more than the bound.
Tests: tests/compare/test_compare.py; the rate at which right scenes pass and errors of 1 % are found: docs/compare.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.rows import LEAST_COUNT, MEAN, Both, Row, W, of_all, over_phase_space, over_v, over_x
from kinetic_solver.compare.sides import OVER_X, SAME_TIME, TOTALS, Side, Values, mean_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

LEVEL = 0.01
UNRESOLVED = 1e-3
"""Sum of the shortest waves' amplitudes over the maximum, beyond which a frame is not compared: u and θ, ratios of what has such
waves, are off by several times as much."""
HOPELESS = 0.5
"""Bound on the systematic part over a field's scale, beyond which it is not compared."""
COARSE = 0.1
"""Bound on the systematic part over a field's scale, beyond which it is pointed out."""
LEAST_VELOCITIES = 8
"""Common points in v for w and f to be compared."""
MASS = ("mass", "momentum", "energy")
MOST_LINES = 25
"""Of the table; what is longer is cut to one line a field."""


_ALONG: dict[str, tuple[str, ...]] = {W: ("v",), "f": ("x_of_f", "v_of_f"), **dict.fromkeys(TOTALS, ())}


@dataclasses.dataclass(frozen=True)
class Comparison:
    sides: tuple[str, str]
    rows: list[Row]
    notes: list[str]
    """What could not be compared, and what is not known."""
    level: float
    scene: Scene

    @property
    def p(self) -> float:
        """Half of the level is for means over frames, which are few and sharp, half for single times."""
        means = [row.p for row in self.rows if row.time == MEAN]
        single = [row.p for row in self.rows if row.time != MEAN]
        groups = [group for group in (means, single) if group]
        return min(1.0, len(groups) * min(len(group) * min(group) for group in groups))

    @property
    def differ(self) -> bool:
        return self.p < self.level

    @property
    def verdict(self) -> str:
        word = "they differ" if self.differ else "no difference found"
        if all(np.isnan(row.z).all() for row in self.rows):
            worst = max(float(np.abs(row.difference).max() / row.bound) for row in self.rows)
            return f"{word}: at most {worst:.2g} times what the systematic parts allow"
        return f"{word}: p = {self.p:.2g} over {len(self.rows)} fields and times, level {self.level:g}"

    def lines(self) -> list[str]:
        """As text: the sides, a table, what was not compared, the verdict."""
        columns = ("field", 22), ("time", 9), ("difference", 12), ("systematic", 12), ("at", 14), ("max |z|", 9), ("χ²", 10)
        table = ["".join(f"{name:{'<' if name == 'field' else '>'}{width}}" for name, width in columns) + f"{'of':>4}{'p':>10}"]
        rows = self.rows if len(self.rows) <= MOST_LINES else self.least_likely()
        for row in rows:
            z = np.concatenate([row.z, row.mode_z])
            largest = f"{np.nanmax(np.abs(z)):.2f}" if np.isfinite(z).any() else "–"
            chi = (f"{row.chi_squared if row.chi_squared > 1e-6 else 0:.3g}", row.statistics) if row.statistics else ("–", "–")
            place = "" if row.field in TOTALS else " ".join(f"{part:.3g}" for part in np.atleast_1d(row.points[row.worst]))
            difference = row.difference[row.worst] / row.scale
            when = "mean" if row.time == MEAN else f"{row.time:.4g}"
            table.append(
                f"{row.field:<22}{when:>9}{difference:+12.2e}{row.bound / row.scale:12.1e}{place:>14}{largest:>9}"
                f"{chi[0]:>10}{chi[1]:>4}{row.p:10.2g}"
            )
        if len(rows) < len(self.rows):
            table.append(f"the time at which each field differs most, of {len(self.rows)} fields and times")
        return [*self.sides, "", *table, "", *self.notes, self.verdict]

    def least_likely(self) -> list[Row]:
        """The row of each field with the least p, and of those the largest difference."""
        fields = dict.fromkeys(row.field for row in self.rows)
        return [
            min(
                (row for row in self.rows if row.field == field),
                key=lambda row: (row.p, -np.abs(row.difference).max() / row.scale),
            )
            for field in fields
        ]

    def dataset(self) -> xr.Dataset:
        """(time, x or v): differences, standard errors, z; (time,): χ², p, bounds. NaN where a field is not compared."""
        times = np.array(sorted({row.time for row in self.rows} - {MEAN}))
        data: dict[str, tuple[tuple[str, ...], Array, dict[str, str]]] = {}
        coordinates: dict[str, Array] = {"time": times}
        for field in dict.fromkeys(row.field for row in self.rows):
            rows = [row for row in self.rows if row.field == field]
            along = _ALONG.get(field, ("x",))
            axes = [np.unique(axis) for axis in rows[0].points.T] if len(along) > 1 else [rows[0].points][: len(along)]
            coordinates |= dict(zip(along, axes, strict=True))
            shape = tuple(axis.size for axis in axes)
            per_row: dict[str, tuple[tuple[str, ...], str, list[Array]]] = {
                "difference": (along, "first minus second", [r.difference.reshape(shape) for r in rows]),
                "stderr": (along, "standard error of the difference", [r.error.reshape(shape) for r in rows]),
                "z": (along, "beyond the systematic bound, in standard errors", [r.z.reshape(shape) for r in rows]),
                "mode_z": (
                    (f"amplitude_of_{field}",),
                    f"of {'' if field == 'density' else 'the mean, '}cos 1, sin 1, cos 2, sin 2, …, likewise",
                    [r.mode_z for r in rows],
                ),
                "chi_squared": ((), "Hotelling's T², what the bound grants taken off", [np.array(r.chi_squared) for r in rows]),
                "statistics": ((), "statistics in χ²", [np.array(float(r.statistics)) for r in rows]),
                "systematic": ((), "bound on the systematic part", [np.array(r.bound) for r in rows]),
                "p": ((), "probability of such a difference by chance, at most", [np.array(r.p) for r in rows]),
            }
            for name, (dims, text, values) in per_row.items():
                if values[0].size:
                    full = np.full((times.size, *values[0].shape), np.nan)
                    for row, value in zip(rows, values, strict=True):
                        if row.time == MEAN:
                            data[f"{field}_{name}_of_mean"] = (dims, value, {"long_name": f"{text}, mean over frames"})
                        else:
                            full[np.searchsorted(times, row.time)] = value
                    data[f"{field}_{name}"] = (("time", *dims), full, {"long_name": text})
        attributes = {"first": self.sides[0], "second": self.sides[1], "notes": "\n".join(self.notes), "verdict": self.verdict}
        return xr.Dataset(data, coordinates, {**attributes, "differ": int(self.differ), "level": self.level, "p": self.p})


def compare(
    first: str | Path | xr.Dataset,
    second: str | Path | xr.Dataset,
    level: float = LEVEL,
    time: float | None = None,
) -> Comparison:
    """Lay two datasets of a scene over each other: files or Datasets of any method, or positions and velocities of particles.

    `time` is that of particles whose dataset has none; the last of the other's by default. Raises SceneError where nothing can be
    compared: no time, no field, no scene, another period, a time that is not in the other.
    """
    names = [str(source) if not isinstance(source, xr.Dataset) else word for source, word in ((first, "A"), (second, "B"))]
    a, b = Side(first, names[0]), Side(second, names[1])
    scene = a.scene or b.scene
    if scene is None:
        raise SceneError(f"{a.name}, {b.name}: neither has a scene, so the period is not known; allowed: one run of this solver")
    if time is not None and not any(np.isnan(side.times("density")).any() for side in (a, b)):
        raise SceneError(f"time = {time:g}: both have times of their own; allowed: for particles that have none")
    notes = [*_differences(a, b), *_unusable(a), *_unusable(b)]
    for side in (a, b):
        side.law = side.scene or scene
    nx = min(a.nx, b.nx)
    nx -= 1 - nx % 2
    v = _common_velocities(a, b)
    length = scene.pipe.length
    rows: list[Row] = []
    if a.fields_usable and b.fields_usable:
        shared = _shared_times(a, b, "density", time, notes)
        known = _fields(rows, notes, a, b, shared, nx, v, length)
        if all(side.particles or set(MASS) <= set(side.dataset.data_vars) for side in (a, b)):
            _totals(rows, a, b, _shared_times(a, b, "mass", time, notes), nx, v, length)
        else:
            notes.append("not compared: mean and variance of all velocities, in one of them alone (output.scalars)")
        _phase_space(rows, notes, known, _shared_times(a, b, "f", time, notes), nx, v, length)
    if not rows:
        raise SceneError("nothing to compare: " + "; ".join(dict.fromkeys(notes)))
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


def _fields(
    rows: list[Row], notes: list[str], a: Side, b: Side, times: list[float], nx: int, v: Array, length: float
) -> dict[float, Both]:
    """Fields over x, and w(v), at each time and in their mean over all after the first."""
    x = length * np.arange(nx) / nx
    scatter = a.stochastic or b.stochastic
    seen: dict[str, list[tuple[Values, Values]]] = {name: [] for name in (*OVER_X, W)}
    known: dict[float, Both] = {}
    for t in times:
        ours, theirs = (side.over_x(t, nx, v, length) if scatter else side.at_points(t, nx) for side in (a, b))
        theta = np.concatenate([values["temperature"].points for values in (ours, theirs)])
        theta = theta[np.isfinite(theta) & (theta > 0)]
        hottest, coldest = (float(theta.max()), float(theta.min())) if theta.size else (0.0, math.inf)
        both = known[t] = Both(a, b, hottest, coldest, a.unresolved(t) + b.unresolved(t))
        if both.folded > UNRESOLVED:
            notes.append(f"not compared: t = {t:g}: the grids do not hold the waves of the density (of a step?); raise nx")
            continue
        for name in OVER_X:
            pair = ours[name], theirs[name]
            if all(np.isfinite(values.points).all() for values in pair):
                seen[name] += [pair] * (t > times[0])
                rows.append(over_x(name, t, x, *pair, both))
            else:
                why = "values are not finite, as where the density of few particles is not positive"
                notes.append(f"not compared: {name} at t = {t:g}: {why}")
        if v.size >= LEAST_VELOCITIES:
            pair = a.distribution(t, v, nx, length), b.distribution(t, v, nx, length)
            if all(np.isfinite(values.points).all() for values in pair):
                seen[W] += [pair] * (t > times[0])
                rows.append(over_v(t, v, *pair, both))
            else:
                notes.append(f"not compared: w(v) at t = {t:g}: values are not finite")
    if v.size < LEAST_VELOCITIES:
        notes.append(f"not compared: w(v) and f: the velocity windows share {v.size} points; allowed: {LEAST_VELOCITIES} or more")
    resolved = [both for both in known.values() if both.folded <= UNRESOLVED]
    of_mean = Both(a, b, *(pick(getattr(one, part) for one in resolved) for part, pick in _EXTREMES)) if resolved else None
    for name, pairs in seen.items():
        if len(pairs) > 1 and of_mean is not None:
            left, right = (mean_of([pair[side] for pair in pairs]) for side in (0, 1))
            rows.append(over_v(MEAN, v, left, right, of_mean) if name == W else over_x(name, MEAN, x, left, right, of_mean))
    return known


_EXTREMES: tuple[tuple[str, Callable[[Iterable[float]], float]], ...] = (("hottest", max), ("coldest", min), ("folded", max))


def _totals(rows: list[Row], a: Side, b: Side, times: list[float], nx: int, v: Array, length: float) -> None:
    """Mean and variance of all velocities, likewise."""
    seen: dict[str, list[tuple[Values, Values]]] = {name: [] for name in TOTALS}
    variance, both = 1.0, Both(a, b, 0.0, math.inf)
    for t in times:
        ours, theirs = (side.totals(t, nx, v, length) for side in (a, b))
        variance = float(ours["variance_of_all"].points[0])
        for name in TOTALS:
            seen[name] += [(ours[name], theirs[name])] * (t > times[0])
            rows.append(of_all(name, t, ours[name], theirs[name], variance, both))
    for name, pairs in seen.items():
        if len(pairs) > 1:
            left, right = (mean_of([pair[side] for pair in pairs]) for side in (0, 1))
            rows.append(of_all(name, MEAN, left, right, variance, both))


def _phase_space(
    rows: list[Row], notes: list[str], known: dict[float, Both], times: list[float], nx: int, v: Array, length: float
) -> None:
    """f at the times of `known`, which has what is needed of the fields."""
    if not known or v.size < LEAST_VELOCITIES:
        return
    a, b = next(iter(known.values())).a, next(iter(known.values())).b
    fixed = [side for side in (a, b) if side.stochastic and not side.particles]
    if len(fixed) == 2 and (a.nx != b.nx or not all(side.v is not None and np.isin(v, side.v).all() for side in fixed)):
        notes.append("not compared: f, which two particle runs have on different grids")
        return
    nx = fixed[0].nx if fixed else nx
    empty: list[float] = []
    for t in times:
        left, right = (side.phase_space(t, nx, v, length, a.stochastic or b.stochastic) for side in (a, b))
        theta = _temperature(right.points if left.freedom else left.points, v)
        both = known[t] if t in known else Both(a, b, float(theta.max()), float(theta.min()))
        both = dataclasses.replace(both, folded=max(both.folded, a.unresolved_f(t) + b.unresolved_f(t)))
        if both.folded > UNRESOLVED or not np.isfinite(left.points + right.points).all():
            notes.append(f"not compared: f at t = {t:g}: values that are not finite, or waves that the grids do not hold")
            continue
        row = over_phase_space(t, length * np.arange(nx) / nx, v, left, right, both)
        if row is None:
            empty.append(t)
        else:
            rows.append(row)
    if empty:
        notes.append(f"not compared: f at t = {_listed(empty)}: no cell of x and v holds {LEAST_COUNT} particles of a replica")


def _temperature(f: Array, v: Array) -> Array:
    """θ at the points in x at which f (flattened) has particles."""
    f = np.maximum(f.reshape(-1, v.size), 0)
    f = f[f.sum(axis=1) > 0]
    f /= f.sum(axis=1, keepdims=True)
    return np.asarray(f @ v**2 - (f @ v) ** 2)


def _differences(a: Side, b: Side) -> list[str]:
    """What is not the same in the two scenes."""
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


def _unusable(side: Side) -> list[str]:
    if side.fields_usable:
        return []
    return [f"{side.name}: one replica gives no standard errors; set particles.replicas = 8, or output.particles = true"]


def _common_velocities(a: Side, b: Side) -> Array:
    """The points of the one with chance in it, else of the coarser one, that lie within the other's."""
    own = [side.v for side in (a, b)]
    known = [v for v in own if v is not None]
    if not known:
        v = np.concatenate([side.ensemble(0)[1].ravel() for side in (a, b)])
        return np.asarray(np.linspace(v.min(), v.max(), 64))
    low, high = max(float(v[0]) for v in known), min(float(v[-1]) for v in known)
    if len(known) == 1:
        return known[0] if known[0].size <= 64 else np.asarray(np.linspace(low, high, 64))
    fixed = [v for side, v in zip((a, b), known, strict=True) if side.stochastic]
    chosen = fixed[0] if len(fixed) == 1 else max(known, key=lambda v: float(v[1] - v[0]))
    return chosen[(chosen >= low - 1e-12) & (chosen <= high + 1e-12)]


def _shared_times(a: Side, b: Side, field: str, time: float | None, notes: list[str]) -> list[float]:
    ours, theirs = a.times(field), b.times(field)
    for side, own, other in ((a, ours, theirs), (b, theirs, ours)):
        if own.size == 1 and math.isnan(own[0]) and other.size:
            own[0] = other[-1] if time is None else time
            if time is None and not math.isnan(own[0]):
                notes.append(f"{side.name} has no time: taken as the other's last, t = {own[0]:g}; --time says another")
    if ours.size == 1 and theirs.size == 1 and math.isnan(ours[0]):
        return [math.nan]
    span = max([SAME_TIME, *(abs(float(t)) for t in (*ours, *theirs) if math.isfinite(t))])
    shared = [float(t) for t in ours if theirs.size and np.abs(theirs - t).min() <= SAME_TIME * span]
    alone = sorted({float(t) for own, other in ((ours, theirs), (theirs, ours)) for t in own
                    if not other.size or np.abs(other - t).min() > SAME_TIME * span})  # fmt: skip
    if not shared and (not ours.size or not theirs.size) and field != "density":
        notes.append(f"not compared: {field}, in one of them alone")
    elif alone:
        notes.append(f"not compared: {len(alone)} time{'s' * (len(alone) > 1)} that one of them alone has (t = {_listed(alone)})")
    return shared


def _listed(times: list[float]) -> str:
    return ", ".join(f"{t:g}" for t in times[:5]) + (", …" if len(times) > 5 else "")
