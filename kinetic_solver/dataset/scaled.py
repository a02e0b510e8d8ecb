"""Runs that are written over scaled velocities w = (v - u_ref(t))/s(t), for whoever wants v: f(x, v, t) = F(x, w, t)/s.

A gas that cools keeps its shape over w, while over v it becomes ever narrower. Tests: tests/interface/test_scaled_velocities.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset.schema import ORIGIN, SCALE, SCALED, VARIABLES, V, coordinates
from kinetic_solver.grid import PhaseSpaceGrid

if TYPE_CHECKING:
    import xarray as xr

DENSITIES = ("f", "velocity_distribution")
"""What is a density in velocity."""


def velocity_axis(data: xr.Dataset | xr.DataArray) -> str:
    """The name of the dimension along velocity: `v`, or `scaled_velocity`."""
    return SCALED if SCALED in data.dims else V


def scales_of(field: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray]:
    """(s, u_ref) of a field over scaled velocities, over its time dimension if it has one."""
    ending = next(str(name).removeprefix(SCALE) for name in field.coords if str(name).startswith(SCALE))
    return field.coords[SCALE + ending], field.coords[ORIGIN + ending]


def in_velocities(ds: xr.Dataset, v: Array) -> xr.Dataset:
    """The dataset over fixed velocities v instead of scaled ones: 0 outside the window of each time. Others stay as they are.

    By the trigonometric interpolant, as accurate as f is resolved and has ended at the window's edges.
    """
    if SCALED not in ds.dims:
        return ds

    def place(frame: xr.DataArray) -> tuple[Array, float]:
        s, u = (float(value) for value in scales_of(frame))
        return (v - u) / s, 1 / s

    found = _mapped(ds, place, V, v)
    for group, name in (("f", "f"), ("moments", "velocity_distribution")):
        if name not in found:
            continue
        _, units, long_name = VARIABLES[group][name]
        found[name].attrs |= {"units": units, "long_name": long_name}
    _, _, attrs = coordinates(PhaseSpaceGrid(1, 2, 1.0, 0.0, 1.0))[V]
    found[V].attrs = {name: value for name, value in attrs.items() if name != "bounds"}
    return found.drop_vars([name for name in found.coords if str(name).startswith((SCALE, ORIGIN))])


def on_scales_of(ds: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """The dataset, itself over scaled velocities, over those of another one at the frames nearest to its own."""
    w = np.asarray(other[SCALED].values, dtype=float)

    def place(frame: xr.DataArray) -> tuple[Array, float]:
        like = other[str(frame.name)]
        near = like.isel({like.dims[0]: int(np.abs(like[like.dims[0]].values - float(frame[like.dims[0]])).argmin())})
        (s, u), (there, origin) = scales_of(frame), scales_of(near)
        return (float(origin) + float(there) * w - float(u)) / float(s), float(there) / float(s)

    return _mapped(ds, place, SCALED, w)


def _mapped(ds: xr.Dataset, place: Any, name: str, points: Array) -> xr.Dataset:
    """Every field along the scaled velocities at what `place` says for each of its frames: (places in w, factor)."""
    import xarray as xr

    own = np.asarray(ds[SCALED].values, dtype=float)
    fields = {}
    for key, field in ds.data_vars.items():
        if key not in DENSITIES:
            continue
        time = str(field.dims[0])
        values = []
        for n in range(field.sizes[time]):
            frame = field.isel({time: n})
            at, factor = place(frame)  # NaN in the frames that a stopped run did not come to
            values.append(factor * _between(own, np.asarray(frame.transpose(..., SCALED).values, dtype=float), at))
        dims = [str(dim) for dim in field.dims if dim != SCALED]
        fields[key] = xr.DataArray(np.stack(values), dims=[*dims, name], attrs=dict(field.attrs))
    rest = ds.drop_dims(SCALED)
    found = rest.assign(fields).assign_coords({name: (name, points, dict(ds[SCALED].attrs))})
    return found[[key for key in ds.data_vars if key in found]]


def _between(own: Array, values: Array, places: Array) -> Array:
    """Values (…, len(own)) at other places: the trigonometric interpolant, its period that of the points' cells; 0 outside."""
    n, half = own.size, (own[1] - own[0]) / 2
    inside = (places > own[0] - half) & (places < own[-1] + half)
    waves = np.arange(n // 2 + 1)
    weight = np.full(waves.size, 2.0 / n)
    weight[0] = 1 / n
    if n % 2 == 0:
        weight[-1] = 1 / n
    angle = np.pi / (n * half) * waves
    there, here = np.exp(1j * np.outer(places[inside], angle)), np.exp(-1j * np.outer(angle, own))
    result = np.zeros((*values.shape[:-1], places.size))
    result[..., inside] = values @ ((there * weight) @ here).real.T
    return result
