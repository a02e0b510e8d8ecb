"""Tables of particles in CSV: a line with the columns' names, then a line for each particle.

Read are the columns `position` and `velocity`, or `x` and `v`; where there are a `replica`, a whole number, and a `time`, the
same for all, these as well. Columns of other names are passed over. Between the columns stand commas, semicolons or tabs.
Tests: tests/cross_validation/particles/test_tables.py.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError

if TYPE_CHECKING:
    import xarray as xr

PAIRS = (("position", "velocity"), ("x", "v"))


def read_table(path: str | Path, source: str | None = None) -> xr.Dataset:
    """position, velocity (particle) or (replica, particle), and the time, where there is one, as a scalar coordinate.

    Raises SceneError, which begins with `source` (the path), for what is no such table.
    """
    import xarray as xr

    where = source or str(path)
    columns = _columns(_text(path, where), where)
    names = next(pair for pair in PAIRS if set(pair) <= columns.keys())
    x, v = (columns[name] for name in names)
    order = np.arange(x.size)
    shape: tuple[int, ...] = x.shape
    if (replicas := columns.get("replica")) is not None:
        found, counts = np.unique(replicas, return_counts=True)
        if (counts != counts[0]).any():
            raise SceneError(
                f"{where}: its replicas have {counts.min()} to {counts.max()} particles; allowed: the same number each"
            )
        order, shape = np.argsort(replicas, kind="stable"), (found.size, int(counts[0]))
    dims = ("replica", "particle")[-len(shape) :]
    data = {"position": (dims, x[order].reshape(shape)), "velocity": (dims, v[order].reshape(shape))}
    if (times := columns.get("time")) is None:
        return xr.Dataset(data)
    if (times != times[0]).any():
        raise SceneError(f"{where}: its times go from {times.min():g} to {times.max():g}; allowed: one time in a table")
    return xr.Dataset(data, {"time": float(times[0])})


def _text(path: str | Path, where: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SceneError(f"{where}: there is no such file") from None
    except UnicodeDecodeError:
        raise SceneError(f"{where}: is not a text file in UTF-8; allowed: a table in CSV") from None
    except OSError as error:
        raise SceneError(f"{where}: cannot be read ({error.strerror})") from None


def _columns(text: str, where: str) -> dict[str, Array]:
    """The columns that are read, of one length, one or more particles."""
    head, _, body = text.partition("\n")
    between = max(",;\t", key=head.count)
    names = [name.strip().strip('"').lower() for name in head.lstrip("#").split(between)]
    if not any(set(pair) <= set(names) for pair in PAIRS):
        shown = head.strip()[:60]
        raise SceneError(f"{where}: its first line, {shown!r}, names no columns x and v; allowed: x,v or position,velocity first")
    if not body.strip():
        raise SceneError(f"{where}: has no particles; allowed: a line for each")
    read = [name for name in ("position", "velocity", "x", "v", "replica", "time") if name in names]
    try:
        numbers = np.loadtxt(
            io.StringIO(body), delimiter=between, usecols=[names.index(name) for name in read], ndmin=2, quotechar='"'
        )
    except ValueError as error:
        raise SceneError(
            f"{where}: is no table of numbers ({' '.join(str(error).split())}; its first line is not counted)"
        ) from None
    return dict(zip(read, numbers.T, strict=True))
