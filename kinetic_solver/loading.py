"""Libraries loaded without what they load besides, for stand-ins that nothing here uses."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without(*names: str) -> Iterator[None]:
    """A context in which these modules are not there for whoever tries to import them, unless they are loaded already."""
    absent = [name for name in names if name not in sys.modules]
    sys.modules.update(dict.fromkeys(absent))  # type: ignore[arg-type]  # a module that is None is not there
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]
