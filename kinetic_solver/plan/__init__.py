"""What a run will use, decided before it starts, and why."""

from kinetic_solver.plan.plan import Plan, check_memory, make_plan

__all__ = ["Plan", "check_memory", "make_plan"]
