"""What a comparison found: a row for each field and time, and one verdict.

For each field and time, and for the mean over all frames after the first, three things are tested: the values at the points, the
Fourier amplitudes (of fields over x), and χ² of the first few amplitudes, or of the shares of w(v) in as many ranges of v. Mean
and variance of all velocities are fields of one point. The p of a field is the least of theirs times how many there are, that of
the comparison the least of all times their number (Bonferroni), where means over frames and single times have half of the level
each: whatever is correlated with what, datasets of the same scene are said to differ at most at the rate `level`. Where neither
has chance in it, they differ if a point does by more than the bound.
Tests: tests/cross_validation/compare/. The rate at which right scenes pass and errors of 1 % are found:
docs/compare_details.md.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import xarray as xr

from kinetic_solver.arrays import Array
from kinetic_solver.compare.rows import MEAN, Row, W
from kinetic_solver.compare.values import TOTALS
from kinetic_solver.scene import Scene

LEVEL = 0.01
"""Rate at which two datasets of the same scene may be said to differ."""
WIDE = 0.1
"""Of a field's scale: where differences may be larger and not be seen, that none is found says too little. Chosen: half of what
makes two curves look different."""
ERRORS = 2.0
"""Standard errors that chance covers: smaller differences are not seen."""
MOST_LINES = 25
"""Rows that the table shows; of more than that, it shows one for each field."""

_ALONG: dict[str, tuple[str, ...]] = {W: ("v",), "f": ("x_of_f", "v_of_f"), **dict.fromkeys(TOTALS, ())}
"""Field → dimensions of its rows in the dataset; ("x",) for all others."""


@dataclasses.dataclass(frozen=True)
class Comparison:
    """What `compare` returns."""

    sides: tuple[str, str]
    """Each in one line."""
    rows: list[Row]
    notes: list[str]
    """What could not be compared, and what is not known."""
    level: float
    """Rate at which two datasets of the same scene may be said to differ."""
    scene: Scene
    """Of the first that has one."""

    @property
    def p(self) -> float:
        """Probability of such differences by chance, at most. Half of the level is for means over frames, which are few and
        sharp, half for single times."""
        means = [row.p for row in self.rows if row.time == MEAN]
        single = [row.p for row in self.rows if row.time != MEAN]
        groups = [group for group in (means, single) if group]
        return min(1.0, len(groups) * min(len(group) * min(group) for group in groups))

    @property
    def differ(self) -> bool:
        return self.p < self.level

    @property
    def hidden(self) -> float:
        """The largest share of a scale up to which differences are not judged: what is granted to the systematic parts, and with
        it what chance covers at the time, or in the mean over frames, at which a field is known best. (Not of f, whose cells hold
        few particles: w(v) and the fields over x are its sums.)"""
        best: dict[str, float] = {}
        for row in self.rows:
            chance = ERRORS * math.sqrt(float(np.mean(np.nan_to_num(row.error) ** 2)))
            share = (row.bound + (chance if row.field != "f" else 0.0)) / row.scale
            best[row.field] = min(best.get(row.field, math.inf), share)
        return max(*best.values(), *(row.bound / row.scale for row in self.rows))

    @property
    def conclusive(self) -> bool:
        """False where no difference is found, and `WIDE` ones would not be."""
        return self.differ or self.hidden <= WIDE

    @property
    def verdict(self) -> str:
        """In one line."""
        word = "they differ" if self.differ else "no difference found"
        if not self.conclusive:
            word = f"inconclusive: differences below {100 * self.hidden:.2g} % cannot be judged"
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

    def facts(self) -> dict[str, Any]:
        """The same as plain values, for other programs: numbers relative to each field's scale."""
        return {
            "verdict": self.verdict,
            "differ": self.differ,
            "conclusive": self.conclusive,
            "p": self.p,
            "level": self.level,
            "sides": list(self.sides),
            "notes": self.notes,
            "rows": [
                {
                    "field": row.field,
                    "time": "mean" if row.time == MEAN else row.time,
                    "difference": float(row.difference[row.worst]) / row.scale,
                    "systematic": row.bound / row.scale,
                    "p": row.p,
                }
                for row in self.rows
            ],
        }

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
        return xr.Dataset(
            data,
            coordinates,
            {**attributes, "differ": int(self.differ), "conclusive": int(self.conclusive), "level": self.level, "p": self.p},
        )
