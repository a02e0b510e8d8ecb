"""A finished run as netCDF-4, compressed: for programs that read HDF5 alone. Room on disk it saves little: digits of a field that
is known to 10⁻⁶ are chance.

While a run goes on its file is a classic one, which others can read meanwhile (recorders.py).
Tests: tests/interface/test_formats.py.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from kinetic_solver.dataset import library
from kinetic_solver.dataset.checkpoint import sync_folder
from kinetic_solver.dataset.files import open_run
from kinetic_solver.dataset.lock import one_writer
from kinetic_solver.dataset.schema import FINISHED
from kinetic_solver.errors import OutputFailed, SceneError

LEVEL = 4
"""Of zlib, from 1 to 9. A run of scenes/pipe.toml takes 0.978, 0.975 and 0.974 of its size at 1, 4 and 9."""


def compress(path: str | Path) -> None:
    """Rewrite the file of a finished run as netCDF-4, every value as it was; one that is already is left alone.

    Frame by frame, under a temporary name: at every moment there is a whole file. Raises SceneError where it is no finished run
    or somebody writes it, OutputFailed where there is no room.
    """
    import netCDF4

    path = Path(path)
    with open_run(path) as run:
        if "status" in run and int(run["status"]) != FINISHED:
            raise SceneError(f"{path}: its run has not finished; allowed: to resume it first")
    part = path.with_name(path.name + ".part")
    with one_writer(path), library.calls(), netCDF4.Dataset(path) as old:
        if old.data_model == "NETCDF4":
            return
        try:
            with netCDF4.Dataset(part, "w", format="NETCDF4") as new:
                _copy(old, new)
            descriptor = os.open(part, os.O_RDONLY)
            os.fsync(descriptor)
            os.close(descriptor)
            part.replace(path)
            sync_folder(path.parent)
        except (OSError, RuntimeError) as error:
            raise OutputFailed(f"{path}: cannot be rewritten as netCDF-4 ({getattr(error, 'strerror', None) or error})") from None
        finally:
            part.unlink(missing_ok=True)


def _copy(old: Any, new: Any) -> None:
    old.set_auto_maskandscale(False)
    new.setncatts({name: old.getncattr(name) for name in old.ncattrs()})
    for name, dimension in old.dimensions.items():
        new.createDimension(name, None if dimension.isunlimited() else dimension.size)
    for name, variable in old.variables.items():
        attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
        large = variable.ndim > 1
        chunks = (1, *variable.shape[1:]) if large else None  # frames are read one by one
        made = new.createVariable(
            name,
            variable.dtype,
            variable.dimensions,
            zlib=large,
            complevel=LEVEL,
            shuffle=True,
            chunksizes=chunks,
            fill_value=attributes.pop("_FillValue", None),
        )
        made.set_auto_maskandscale(False)
        made.setncatts(attributes)
        if not large:
            made[...] = variable[...]
            continue
        for n in range(variable.shape[0]):
            made[n] = np.asarray(variable[n])
