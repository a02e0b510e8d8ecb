"""A run's file in a few lines."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.analysis.frames import refuse_sweep
from kinetic_solver.analysis.titles import in_words, stopped_in_words
from kinetic_solver.dataset import scene_of, velocity_axis

if TYPE_CHECKING:
    import xarray as xr

_STATUS = {0: "running, or killed", 1: "finished", 2: "stopped"}
DIAGNOSTICS = (
    "minimum_of_f",
    "edge_error_low",
    "edge_error_high",
    "velocity_curvature",
    "spectral_tail",
    "density_defect",
    "error_estimate",
)
SAID = (
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
)
"""Attributes in which a method says something of its run."""


def summary(dataset: xr.Dataset) -> list[str]:
    """Method, frames, status, invariants, budgets."""
    refuse_sweep(dataset)
    a = dataset.attrs
    lines = [f"{a.get('method', '?')} run by {a.get('source', '?')}, {a.get('created', 'no date')}"]
    if "status" in dataset:
        lines.append(f"status      {(stopped_in_words(dataset) if 'stopped' in a else '') or _STATUS[int(dataset['status'])]}")
    if "time" in dataset.coords and dataset.sizes["time"]:
        t = dataset["time"].values
        lines.append(f"frames      {t.size}, t = {t[0]:g} to {t[-1]:g}")
    over = velocity_axis(dataset)
    if "x" in dataset.coords and over in dataset.coords:
        v = dataset[over].values
        if v.size > 1:
            lines.append(f"grid        nx = {dataset.sizes['x']}, nv = {v.size}")
            scaled = ", in scaled velocities" if over != "v" else ""
            lines.append(f"velocities  {v[0]:.5g} to {v[-1]:.5g}{scaled}")
        else:
            lines.append(f"grid        nx = {dataset.sizes['x']}")
    else:
        lines.append(f"variables   {', '.join(map(str, dataset.data_vars))}")
    for name in ("mass", "momentum", "energy"):
        if name in dataset:
            first = float(dataset[name].values[0])
            line = f"{name:<12}{first:.10g} → {_last(dataset, name):.10g}"
            if f"{name}_residual" in dataset:
                line += f", budget residual {_last(dataset, f'{name}_residual'):.2g}"
            lines.append(line)
    for name in DIAGNOSTICS:
        if name in dataset:
            worst = dataset[name].min() if name == "minimum_of_f" else dataset[name].max()
            lines.append(f"{name:<20}{float(worst):.2g}   {dataset[name].attrs['long_name']}")
    for name in SAID:
        if name in a:
            value = f"{a[name]:.2g}" if isinstance(a[name], float) else a[name]
            lines.append(f"{name:<12} {value}" if len(name) > 11 else f"{name:<12}{value}")
    if "scene" in a:
        scene = scene_of(dataset)
        lines.append(f"scene       {in_words(scene)}, L = {scene.pipe.length:g}, until t = {scene.run.end_time:g}")
    return lines


def _last(dataset: xr.Dataset, name: str) -> float:
    values = np.asarray(dataset[name].values, dtype=float)
    return float(values[np.isfinite(values)][-1])


def facts(dataset: xr.Dataset) -> dict[str, Any]:
    """What `summary` says as plain values, for other programs; the scene as its tables."""
    found: dict[str, Any] = {name: dataset.attrs.get(name) for name in ("method", "version", "created", "command")}
    if "status" in dataset:
        found["status"] = _STATUS[int(dataset["status"])]
        found["stopped"] = dataset.attrs.get("stopped")
    found["sizes"] = {str(name): size for name, size in dataset.sizes.items()}
    found["variables"] = [str(name) for name in dataset.data_vars]
    for axis in ("time", "x", velocity_axis(dataset)):
        if axis in dataset.coords and dataset.sizes[axis]:
            found[axis] = [float(dataset[axis][0]), float(dataset[axis][-1])]
    for name in ("mass", "momentum", "energy"):
        if name in dataset:
            found[name] = [float(dataset[name][0]), _last(dataset, name)]
            if f"{name}_residual" in dataset:
                found[f"{name}_residual"] = _last(dataset, f"{name}_residual")
    for name in DIAGNOSTICS:
        if name in dataset:
            found[name] = float(dataset[name].min() if name == "minimum_of_f" else dataset[name].max())
    found |= {name: dataset.attrs[name] for name in SAID if name in dataset.attrs}
    found["scene"] = json.loads(dataset.attrs["scene"])
    return found
