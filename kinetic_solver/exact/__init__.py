"""Closed forms of the nonlinear equation. They share no numerics with the grid solver, which is held against them."""

from kinetic_solver.exact.shocks import shocks
from kinetic_solver.exact.solution import Solution
from kinetic_solver.exact.solve import VARIABLES, frames, points, solve

__all__ = ["VARIABLES", "Solution", "frames", "points", "shocks", "solve"]
