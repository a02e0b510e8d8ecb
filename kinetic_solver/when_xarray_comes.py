"""`ds.kinetic` is there once both this software and xarray are imported, whichever comes first and without loading the other."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # loading them costs every start 4 ms
    from importlib.abc import Loader
    from importlib.machinery import ModuleSpec

ACCESSOR = "kinetic_solver.analysis.accessor"


def register_accessor() -> None:
    """Now, where xarray is there already; else after its import."""
    if "xarray" in sys.modules:
        import_module(ACCESSOR)
    elif not any(isinstance(finder, _Waiting) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Waiting())


class _Waiting:
    """A finder of modules. Finds nothing itself: it lets the others find xarray, and the accessor follow."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "xarray":
            return None
        sys.meta_path.remove(self)
        for finder in sys.meta_path:
            spec = finder.find_spec(name, path, target)
            if spec is not None and spec.loader is not None:
                spec.loader = _Followed(spec.loader)  # type: ignore[assignment]  # it has what is asked of one
                return spec
        return None


class _Followed:
    """The loader of xarray, and after it the accessor's import."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__.loader = module.__loader__ = self._loader
        self._loader.exec_module(module)
        import_module(ACCESSOR)
