"""A run's file in a few lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

_STATUS = {0: "running, or killed", 1: "finished", 2: "stopped"}


def summary(dataset: xr.Dataset) -> list[str]:
    """Method, frames, status, invariants, budgets."""
    a = dataset.attrs
    lines = [f"{a.get('method', '?')} run by {a.get('source', '?')}, {a.get('created', 'no date')}"]
    if "status" in dataset:
        reason = f": {a['stopped']}" if "stopped" in a else ""
        lines.append(f"status      {_STATUS[int(dataset['status'])]}{reason}")
    if "time" in dataset.coords and dataset.sizes["time"]:
        t = dataset["time"].values
        lines.append(f"frames      {t.size}, t = {t[0]:g} to {t[-1]:g}")
    if "x" in dataset.coords and "v" in dataset.coords:
        v = dataset["v"].values
        if v.size > 1:
            lines.append(f"grid        nx = {dataset.sizes['x']}, nv = {v.size}")
            lines.append(f"velocities  {v[0]:.5g} to {v[-1]:.5g}")
        else:
            lines.append(f"grid        nx = {dataset.sizes['x']}")
    else:
        lines.append(f"variables   {', '.join(map(str, dataset.data_vars))}")

    def last(name: str) -> float:
        values = np.asarray(dataset[name].values, dtype=float)
        return float(values[np.isfinite(values)][-1])

    for name in ("mass", "momentum", "energy"):
        if name in dataset:
            first = float(dataset[name].values[0])
            line = f"{name:<12}{first:.10g} → {last(name):.10g}"
            if f"{name}_residual" in dataset:
                line += f", budget residual {last(f'{name}_residual'):.2g}"
            lines.append(line)
    for name in (
        "minimum_of_f",
        "edge_error_low",
        "edge_error_high",
        "velocity_curvature",
        "spectral_tail",
        "density_defect",
        "error_estimate",
    ):
        if name in dataset:
            worst = dataset[name].min() if name == "minimum_of_f" else dataset[name].max()
            lines.append(f"{name:<20}{float(worst):.2g}   {dataset[name].attrs['long_name']}")
    for name in (
        "limited_by",
        "flow",
        "error_maximum_norm",
        "error_L1",
        "jumps_from",
        "grids",
        "missing",
        "certified",
        "cells",
        "overtakings",
        "weight",
        "warning",
        "first",
        "second",
        "verdict",
    ):
        if name in a:
            value = f"{a[name]:.2g}" if isinstance(a[name], float) else a[name]
            lines.append(f"{name:<12} {value}" if len(name) > 11 else f"{name:<12}{value}")
    lines.append(f"scene       {a.get('scene', 'none')}")
    return lines
