"""The one schema of every method's dataset, what records it, and files of it: the only place that writes netCDF."""

from kinetic_solver.dataset.files import (
    append,
    law_of_run,
    open_netcdf,
    open_run,
    refuse_existing,
    refuse_law,
    scene_of,
    write_dataset,
)
from kinetic_solver.dataset.provenance import attributes, law_attribute
from kinetic_solver.dataset.recorders import MemoryRecorder, NetCDFRecorder, Recorder, recording
from kinetic_solver.dataset.schema import FINISHED, RUNNING, STOPPED, VARIABLES, Frame, Variables

__all__ = [
    "FINISHED",
    "RUNNING",
    "STOPPED",
    "VARIABLES",
    "Frame",
    "MemoryRecorder",
    "NetCDFRecorder",
    "Recorder",
    "Variables",
    "append",
    "attributes",
    "law_attribute",
    "law_of_run",
    "open_netcdf",
    "open_run",
    "recording",
    "refuse_existing",
    "refuse_law",
    "scene_of",
    "write_dataset",
]
