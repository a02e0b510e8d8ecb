"""What the log of random_kinds.py says, as the tables of docs/accuracy.md: errors, estimates, times and refusals."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.random_kinds_scenes import FURTHER, KINDS, OPERATORS
from benchmarks.random_scenes import FIELDS
from kinetic_solver.scene import INELASTIC

Line = dict[str, Any]
FACTOR = 3.0
"""Of the time that `describe` foretells."""
LEAST = 0.02
"""That the error of f over its estimate should be; it should be no more than 1, but for what rounding and the reference do."""
ROUNDING = 1e-11
"""Errors of f over max f that rounding makes, where (6) amplifies it: no estimate knows of them."""
OF_THE_REFERENCE = 0.01
"""Of rtol, by which the Fourier series of (12) may be off."""
PERCENT = (5, 50, 95)


def in_silence(lines: Sequence[Line]) -> list[Line]:
    """Those whose error exceeds rtol, while neither a warning nor the estimate says so."""
    return [line for line in lines if "errors" in line and max(line["errors"].values()) > 1 and not line["said"]]


def underrated(lines: Sequence[Line]) -> list[Line]:
    """Those whose error of f exceeds its estimate by more than rounding, and by more than the reference may be off."""
    return [
        line
        for line in lines
        if "errors" in line
        and line["errors"]["f"] * line["rtol"] > ROUNDING
        and line["errors"]["f"] - line["estimate"] > (OF_THE_REFERENCE if line["operator"] == INELASTIC else 0.0)
    ]


def ratio(line: Line) -> float:
    """The error of f over its estimate."""
    return float(line["errors"]["f"] / max(line["estimate"], 1e-300))


def tables(lines: Sequence[Line]) -> dict[str, list[list[str]]]:
    """By the name of a file each, the first row a heading."""
    return {
        "errors": _by_operator(
            lines, ["runs compared", "f, most", "ρ, most", "u, most", "θ, most", "largest of them, median"], _errors
        ),
        "estimates": _by_operator(
            lines, ["runs compared", *(f"{n} %" for n in PERCENT), "from 0.02 to 1", "above 1", "below 0.02"], _estimates
        ),
        "times": _by_operator(
            lines,
            ["scenes", "refused", "foretold over a minute, not run", "no reference", "s, median", "s, most"]
            + [f"foretold/taken, {n} %" for n in PERCENT]
            + ["within a factor of three"],
            _times,
        ),
        "kinds": [
            ["kind", "runs compared", "error/rtol, most", "median", "error/estimate of f, 5 to 95 %", "s, most"],
            *([kind, *_kind(some)] for kind in (*KINDS, *FURTHER) if (some := [line for line in lines if line["kind"] == kind])),
        ],
    }


def written(found: dict[str, list[list[str]]], folder: Path, prefix: str = "random_kinds") -> None:
    for name, rows in found.items():
        with (folder / f"{prefix}_{name}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


def _by_operator(lines: Sequence[Line], head: list[str], row: Callable[[Sequence[Line]], list[str]]) -> list[list[str]]:
    rows = [["operator", "rtol", *head]]
    for operator in (name or "none" for name in OPERATORS):
        for rtol in sorted({line["rtol"] for line in lines}, reverse=True):
            if some := [line for line in lines if line["operator"] == operator and line["rtol"] == rtol]:
                rows.append([operator, f"{rtol:g}", *row(some)])
    return rows


def _known(lines: Sequence[Line]) -> list[Line]:
    return [line for line in lines if "errors" in line]


def _errors(lines: Sequence[Line]) -> list[str]:
    known = _known(lines)
    largest = [max(line["errors"].values()) for line in known]
    return [str(len(known)), *(_two(max(line["errors"][name] for line in known)) for name in FIELDS), _two(np.median(largest))]


def _estimates(lines: Sequence[Line]) -> list[str]:
    known = _known(lines)
    found = np.array([ratio(line) for line in known])
    above, below = len(underrated(known)), int((found < LEAST).sum())
    share = 1 - (above + below) / found.size
    return [str(found.size), *(_two(x) for x in np.percentile(found, PERCENT)), f"{share:.0%}", str(above), str(below)]


def _times(lines: Sequence[Line]) -> list[str]:
    counts = [str(sum(word in line for line in lines)) for word in ("refused", "too_long", "no_reference")]
    took = [line for line in lines if "seconds" in line and "refused" not in line]
    seconds = np.array([line["seconds"] for line in took])
    foretold = np.array([line["foretold"] for line in took]) / seconds
    share = float(np.mean((foretold > 1 / FACTOR) & (foretold < FACTOR)))
    quantiles = [_two(x) for x in np.percentile(foretold, PERCENT)]
    return [str(len(lines)), *counts, _two(np.median(seconds)), _two(seconds.max()), *quantiles, f"{share:.0%}"]


def _kind(lines: Sequence[Line]) -> list[str]:
    known = _known(lines)
    if not known:
        return ["0", "–", "–", "–", "–"]
    largest = np.array([max(line["errors"].values()) for line in known])
    low, high = np.percentile([ratio(line) for line in known], (5, 95))
    seconds = max(line["seconds"] for line in lines if "seconds" in line)
    return [str(len(known)), _two(largest.max()), _two(np.median(largest)), f"{_two(low)} to {_two(high)}", _two(seconds)]


def _two(value: Any) -> str:
    return f"{float(value):.2g}"
