"""What a method is asked to do, and what comes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kinetic_solver.dataset import VARIABLES, NetCDFRecorder, Variables, law_attribute
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import Given
from kinetic_solver.laws import CollisionLaw
from kinetic_solver.methods.progress import Progress
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
    """Seconds after which to stop at a frame, with a checkpoint."""
    progress: Progress | None = None
    operator: CollisionLaw | None = None
    """A collision law beside the scene."""
    initial: Given | None = None
    """A start of one's own, instead of [initial]."""

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
        said = {**law_attribute(self.operator), **(notes or {})}
        return NetCDFRecorder(self.path, grid, written, schedule, self.method, overwrite, variables, more, after, said)


@dataclass(frozen=True)
class Written:
    """A run whose file is complete."""

    path: Path
    lines: tuple[str, ...]
    """What the method says of it: an estimated error, the speed of particles."""
