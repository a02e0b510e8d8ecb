"""Linear theory of the homogeneous state: what moment closures predict, what the kinetic equation does, what noise makes of it.

Shares no numerics with the grid solver, which is held against it (docs/stability_details.md).
"""

from kinetic_solver.stability.amplification import apparent_critical_density, density_gain, structure_factor, transient_growth
from kinetic_solver.stability.closure import closure_rates, critical_collision_number, critical_density, figure_1
from kinetic_solver.stability.density_map import over_densities
from kinetic_solver.stability.homogeneous import HomogeneousState, homogeneous_state
from kinetic_solver.stability.scaling import ScalingState, cooling_state, white_noise_state
from kinetic_solver.stability.spectrum import (
    eigenfunction,
    growth_rates,
    homogeneous_distribution,
    kinetic_rates,
    mean_velocity,
    spectrum,
)
from kinetic_solver.stability.truncation import truncated_run

__all__ = [
    "HomogeneousState",
    "ScalingState",
    "apparent_critical_density",
    "closure_rates",
    "cooling_state",
    "critical_collision_number",
    "critical_density",
    "density_gain",
    "eigenfunction",
    "figure_1",
    "growth_rates",
    "homogeneous_distribution",
    "homogeneous_state",
    "kinetic_rates",
    "mean_velocity",
    "over_densities",
    "spectrum",
    "structure_factor",
    "transient_growth",
    "truncated_run",
    "white_noise_state",
]
