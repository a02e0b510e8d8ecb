"""How substeps are composed in time. Knows no physics: a substep is any callable (f, dt) → f, a rate any callable f → ∂f/∂t.

Two base methods, `strang` for collisions that have an exact substep and `lawson` for those that only have a rate; `Extrapolated`,
which raises a base method's order and estimates its error; and two steppers, `Controlled` and `ExactSteps`, that
fill an interval with steps. Why these: docs/performance.md.
"""

from kinetic_solver.stepping.controlled import Controlled
from kinetic_solver.stepping.exact_steps import ExactStep, ExactSteps, Plain
from kinetic_solver.stepping.methods import Extrapolated, lawson, strang
from kinetic_solver.stepping.protocol import BaseMethod, Observer, Rate, Stepper, Substep

__all__ = [
    "BaseMethod",
    "Controlled",
    "ExactStep",
    "ExactSteps",
    "Extrapolated",
    "Observer",
    "Plain",
    "Rate",
    "Stepper",
    "Substep",
    "lawson",
    "strang",
]
