"""Systems of ordinary differential equations over one interval, by LSODA (A. C. Hindmarsh 1983, in SciPy): Adams' methods of
order up to 12, and backward differences where those would need short steps."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import StepTooSmall

ONE_AT_A_TIME = threading.Lock()
"""SciPy's LSODA keeps its state in one place, and refuses a second system before the first is done."""


def integrate(
    rate: Callable[[float, Array], Array],
    jacobian: Callable[[float, Array], Array],
    y: Array,
    start: float,
    end: float,
    relative: float,
    absolute: Array,
) -> Array:
    """y (n,) at the ends of all steps from start to end, (steps + 1, n), each with a local error of relative·|y| + absolute.
    What the integrator sees is the share of the interval that is done: its bits do not depend on the unit of time.

    Raises StepTooSmall where no step is short enough.
    """
    from scipy.integrate import solve_ivp

    length = end - start
    with ONE_AT_A_TIME, np.errstate(all="ignore"):
        found = solve_ivp(
            lambda share, y: length * rate(start + share * length, y),
            (0.0, 1.0),
            y,
            method="LSODA",
            rtol=relative,
            atol=absolute,
            jac=lambda share, y: length * jacobian(start + share * length, y),
        )
    if not found.success or not np.isfinite(found.y).all():
        raise StepTooSmall(f"no step keeps the error asked for ({found.message})")
    return found.y.T
