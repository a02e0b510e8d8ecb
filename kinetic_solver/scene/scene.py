"""The scene: everything that defines a run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, model_validator

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.laws import CollisionLaw, PairLaw, check_given, law_of
from kinetic_solver.scene import toml
from kinetic_solver.scene.cadence import multiples
from kinetic_solver.scene.initial import Initial
from kinetic_solver.scene.tables import (
    GROUPS,
    INELASTIC,
    MOST_FRAMES,
    Accuracy,
    Collisions,
    Grid,
    Hydrodynamics,
    Model,
    Operator,
    Output,
    Particles,
    Pipe,
    Run,
    Table,
    Units,
)


class Groups(BaseModel, frozen=True):
    """The dimensionless groups of a scene."""

    collision_number: float
    """R* = S ρ̄ √σ/γ: collisions per relaxation time of a thermal particle."""
    wavenumber: float
    """k* = (2π/L) √σ/γ of the longest wave: the thermal free path in units of L/2π."""
    length: float
    """L* = L γ/√σ."""


def check_is_scene(scene: object) -> None:
    """Raises SceneError for a path, a dictionary or whatever else is handed over in a scene's place."""
    if not isinstance(scene, Scene):
        raise SceneError(
            f"scene: is of type {type(scene).__name__}; allowed: a Scene; Scene.from_toml(path) reads one, Scene(…) makes one"
        )


class Scene(Table):
    """Everything that defines a run of equation (2)."""

    model: Model = Model()
    collisions: Collisions | None = None
    pipe: Pipe
    initial: Initial = Initial()
    run: Run
    output: Output = Output()
    accuracy: Accuracy = Accuracy()
    grid: Grid = Grid()
    particles: Particles = Particles()
    hydrodynamics: Hydrodynamics = Hydrodynamics()
    units: Units | None = None

    @model_validator(mode="after")
    def _cadences_are_countable(self) -> Scene:
        for group in GROUPS:
            cadence = getattr(self.output, group)
            if not isinstance(cadence, bool) and self.run.end_time / cadence > MOST_FRAMES:
                raise ValueError(f"output.{group} = {cadence:g} makes more than {MOST_FRAMES} frames until end_time; raise it")
        return self

    @model_validator(mode="after")
    def _one_place_shows_what_is_the_same_everywhere(self) -> Scene:
        if self.output.nx == 1 and not self.homogeneous:
            raise ValueError("output.nx = 1: one place does not show a scene that depends on x; allowed: 2 or more")
        return self

    @model_validator(mode="after")
    def _eigenmodes_have_a_state_to_be_about(self) -> Scene:
        if self.initial.eigenmodes and self.model.friction * self.model.noise == 0:
            raise ValueError(
                f"initial.eigenmodes are about a stationary state, and model.friction = {self.model.friction:g}, "
                f"model.noise = {self.model.noise:g} have none; allowed: both above 0"
            )
        return self

    @classmethod
    def from_toml(cls, path: str | Path, overrides: dict[str, Any] | None = None) -> Scene:
        """Read a scene; `overrides` maps dotted keys to values, as in {"grid.nx": 64}.

        A relative `initial.file` is relative to the scene's folder. Raises SceneError, with a message of one line.
        """
        return toml.validated(cls, toml.read(path, overrides), path)

    def replace(self, **keys: Any) -> Scene:
        """The scene with other values of these keys, as in replace(**{"collisions.cross_section": 3.0}).

        A whole table is a key too, and None takes it, or the value of a key, away. Raises SceneError, which names the key, for
        what a scene must not have.
        """
        data = toml.plain(self)
        for dotted, value in keys.items():
            toml.set_dotted(data, dotted, toml.plain(value))
        return Scene.model_validate(data)

    def to_toml(self) -> str:
        """The scene as TOML, from which `from_toml` makes the same one: the keys that were given, without defaults.

        A relative `initial.file` stays as it is: the text belongs into the folder to which it is relative.
        """
        return toml.written(toml.plain(self))

    @property
    def cross_section(self) -> float:
        """S_C of the collisions that act; 0 without any, as of elastic ones (ε = 1), which change nothing."""
        return self.collisions.cross_section if self.collisions is not None and self.operator is not None else 0.0

    @property
    def restitution(self) -> float:
        """ε; 1 where nothing is inelastic."""
        return 1.0 if self.collisions is None or self.collisions.restitution is None else self.collisions.restitution

    @property
    def operator(self) -> Operator | None:
        """The operator that acts: None without collisions, for S_C = 0, and for elastic ones (ε = 1), whose (12) is zero."""
        if self.collisions is None or self.collisions.cross_section == 0:
            return None
        if self.collisions.operator == INELASTIC and self.restitution == 1:
            return None
        return self.collisions.operator

    @property
    def law(self) -> PairLaw | None:
        """The collision law that acts: the record of which everything else asks."""
        return law_of(self.operator, self.cross_section, self.restitution)

    def law_with(self, operator: CollisionLaw | None) -> CollisionLaw | None:
        """The collision law that acts where `operator` was brought along. Raises SceneError for what is none, or one too many."""
        if operator is None:
            return self.law
        check_given(operator)
        if self.collisions is not None:
            raise SceneError(f"collisions: the scene has a table, and operator = {operator.label} is given; allowed: one of them")
        return operator

    @property
    def homogeneous(self) -> bool:
        """True where nothing in the scene depends on x."""
        i = self.initial
        varied = (*i.density_modes, *i.velocity_modes, *i.temperature_modes)
        stepped = i.step is not None and i.step.ratio != 1
        pulsed = i.pulse is not None and i.pulse.height != 0
        return i.file is None and not stepped and not pulsed and not any(m.cos or m.sin for m in varied)

    @property
    def groups(self) -> Groups:
        g, s = self.model.friction, math.sqrt(self.model.noise)
        path = s / g if g > 0 else (math.inf if s > 0 else math.nan)
        return Groups(
            collision_number=self.cross_section * self.initial.density * path if self.cross_section else 0.0,
            wavenumber=2 * math.pi / self.pipe.length * path,
            length=self.pipe.length / path if path else math.inf,
        )

    @property
    def output_every(self) -> float:
        return self.run.output_every or self.run.end_time

    def times(self, cadence: bool | float = True) -> Array:
        """Frame times: 0, every cadence, and end_time; empty for False."""
        if cadence is False:
            return np.empty(0)
        return multiples(self.output_every if cadence is True else float(cadence), self.run.end_time)
