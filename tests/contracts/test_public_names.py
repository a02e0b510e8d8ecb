"""The names that `kinetic_solver` and `particles` give, when they are first used."""

from __future__ import annotations

from importlib import import_module, metadata

import pytest

import kinetic_solver
import particles


@pytest.mark.parametrize("package", [kinetic_solver, particles], ids=lambda package: package.__name__)
def test_every_name_that_is_promised_is_there(package: object) -> None:
    names = package.__all__  # type: ignore[attr-defined]
    assert list(names) == sorted(names)
    assert len(set(names)) == len(names)
    assert set(names) <= set(dir(package))
    for name in names:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'slove'"):
        _ = package.slove  # type: ignore[attr-defined]


def test_what_is_promised() -> None:
    """The agreed interface."""
    assert {"Scene", "solve", "run_to_file", "certify", "SceneError", "SolverStopped", "__version__"} <= set(
        kinetic_solver.__all__
    )
    assert {"exact", "stability", "compare"} <= set(kinetic_solver.__all__)
    assert set(particles.__all__) == {"Simulation", "simulate"}
    assert callable(kinetic_solver.compare.compare)
    assert callable(kinetic_solver.exact.solve)


def test_names_are_those_of_their_homes() -> None:
    for name, home in kinetic_solver._HOME.items():
        assert getattr(kinetic_solver, name) is getattr(import_module(f"kinetic_solver.{home}"), name)
    assert set(kinetic_solver._HOME) | set(kinetic_solver._PACKAGES) | {"__version__"} == set(kinetic_solver.__all__)


def test_the_version() -> None:
    assert kinetic_solver.__version__ == metadata.version("kinetic-solver")


def test_a_star_import() -> None:
    names: dict[str, object] = {}
    exec("from kinetic_solver import *", names)
    assert set(kinetic_solver.__all__) <= set(names)
