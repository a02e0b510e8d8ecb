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


class OutputFailed(KineticError, OSError):
    """What a run writes could not be written: a full disk, say. What is there already stays as it is."""


class SolverStopped(KineticError, RuntimeError):
    """A run that could not go on. The message says when, what happened, and what to change."""

    dataset: xr.Dataset
    """The frames until then, where the run was kept in memory."""


class RunUnfinished(KineticError):
    """A run was stopped from outside, or the wall-clock time that it was given is over."""

    def __init__(self, message: str, by: str | None = None, kept: bool = True) -> None:
        super().__init__(message)
        self.by = by
        """Who stopped it, the name of a signal, say; None where its time was over."""
        self.kept = kept
        """Whether a checkpoint was kept, from which it can be resumed."""


class LostAccuracy(KineticError, RuntimeError):
    """An exact step could not be done accurately; the state before it is good."""


class StepTooSmall(KineticError, RuntimeError):
    """The error asked for cannot be reached by any step."""
