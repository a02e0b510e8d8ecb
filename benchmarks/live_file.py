"""Can another process open a netCDF file while it is being written? HDF5 against classic 64-bit data, six tries each.

The reader is a plain `xarray.open_dataset`, in a process of its own, between two frames of the writer.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import netCDF4
import numpy as np

READ = "import sys, xarray; sys.exit(int(xarray.open_dataset(sys.argv[1])['f'].sizes['time']) != int(sys.argv[2]))"
TRIES = 6


def opened(form: str) -> int:
    """How many of the tries read all frames written so far."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "live.nc"
        file = netCDF4.Dataset(path, "w", format=form)
        file.createDimension("time", None)
        file.createDimension("x", 64)
        f = file.createVariable("f", "f8", ("time", "x"))
        good = 0
        for n in range(TRIES):
            f[n] = np.arange(64.0)
            file.sync()
            good += subprocess.run([sys.executable, "-c", READ, str(path), str(n + 1)], capture_output=True).returncode == 0
        file.close()
    return good


def main() -> int:
    counts = {form: opened(form) for form in ("NETCDF4", "NETCDF3_64BIT_DATA")}
    for form, count in counts.items():
        print(f"{form:<20} opened and complete in {count} of {TRIES} tries while being written")
    return int(counts["NETCDF3_64BIT_DATA"] != TRIES)


if __name__ == "__main__":
    sys.exit(main())
