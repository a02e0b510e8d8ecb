"""One thread at a time in netCDF's C library, which is not made for several: two runs in threads of one process would mix up
their files, or crash.

xarray knows this, too, and holds a lock of its own around each of its calls. Calls of netCDF4 itself hold both locks; calls of
xarray hold the first one as well where they open and write files.
Test: tests/faults/test_threads.py.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from threading import Lock

OPENING = Lock()
"""For calls of xarray that open and write files. It is taken first, since `calls` takes it before it looks for xarray's lock:
xarray is not loaded for a run that does not need it, and another thread may be about to."""


@contextmanager
def calls() -> Iterator[None]:
    """For calls of netCDF4, which must not be nested: as a context, or as the decorator of what makes them."""
    with OPENING:
        xarrays = getattr(sys.modules.get("xarray.backends.netCDF4_"), "NETCDF4_PYTHON_LOCK", None)
        with xarrays or nullcontext():
            yield
