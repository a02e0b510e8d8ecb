"""Units by name: what files say with and without the table [units], of every method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, run_to_file, solve
from kinetic_solver.dataset import open_run
from kinetic_solver.dataset.units import unit_in
from kinetic_solver.errors import SceneError

MakeScene = Callable[..., Scene]
METRES = {"length": "cm", "time": "min"}


@pytest.mark.parametrize(
    ("words", "named", "counted"),
    [
        ("length", "cm", "cm"),
        ("particles", "1", "mol"),
        ("1", "1", "1"),
        ("particles time length-2", "min cm^-2", "mol min cm^-2"),
        ("length2 time-3", "cm^2 min^-3", "cm^2 min^-3"),
        ("particles length2 time-2", "cm^2 min^-2", "mol cm^2 min^-2"),
        ("radians", "radians", "radians"),
    ],
)
def test_words_become_names(make_scene: MakeScene, words: str, named: str, counted: str) -> None:
    assert unit_in(None, words) == words
    assert unit_in(make_scene(units=METRES).units, words) == named
    assert unit_in(make_scene(units={**METRES, "number": "mol"}).units, words) == counted


@pytest.mark.parametrize("method", ["grid", "exact", "particles", "hydrodynamics"])
def test_every_unit_of_a_file_is_named(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """No word of the schema is left, no number differs, and only such files claim the conventions."""
    more: dict[str, Any] = {"run": {"end_time": 0.3}, "particles": {"count": 300, "replicas": 2}}
    if method == "hydrodynamics":
        more["collisions"] = {"operator": "follow-the-leader", "cross_section": 0.9}
    elif method == "grid":
        more["output"] = {"moment_equations": True, "f": 0.1}
    else:
        more["output"] = {"f": 0.1}
    run_to_file(make_scene(**more), tmp_path / "words.nc", method)
    run_to_file(make_scene(**more, units=METRES), tmp_path / "names.nc", method)
    with open_run(tmp_path / "words.nc") as words, open_run(tmp_path / "names.nc") as names:
        assert "Conventions" not in words.attrs
        assert names.attrs["Conventions"] == "CF-1.8"
        for name, variable in names.variables.items():
            assert np.array_equal(variable.values, words[name].values, equal_nan=True), name
            unit = variable.attrs.get("units", "1")
            assert not any(word in unit for word in ("length", "time", "particles")), name
        assert names["temperature"].attrs["units"] == "cm^2 min^-2"
        assert names["time"].attrs["units"] == "min"
        assert words["temperature"].attrs["units"] == "length2 time-2"


def test_in_memory_as_in_files(make_scene: MakeScene) -> None:
    run = solve(make_scene(units=METRES))
    assert (run["f"].attrs["units"], run["x"].attrs["units"], run.attrs["Conventions"]) == ("min cm^-2", "cm", "CF-1.8")
    assert Scene.model_validate_json(run.attrs["scene"]).units == make_scene(units=METRES).units


@pytest.mark.parametrize(
    ("units", "key"),
    [
        ({"length": "m"}, "time"),
        ({"length": "m s-1", "time": "s"}, "length"),
        ({"length": "m", "time": 1.0}, "time"),
        ({"length": "m", "time": "s", "mass": "kg"}, "mass"),
    ],
)
def test_what_are_no_names(make_scene: MakeScene, units: dict[str, Any], key: str) -> None:
    with pytest.raises(SceneError, match=key):
        make_scene(units=units)
