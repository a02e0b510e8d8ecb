"""The scenes that come with this software, wherever it is installed."""

from __future__ import annotations

from pathlib import Path

from kinetic_solver.errors import SceneError

_PACKAGE = Path(__file__).parents[1]


def shipped(name: str) -> Path:
    """The file of a scene by its name, "pipe" say: of the installed package, or of the folder scenes/ of a checkout.

    Raises SceneError for a name that there is none of.
    """
    if name not in names():
        raise SceneError(f"scene {name!r}: does not come with this software; allowed: {', '.join(names())}")
    return _folder() / f"{name}.toml"


def names() -> list[str]:
    """Of all of them."""
    return sorted(path.stem for path in _folder().glob("*.toml"))


def _folder() -> Path:
    return next((path for path in (_PACKAGE / "scenes", _PACKAGE.parent / "scenes") if path.is_dir()), _PACKAGE / "scenes")
