"""The state at time 0: the scene's conventions for its fields over x, and f from them, from eigenmodes, or from a file."""

from kinetic_solver.initial.eigenmodes import check_eigenmodes, eigenmode_background, eigenmode_shapes, eigenmode_state
from kinetic_solver.initial.fields import (
    density,
    density_integral,
    mean_velocity,
    resolved_density,
    resolved_lifted_density,
    start_state,
    temperature,
)
from kinetic_solver.initial.from_file import file_grid, from_file
from kinetic_solver.initial.state import initial_state, maxwellian

__all__ = [
    "check_eigenmodes",
    "density",
    "density_integral",
    "eigenmode_background",
    "eigenmode_shapes",
    "eigenmode_state",
    "file_grid",
    "from_file",
    "initial_state",
    "maxwellian",
    "mean_velocity",
    "resolved_density",
    "resolved_lifted_density",
    "start_state",
    "temperature",
]
