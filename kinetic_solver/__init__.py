"""One-dimensional kinetic equations with friction, noise and collisions, solved and held against exact solutions.

from kinetic_solver import Scene, solve
dataset = solve(Scene.from_toml("scenes/pipe.toml"))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinetic_solver import exact, hydrodynamics, stability
    from kinetic_solver.analysis.certification import certify
    from kinetic_solver.errors import KineticError, SceneError, SolverStopped
    from kinetic_solver.scene import Scene
    from kinetic_solver.solver.solve import solve

    __version__: str

__all__ = [
    "KineticError",
    "Scene",
    "SceneError",
    "SolverStopped",
    "__version__",
    "certify",
    "exact",
    "hydrodynamics",
    "solve",
    "stability",
]

_HOME = {
    "KineticError": "errors",
    "Scene": "scene",
    "SceneError": "errors",
    "SolverStopped": "errors",
    "certify": "analysis.certification",
    "solve": "solver",
}
_PACKAGES = ("compare", "exact", "hydrodynamics", "stability")


def __getattr__(name: str) -> Any:
    # Names are looked up when first used: the command line's --help must not wait for numba and xarray.
    from importlib import import_module, metadata

    if name == "__version__":
        return metadata.version("kinetic-solver")
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    if name in _PACKAGES:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
