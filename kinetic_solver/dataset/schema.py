"""The schema that every method's dataset has: variables with dimensions, units and names, coordinates, status."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kinetic_solver.grid import PhaseSpaceGrid

RUNNING, FINISHED, STOPPED = 0, 1, 2

Frame = Mapping[str, Mapping[str, Any]]
"""What one time brings: group of `[output]` → variable → value."""

Variables = Mapping[str, Mapping[str, tuple[tuple[str, ...], str, str]]]
"""Group of `[output]` → name → (dimensions beside time, units, long name)."""

VARIABLES: Variables = {
    "f": {"f": (("x", "v"), "particles time length-2", "distribution function, point values")},
    "moments": {
        "density": (("x",), "particles length-1", "density ρ"),
        "mean_velocity": (("x",), "length time-1", "mean velocity u"),
        "temperature": (("x",), "length2 time-2", "granular temperature θ, the velocity variance"),
        "heat_flux": (("x",), "particles length2 time-3", "heat flux, third central velocity moment of f"),
        "velocity_distribution": (("v",), "particles time length-1", "velocity distribution w(v), f integrated over x"),
    },
    "scalars": {
        "mass": ((), "particles", "number of particles"),
        "momentum": ((), "particles length time-1", "total momentum"),
        "energy": ((), "particles length2 time-2", "total kinetic energy"),
        "minimum_of_f": ((), "1", "minimum of f over its maximum"),
        "edge_error_low": ((), "1", "f at the window's lower edge, amplified as follow-the-leader collisions do, over max f"),
        "edge_error_high": ((), "1", "f at the window's upper edge over max f"),
        "velocity_curvature": ((), "1", "largest second difference of f in v over max f; 0.5 is unresolved"),
        "spectral_tail": ((), "1", "largest amplitude in the highest eighth of wavenumbers over the largest of all"),
        "density_defect": ((), "1", "what a linearised follow-the-leader step misses of the density, over its maximum"),
        "error_estimate": ((), "1", "estimated error of f over max f: the sum of its parts below"),
        "error_time": ((), "1", "of it, from the steps in time"),
        "error_x": ((), "1", "of it, from the waves in x that the grid cannot hold"),
        "error_v": ((), "1", "of it, from the spacing in v"),
        "error_window": ((), "1", "of it, from the edges of the velocity window"),
        "error_rounding": ((), "1", "of it, from rounding that follow-the-leader collisions amplify"),
    },
    "budgets": {
        **{f"momentum_rate_{t}": ((), "particles length time-2", f"rate of momentum by {t}")
           for t in ("gravity", "friction", "collisions")},
        **{f"energy_rate_{t}": ((), "particles length2 time-3", f"rate of energy by {t}")
           for t in ("gravity", "friction", "noise", "collisions")},
        **{f"momentum_from_{t}": ((), "particles length time-1", f"momentum brought by {t} since time 0")
           for t in ("gravity", "friction", "collisions")},
        **{f"energy_from_{t}": ((), "particles length2 time-2", f"energy brought by {t} since time 0")
           for t in ("gravity", "friction", "noise", "collisions")},
        "mass_residual": ((), "particles", "mass minus its initial value"),
        "momentum_residual": ((), "particles length time-1", "momentum minus initial minus what the terms brought"),
        "energy_residual": ((), "particles length2 time-2", "energy minus initial minus what the terms brought"),
    },
    "moment_equations": {
        **{f"density_rate{t}": (("x",), "particles length-1 time-1", f"(3): rate of the density{t.replace('_', ' ')}")
           for t in ("", "_advection", "_compression", "_residual")},
        **{f"mean_velocity_rate{t}": (("x",), "length time-2", f"(4): rate of the mean velocity{t.replace('_', ' ')}")
           for t in ("", "_advection", "_pressure", "_gravity", "_friction", "_collisions", "_residual")},
        **{f"temperature_rate{t}": (("x",), "length2 time-3", f"(5): rate of the temperature{t.replace('_', ' ')}")
           for t in ("", "_advection", "_compression", "_heat_flux", "_friction", "_noise", "_collisions", "_residual")},
    },
}  # fmt: skip

_OF_SCALED = {
    "f": ("particles length-1", "distribution function over scaled velocities, f(x, v) velocity_scale, point values"),
    "velocity_distribution": ("particles", "velocity distribution over scaled velocities, w(v) velocity_scale"),
}


def variables_on(grid: PhaseSpaceGrid, variables: Variables, dimensions: Mapping[str, str]) -> Variables:
    """Those of a run that is written over this grid: over scaled velocities with their scale and origin, for every time dimension
    (group → name) once."""
    if not grid.scaled:
        return variables
    found = {group: dict(there) for group, there in variables.items()}
    having: set[str] = set()
    for group, dimension in dimensions.items():
        there = found[group]
        for name in _OF_SCALED.keys() & there.keys():
            dims = tuple(SCALED if dim == V else dim for dim in there[name][0])
            there[name] = (dims, *_OF_SCALED[name])
            if dimension not in having:
                having.add(dimension)
                scale, origin = scale_names(dimension)
                there[scale] = ((), "length time-1", "scale s of the scaled velocities")
                there[origin] = ((), "length time-1", "origin u_ref of the scaled velocities")
    return found


def scale_names(dimension: str) -> tuple[str, str]:
    """(of s, of u_ref) over this time dimension."""
    ending = dimension.removeprefix("time")
    return SCALE + ending, ORIGIN + ending


STATUS_ATTRIBUTES = {
    "long_name": "state of the run",
    "flag_values": np.array([RUNNING, FINISHED, STOPPED], dtype="i1"),
    "flag_meanings": "running finished stopped",
}


TIME_ATTRIBUTES = {"long_name": "time", "units": "time"}
"""Without axis = "T": CF keeps that for times since a date, and this is the time since a start."""


V, SCALED = "v", "scaled_velocity"
"""The two axes of velocity: v itself, and w = (v - u_ref(t))/s(t) of a run that cools (scaled.py)."""
SCALE, ORIGIN = "velocity_scale", "velocity_origin"
"""s and u_ref; with a time dimension of another name than `time` its ending is theirs as well."""


def coordinates(grid: PhaseSpaceGrid) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
    x = {"long_name": "position", "units": "length", "axis": "X", "bounds": "x_bounds"}
    if grid.scaled:
        name, attrs = SCALED, {"long_name": "scaled velocity (v - velocity_origin)/velocity_scale", "units": "1"}
    else:
        name, attrs = V, {"long_name": "velocity", "units": "length time-1"}
    return {"x": ("x", grid.x, x), name: (name, grid.v, {**attrs, "bounds": f"{name}_bounds"})}


def bounds(grid: PhaseSpaceGrid) -> dict[str, tuple[str, np.ndarray]]:
    half, velocity = grid.dx / 2, SCALED if grid.scaled else V
    return {
        "x_bounds": ("x", np.stack([grid.x - half, grid.x + half], axis=1)),
        f"{velocity}_bounds": (velocity, np.stack([grid.faces[:-1], grid.faces[1:]], axis=1)),
    }
