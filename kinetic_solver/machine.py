"""What this machine can hold."""

from __future__ import annotations

import os

SHARE = 0.9
"""Of the physical memory, to one run: the rest is the system's."""


def physical_memory() -> int:
    """Bytes."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def too_large(needed: float) -> str | None:
    """ "need 40 GiB, this machine has 24 GiB" where a run needs more bytes than there are for it; None where it fits."""
    there = physical_memory()
    return f"need {needed / 2**30:.3g} GiB, this machine has {there / 2**30:.3g} GiB" if needed > SHARE * there else None
