"""What a run will use, decided before it starts, and why."""

from kinetic_solver.plan.cost import Cost, cost
from kinetic_solver.plan.limits import check_memory
from kinetic_solver.plan.making import make_plan
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.plan import Plan

__all__ = ["Cost", "Plan", "ReferenceFrame", "check_memory", "cost", "make_plan"]
