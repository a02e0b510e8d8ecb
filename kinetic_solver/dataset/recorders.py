"""Recorders take frames as a run produces them: here into memory, in netcdf_recorder.py into a file.

When anything is due is the schedule's to say (kinetic_solver/scene/schedule.py): a recorder gives each group of `[output]` the
time dimension that the schedule names.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kinetic_solver.dataset.provenance import attributes
from kinetic_solver.dataset.schema import (
    FINISHED,
    ORIGIN,
    RUNNING,
    SCALE,
    STATUS_ATTRIBUTES,
    STOPPED,
    TIME_ATTRIBUTES,
    VARIABLES,
    Frame,
    Variables,
    bounds,
    coordinates,
    variables_on,
)
from kinetic_solver.dataset.units import conventions, name_units
from kinetic_solver.errors import OutputFailed, RunUnfinished, SolverStopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import Scene, Schedule
from kinetic_solver.scene.tables import Units

if TYPE_CHECKING:
    import xarray as xr


class Recorder(Protocol):
    """Takes frames as a run produces them."""

    def record(self, time: float, frame: Frame) -> None: ...

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        """The run is over: finished, with what it reports as attributes, or stopped for the reason given."""


@contextmanager
def recording(recorder: Recorder) -> Iterator[None]:
    """A run that fails or is interrupted closes its recorder with the reason; the run closes it where it comes to its end.

    A SolverStopped takes the frames that were kept in memory with it, as its `dataset`.
    """
    try:
        yield
    except BaseException as stop:
        said = isinstance(stop, (SolverStopped, RunUnfinished, OutputFailed))
        recorder.close(stopped=str(stop) if said else f"interrupted by {type(stop).__name__} {stop}".strip())
        if isinstance(stop, SolverStopped) and isinstance(recorder, MemoryRecorder):
            stop.dataset = recorder.dataset()
        raise


def numbers(name: str) -> dict[str, str]:
    """Attributes of a coordinate that counts."""
    return {"long_name": f"number of the {name}", "units": "1"}


class MemoryRecorder:
    """Keeps frames in memory and makes them a Dataset. `more` are coordinates beside time, x and v, `notes` attributes beside the
    common ones."""

    def __init__(
        self,
        grid: PhaseSpaceGrid,
        scene: Scene,
        schedule: Schedule,
        method: str = "grid",
        variables: Variables = VARIABLES,
        more: Mapping[str, np.ndarray] | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> None:
        self.grid, self.scene, self.method = grid, scene, method
        self._more, self._notes = more or {}, dict(notes or {})
        self._dimensions = schedule.dimensions(scene)
        self._variables = variables_on(grid, variables, self._dimensions)
        self._times: dict[str, list[float]] = {name: [] for name in self._dimensions.values()}
        self._values: dict[str, list[Any]] = {}
        self._status = RUNNING
        self._last: dict[str, str] = {}

    def record(self, time: float, frame: Frame) -> None:
        for group, values in frame.items():
            times = self._times[self._dimensions[group]]
            if not times or times[-1] != time:
                times.append(time)
            for name, value in values.items():
                kept = value if isinstance(value, float) else np.array(value, dtype=float)
                self._values.setdefault(name, []).append(kept)

    def close(self, stopped: str | None = None, report: Mapping[str, str] | None = None) -> None:
        self._status = STOPPED if stopped else FINISHED
        self._last = {"stopped": stopped} if stopped else dict(report or {})

    def dataset(self) -> xr.Dataset:
        data: dict[str, Any] = {}
        layout = []
        for group, dimension in self._dimensions.items():
            for name, (dims, units, long_name) in self._variables[group].items():
                if name in self._values:
                    data[name] = np.array(self._values[name])
                    layout.append((name, (dimension, *dims), units, long_name))
        for name, (_, values) in bounds(self.grid).items():
            data[name] = values
        data["status"] = np.int8(self._status)
        start = self.scene.initial.time
        found = [(name, values, numbers(name)) for name, values in self._more.items()]
        found += [(name, start + np.array(times), TIME_ATTRIBUTES) for name, times in self._times.items()]
        axes = tuple((name, values.dtype.str, values.tobytes(), tuple(attrs.items())) for name, values, attrs in found)
        dataset = _blank(self.grid, tuple(layout), axes, self.scene.units).copy(data=data)
        if scales := [name for name in data if name.startswith((SCALE, ORIGIN))]:
            dataset = dataset.set_coords(scales)
        dataset.attrs = attributes(self.scene, self.method) | self._notes | conventions(self.scene) | self._last
        return dataset


@functools.lru_cache(maxsize=8)
def _blank(
    grid: PhaseSpaceGrid,
    layout: tuple[tuple[str, tuple[str, ...], str, str], ...],
    axes: tuple[tuple[str, str, bytes, tuple[tuple[str, str], ...]], ...],
    units: Units | None,
) -> xr.Dataset:
    """A dataset without its numbers, for `copy(data=…)`: kept, since to put one together takes as long as a step or two, and many
    runs of one scene, or of one [grid], have the same.

    `layout`: name, dimensions, units and long name of each variable; `axes`: name, type, values and attributes of each coordinate
    beside those of the grid. The coordinates cannot be written to.
    """
    import xarray as xr

    coords: dict[str, Any] = {
        name: (name, np.frombuffer(values.tobytes()), attrs) for name, (_, values, attrs) in coordinates(grid).items()
    }
    coords |= {name: (name, np.frombuffer(buffer, dtype=kind), dict(attrs)) for name, kind, buffer, attrs in axes}
    sizes = {name: values.size for name, (_, values, _) in coords.items()}
    data: dict[str, Any] = {}
    for name, dims, unit, long_name in layout:
        shape = tuple(sizes[dim] for dim in dims)
        data[name] = (dims, np.broadcast_to(0.0, shape), {"long_name": long_name, "units": unit})
    for name, (dimension, values) in bounds(grid).items():
        data[name] = ((dimension, "bounds"), values)
    data["status"] = ((), np.int8(RUNNING), STATUS_ATTRIBUTES)
    dataset = xr.Dataset(data, coords)
    name_units(dataset, units)
    return dataset
