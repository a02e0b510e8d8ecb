"""How substeps are composed in time. Knows no physics: a substep is any callable (f, dt) → f, a rate any callable f → ∂f/∂t.

Two base methods, `strang` for collisions that have an exact substep and `lawson` for those that only have a rate;
`Extrapolated`, which raises a base method's order and estimates its error; `Embedded`, which estimates it without more rates, in
Lawson's variable or with an exponential (`krogstad`); and three steppers that fill an interval with steps: `Controlled`, `Fixed`
and `ExactSteps`; `integrate` is for systems of ordinary differential equations. Why these: docs/performance.md.
"""

from kinetic_solver.stepping.controlled import Controlled, Fixed, Pace
from kinetic_solver.stepping.differential import integrate
from kinetic_solver.stepping.drive import advance
from kinetic_solver.stepping.embedded import Embedded, OneStep, Signs, embedded_lawson, largest
from kinetic_solver.stepping.exact_steps import Chain, ExactStep, ExactSteps, Link, Plain
from kinetic_solver.stepping.exponential import krogstad
from kinetic_solver.stepping.methods import Extrapolated, lawson, strang
from kinetic_solver.stepping.protocol import BaseMethod, Integral, Rate, Stalled, Step, Stepper, Substep, Watched, count_of

__all__ = [
    "BaseMethod",
    "Chain",
    "Controlled",
    "Embedded",
    "ExactStep",
    "ExactSteps",
    "Extrapolated",
    "Fixed",
    "Integral",
    "Link",
    "OneStep",
    "Pace",
    "Plain",
    "Rate",
    "Signs",
    "Stalled",
    "Step",
    "Stepper",
    "Substep",
    "Watched",
    "advance",
    "count_of",
    "embedded_lawson",
    "integrate",
    "krogstad",
    "largest",
    "lawson",
    "strang",
]
