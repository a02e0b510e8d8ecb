"""Many scenes that differ in some keys: run by whoever has time, each into a file of its own, and read as one dataset."""

from kinetic_solver.sweeps.execution import sweep
from kinetic_solver.sweeps.ranges import parse_values

__all__ = ["parse_values", "sweep"]
