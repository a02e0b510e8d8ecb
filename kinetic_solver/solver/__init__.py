"""The grid solver: equation (2) on phase space, from a plan to a Dataset."""

from kinetic_solver.solver.solve import integrate, solve

__all__ = ["integrate", "solve"]
