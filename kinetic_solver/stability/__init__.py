"""Linear theory of the homogeneous state."""

from kinetic_solver.stability.closure import critical_density

__all__ = ["critical_density"]
