"""Two datasets of a scene laid over each other: differences in standard errors, systematic errors bounded apart."""

from kinetic_solver.compare.comparison import Comparison, Row, compare

__all__ = ["Comparison", "Row", "compare"]
