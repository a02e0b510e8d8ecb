"""What can go wrong, by name. Every error that this software raises on purpose is a KineticError, and its message is one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr


class KineticError(Exception):
    """Base of all errors that this software raises on purpose."""


class SceneError(KineticError, ValueError):
    """A scene, a file or an argument is wrong. The message says which key, what was given, and what is allowed."""


class OutputExistsError(SceneError):
    """The file to be written exists already, and nobody said that it may be replaced."""

    path: Path


class SolverStopped(KineticError, RuntimeError):
    """A run that could not go on. The message says when, what happened, and what to change."""

    dataset: xr.Dataset
    """The frames until then, where the run was kept in memory."""


class RunUnfinished(KineticError):
    """The wall-clock time that a run was given is over. It left a checkpoint, from which it can be resumed."""


class LostAccuracy(KineticError, RuntimeError):
    """An exact step could not be done accurately; the state before it is good."""


class StepTooSmall(KineticError, RuntimeError):
    """The error asked for cannot be reached by any step."""
