"""The state at time 0: the scene's conventions for its fields over x, f from them, from eigenmodes, or from a file, and `Start`,
which runs ask for all of that."""

from kinetic_solver.initial.eigenmodes import check_eigenmodes, eigenmode_background, eigenmode_shapes, eigenmode_state
from kinetic_solver.initial.fields import (
    beams,
    density,
    density_excess,
    density_integral,
    mean_velocity,
    resolved_density,
    resolved_lifted_density,
    start_state,
    temperature,
)
from kinetic_solver.initial.from_file import file_grid, file_notes, from_file
from kinetic_solver.initial.given import Given, GivenStart, notes_of, of_file, recorded, take
from kinetic_solver.initial.start import Gaussians, SceneStart, Start
from kinetic_solver.initial.state import distribution, initial_state, maxwellian

__all__ = [
    "Gaussians",
    "Given",
    "GivenStart",
    "SceneStart",
    "Start",
    "beams",
    "check_eigenmodes",
    "density",
    "density_excess",
    "density_integral",
    "distribution",
    "eigenmode_background",
    "eigenmode_shapes",
    "eigenmode_state",
    "file_grid",
    "file_notes",
    "from_file",
    "initial_state",
    "maxwellian",
    "mean_velocity",
    "notes_of",
    "of_file",
    "recorded",
    "resolved_density",
    "resolved_lifted_density",
    "start_state",
    "take",
    "temperature",
]
