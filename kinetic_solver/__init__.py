"""One-dimensional kinetic equations with friction, noise and collisions, solved and held against exact solutions.

from kinetic_solver import Scene, solve
dataset = solve(Scene.from_toml("scenes/pipe.toml"))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kinetic_solver.machine import keep_compiled_code
from kinetic_solver.when_xarray_comes import register_accessor

if TYPE_CHECKING:
    from kinetic_solver import compare, exact, hydrodynamics, stability
    from kinetic_solver.analysis.certification import certify
    from kinetic_solver.analysis.resampling import resample
    from kinetic_solver.errors import KineticError, OutputExistsError, RunUnfinished, SceneError, SolverStopped
    from kinetic_solver.laws import CollisionLaw, PairLaw
    from kinetic_solver.methods import run_to_file
    from kinetic_solver.scene import Scene
    from kinetic_solver.solver.solve import solve
    from kinetic_solver.sweeps import sweep

    __version__: str

__all__ = [
    "CollisionLaw",
    "KineticError",
    "OutputExistsError",
    "PairLaw",
    "RunUnfinished",
    "Scene",
    "SceneError",
    "SolverStopped",
    "__version__",
    "certify",
    "compare",
    "exact",
    "hydrodynamics",
    "resample",
    "run_to_file",
    "solve",
    "stability",
    "sweep",
]

_HOME = {
    "CollisionLaw": "laws",
    "PairLaw": "laws",
    "KineticError": "errors",
    "OutputExistsError": "errors",
    "RunUnfinished": "errors",
    "Scene": "scene",
    "SceneError": "errors",
    "SolverStopped": "errors",
    "certify": "analysis.certification",
    "resample": "analysis.resampling",
    "run_to_file": "methods",
    "solve": "solver",
    "sweep": "sweeps",
}
_PACKAGES = ("compare", "exact", "hydrodynamics", "stability")

keep_compiled_code()
register_accessor()


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
