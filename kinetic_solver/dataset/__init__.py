"""The one schema of every method's dataset, what records it, and files of it: the only place that writes netCDF."""

from kinetic_solver.dataset.checkpoint import Checkpoint, finished
from kinetic_solver.dataset.compressed import compress
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
from kinetic_solver.dataset.lock import one_writer
from kinetic_solver.dataset.netcdf_recorder import NetCDFRecorder
from kinetic_solver.dataset.provenance import attributes, law_attribute, version
from kinetic_solver.dataset.recorders import MemoryRecorder, Recorder, recording
from kinetic_solver.dataset.scaled import in_velocities, on_scales_of, scales_of, velocity_axis
from kinetic_solver.dataset.schema import FINISHED, RUNNING, STOPPED, VARIABLES, Frame, Variables

__all__ = [
    "FINISHED",
    "RUNNING",
    "STOPPED",
    "VARIABLES",
    "Checkpoint",
    "Frame",
    "MemoryRecorder",
    "NetCDFRecorder",
    "Recorder",
    "Variables",
    "append",
    "attributes",
    "compress",
    "finished",
    "in_velocities",
    "law_attribute",
    "law_of_run",
    "on_scales_of",
    "one_writer",
    "open_netcdf",
    "open_run",
    "recording",
    "refuse_existing",
    "refuse_law",
    "scales_of",
    "scene_of",
    "velocity_axis",
    "version",
    "write_dataset",
]
