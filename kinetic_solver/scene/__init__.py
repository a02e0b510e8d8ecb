"""What is simulated: the tables of a scene, the scene they make, how it is read, and when anything of it is written.

Data only, validated and immutable; nothing is computed here. A scene is read from TOML (`Scene.from_toml`) or built from the
same keys in Python (`Scene.model_validate`). Units are the user's own; they must be consistent (length, time, number of
particles). Symbols and conventions: docs/theory_details.md; equation numbers are those of the paper cited there.
"""

from kinetic_solver.scene.initial import Beam, Initial, Mode, Modes, Pulse, fourier_sum
from kinetic_solver.scene.messages import shorten
from kinetic_solver.scene.scene import Groups, Scene, check_is_scene
from kinetic_solver.scene.schedule import Schedule
from kinetic_solver.scene.shipped import shipped
from kinetic_solver.scene.tables import (
    FOLLOW_LEADER,
    GROUPS,
    INELASTIC,
    Accuracy,
    Deposit,
    DriftDiffusionScheme,
    Grid,
    Model,
    Output,
    Run,
    SteppingScheme,
    VelocityScheme,
)
from kinetic_solver.scene.toml import parse_override

__all__ = [
    "FOLLOW_LEADER",
    "GROUPS",
    "INELASTIC",
    "Accuracy",
    "Beam",
    "Deposit",
    "DriftDiffusionScheme",
    "Grid",
    "Groups",
    "Initial",
    "Mode",
    "Model",
    "Modes",
    "Output",
    "Pulse",
    "Run",
    "Scene",
    "Schedule",
    "SteppingScheme",
    "VelocityScheme",
    "check_is_scene",
    "fourier_sum",
    "parse_override",
    "shipped",
    "shorten",
]
