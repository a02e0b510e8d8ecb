"""What a method is asked to do, and what comes of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from kinetic_solver.dataset import VARIABLES, Checkpoint, NetCDFRecorder, Variables, finished, law_attribute
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import Given, Start, notes_of
from kinetic_solver.laws import CollisionLaw
from kinetic_solver.methods.interruption import Interruption, Keeper
from kinetic_solver.progress import Progress
from kinetic_solver.scene import Scene, Schedule


@dataclass(frozen=True)
class Job:
    """One run of a scene into a file."""

    scene: Scene
    path: Path
    method: str
    overwrite: bool = False
    resume: bool = False
    """Go on from the checkpoint beside the file, where there is one."""
    max_walltime: float | None = None
    """Seconds after which to stop, with a checkpoint."""
    progress: Progress | None = None
    operator: CollisionLaw | None = None
    """A collision law beside the scene."""
    initial: Given | None = None
    """A start of one's own, instead of [initial]."""
    interruption: Interruption = field(default_factory=Interruption)
    began: float = field(default_factory=monotonic)

    def notes(self, start: Start | None = None) -> dict[str, str]:
        """What the run is of beside its scene, as attributes. `start` is what the method found `initial` to be."""
        return {**law_attribute(self.operator), **notes_of(start)}

    def resumed(self, scene: Scene, types: Iterable[type] = (), notes: Mapping[str, str] | None = None) -> Resumed:
        """Where the run of `scene`, this job's or what the method completed it to, goes on. `types`, `notes`: of `Checkpoint`.

        Raises SceneError where the file or its checkpoint is not this run's, or damaged.
        """
        said = self.notes() if notes is None else notes
        checkpoint = Checkpoint(self.path, scene, self.method, types, said)
        if not (self.resume and self.path.exists()):
            return Resumed(checkpoint)
        if finished(self.path, scene, self.method, said):
            checkpoint.remove()
            return Resumed(checkpoint, finished=True)
        return Resumed(checkpoint, checkpoint.load())

    def keeper(self, resumed: Resumed, recorder: NetCDFRecorder) -> Keeper:
        """For the run that is now to begin or to go on. What checkpoints lie there that it does not go on from are removed."""
        if resumed.state is None:
            resumed.checkpoint.remove()
            if self.resume:
                self.interruption.answer(f"{self.path}: there is no checkpoint to go on from; the run starts at t = 0")
        return Keeper(resumed.checkpoint, recorder, self.max_walltime, self.interruption, self.began)

    def recorder(
        self,
        grid: PhaseSpaceGrid,
        schedule: Schedule,
        variables: Variables = VARIABLES,
        scene: Scene | None = None,
        more: Mapping[str, np.ndarray] | None = None,
        after: float | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> NetCDFRecorder:
        """Of this job's file. `scene` is that of the job, unless the method has completed it; else as for `NetCDFRecorder`."""
        overwrite = self.overwrite or self.resume
        written = self.scene if scene is None else scene
        said = self.notes() if notes is None else notes
        return NetCDFRecorder(self.path, grid, written, schedule, self.method, overwrite, variables, more, after, said)


@dataclass(frozen=True)
class Resumed:
    """What a run finds when it begins."""

    checkpoint: Checkpoint
    state: Any | None = None
    """That it goes on from; None where it starts afresh."""
    finished: bool = False
    """True where nothing is left to do."""


@dataclass(frozen=True)
class Written:
    """A run whose file is complete."""

    path: Path
    lines: tuple[str, ...]
    """What the method says of it: an estimated error, the speed of particles."""
