"""One loop over particles, compiled for each collision law by itself.

numba does not keep compiled code between processes where a function is handed over as an argument. So the loops call a global
`after`, and every law gets copies of them in which that name is bound to its own.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

import numba
from numba.core.errors import NumbaError

from kinetic_solver.errors import SceneError
from kinetic_solver.laws import FollowTheLeader, Inelastic, PairLaw

PAPERS = (FollowTheLeader, Inelastic)
"""Laws whose compiled loops are kept on disk: those that do not change."""


def specialised(loop: Callable[..., Any], law: Any, options: dict[str, Any], **bound: Any) -> Any:
    """The loop, compiled with numba's options for a class of laws: globals that it names in `bound` are these."""
    name = f"{loop.__name__}_{law.__name__}"
    copy = types.FunctionType(loop.__code__, {**loop.__globals__, **bound}, name)
    copy.__qualname__, copy.__module__ = name, loop.__module__
    return numba.njit(cache=law in PAPERS, **options)(copy)


def check_compiles(law: PairLaw) -> None:
    """Raises SceneError, with numba's reason, where the law cannot be compiled for the particles."""
    try:
        numba.njit(law.after)(1.0, *law.numbers)
    except NumbaError as error:
        reason = next(line.strip() for line in str(error).splitlines() if line.strip())
        raise SceneError(
            f"operator {law.label}: after(r, …) cannot be compiled ({reason}); allowed for particles: numbers and the module math"
        ) from None
