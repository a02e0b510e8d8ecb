"""What this machine can hold."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

SHARE = 0.9
"""Of the physical memory, to one run: the rest is the system's."""


def physical_memory() -> int:
    """Bytes."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def too_large(needed: float) -> str | None:
    """ "need 40 GiB, this machine has 24 GiB" where a run needs more bytes than there are for it; None where it fits."""
    there = physical_memory()
    return f"need {needed / 2**30:.3g} GiB, this machine has {there / 2**30:.3g} GiB" if needed > SHARE * there else None


def keep_compiled_code() -> None:
    """To be called before numba is imported: it keeps what it compiles beside the source or in the user's cache, and fails where
    it can write to neither. There it is given a folder that lasts as long as the process, with a warning."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if "NUMBA_CACHE_DIR" in os.environ or any(_writable(path) for path in (Path(__file__).parent, home / "numba")):
        return
    import atexit
    import shutil
    import tempfile

    folder = tempfile.mkdtemp(prefix="kinetic-solver-")
    os.environ["NUMBA_CACHE_DIR"] = folder
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(
        "compiled code cannot be kept: neither the package's folder nor the user's cache can be written to, so every start "
        "compiles again; set NUMBA_CACHE_DIR to a folder that can",
        stacklevel=2,
    )


def _writable(folder: Path) -> bool:
    """Whether the folder, or the first above it that there is, may be written to."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK)
