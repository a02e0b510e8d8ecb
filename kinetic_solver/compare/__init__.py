"""Two datasets of a scene laid over each other: differences in standard errors, systematic errors bounded apart."""

from kinetic_solver.compare.comparison import Comparison
from kinetic_solver.compare.overlay import compare
from kinetic_solver.compare.rows import Row

__all__ = ["Comparison", "Row", "compare"]
