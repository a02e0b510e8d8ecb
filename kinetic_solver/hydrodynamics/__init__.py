"""The paper's hydrodynamic equations: the closure (3)-(5), and hierarchies of M moments up to the kinetic equation.

Shares the scene, the schedule and the dataset with the other methods, and no numerics with the grid solver.
"""

from kinetic_solver.hydrodynamics.frame_store import FrameStore
from kinetic_solver.hydrodynamics.plan import Plan, make_plan
from kinetic_solver.hydrodynamics.records import variables
from kinetic_solver.hydrodynamics.solve import Run, integrate, solve

__all__ = ["FrameStore", "Plan", "Run", "integrate", "make_plan", "solve", "variables"]
