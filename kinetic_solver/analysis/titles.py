"""A scene, or the run of it, in one line: above a picture, and in `info`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.analysis.frames import times_of
from kinetic_solver.dataset import STOPPED, scene_of, velocity_axis
from kinetic_solver.scene import INELASTIC, Scene

if TYPE_CHECKING:
    import xarray as xr


def in_words(scene: Scene) -> str:
    """Its collisions and their numbers, then g, γ and σ."""
    if scene.collisions is None:
        kind = "no collisions"
    elif scene.operator is None and scene.collisions.cross_section > 0:
        kind = "elastic collisions"
    else:
        kind = f"{scene.collisions.operator} collisions"
        number, rate = scene.groups.collision_number, scene.cross_section * scene.initial.density
        kind += f", R* = {number:.3g}" if np.isfinite(number) else f", Sρ = {rate:.3g}"
        if scene.operator == INELASTIC:
            kind += f", ε = {scene.restitution:g}"
    return f"{kind}     g = {scene.model.gravity:g}, γ = {scene.model.friction:g}, σ = {scene.model.noise:g}"


def method_in_words(dataset: xr.Dataset) -> str:
    """How a run was made: its points and rtol, or its particles and how well their fields are known."""
    attrs: dict[str, Any] = dataset.attrs
    method = str(attrs.get("method", "unknown"))
    if method.startswith("particles"):
        return _of_particles(dataset, method)
    # t = 0: 25 × 112 on [-5, 5]; t = 4.7: 25 × 168 on [-5, 5]
    used = [grid.partition(": ")[2].partition(" on ") for grid in str(attrs.get("grids", "")).split("; ")]
    points, _, window = used[0]
    if used[-1] != used[0]:
        points, window = f"{points} points, at last {used[-1][0]}", used[-1][2]
    said = f"method {method}"
    if method == "grid":
        said += f", rtol = {scene_of(dataset).accuracy.rtol:g}"
    if method == "hydrodynamics":
        points = str(attrs.get("points", dataset.sizes["x"]))
    if window:
        kind = "velocities" if velocity_axis(dataset) == "v" else "scaled velocities"
        said += f": solved on {points} points, {kind} {window}; axes of v end where f is 0.2 % of its maximum"
    elif points:
        said += f": {points} points"
    return said


def stopped_in_words(dataset: xr.Dataset) -> str:
    """When a run stopped that was to go on, and why; empty for all others."""
    if "status" not in dataset or int(dataset["status"]) != STOPPED:
        return ""
    end, reason = scene_of(dataset).run.end_time, str(dataset.attrs.get("stopped", ""))
    if reason.startswith(("t = ", "between t = ")):  # as SolverStopped says it
        when, _, what = reason.partition(": ")
        return f"stopped {'at ' if when.startswith('t') else ''}{when} of {end:g}: {what}"
    when = f"stopped at t = {times_of(dataset, 'density')[-1]:.4g} of {end:g}"
    return f"{when}; {reason}" if reason else when


def _of_particles(dataset: xr.Dataset, method: str) -> str:
    """With the standard errors at the last frame, since bands narrower than a line are not seen."""
    replicas = dataset.sizes.get("replica", 1)
    said = f"{method}: {scene_of(dataset).particles.count} × {replicas}"
    errors = []
    for name, symbol in (("density", "ρ"), ("velocity_distribution", "w(v)")):
        if f"{name}_stderr" in dataset:
            values, error = (np.asarray(dataset[n].isel({dataset[n].dims[0]: -1})) for n in (name, f"{name}_stderr"))
            largest = float(np.nanmax(error, initial=0.0) / values.max())
            if largest > 0:
                errors.append(f"{100 * largest:.2g} % of max {symbol}")
    if not errors:
        return f"{said}: no standard errors of one replica" if replicas == 1 else said
    return f"{said}; bands: one standard error, at most {' and '.join(errors)}"
