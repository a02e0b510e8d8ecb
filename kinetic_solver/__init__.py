"""One-dimensional kinetic equations with friction, noise and collisions, solved and held against exact solutions.

from kinetic_solver import Scene, solve
dataset = solve(Scene.from_toml("scenes/pipe.toml"))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinetic_solver.certification import certify
    from kinetic_solver.monitor import SolverStopped
    from kinetic_solver.scene import Scene, SceneError
    from kinetic_solver.solver import solve

__all__ = ["Scene", "SceneError", "SolverStopped", "certify", "exact", "solve", "stability"]

_HOME = {
    "Scene": "kinetic_solver.scene",
    "SceneError": "kinetic_solver.scene",
    "SolverStopped": "kinetic_solver.monitor",
    "certify": "kinetic_solver.certification",
    "solve": "kinetic_solver.solver",
}


def __getattr__(name: str) -> Any:
    # Names are looked up when first used: the command line's --help must not wait for numba and xarray.
    from importlib import import_module

    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    if name in ("exact", "stability"):
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
