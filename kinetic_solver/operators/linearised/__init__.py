"""Operator (6) without time-step error: the nonlinear equation is linear after a change of variables, and is stepped there."""

from kinetic_solver.operators.linearised.grid import GridLinearisedStep, Lifted
from kinetic_solver.operators.linearised.hermite import HermiteLinearisedStep

__all__ = ["GridLinearisedStep", "HermiteLinearisedStep", "Lifted"]
