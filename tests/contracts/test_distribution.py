"""What is distributed is what is said: bounds are versions that were run, scenes are found. `.ci/minimum` does the rest."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from kinetic_solver import Scene, SceneError
from kinetic_solver.scene import shipped

ROOT = Path(__file__).parents[2]


def versions(lines: list[str]) -> dict[str, tuple[int, ...]]:
    """Package → version, to three places."""
    found = {}
    for line in lines:
        if match := re.match(r"([\w-]+)(?:>=|==)([\d.]+)$", line):
            numbers = [int(part) for part in match[2].split(".")]
            found[match[1].lower()] = tuple((*numbers, 0, 0)[:3])
    return found


def test_the_bounds_are_the_versions_that_are_run() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    run = versions((ROOT / ".ci" / "minimum.txt").read_text(encoding="utf-8").splitlines())
    assert len(run) == len(project["dependencies"])
    assert versions(project["dependencies"]) == run


def test_scenes_are_found_by_name() -> None:
    assert Scene.from_toml(shipped("pipe")) == Scene.from_toml(ROOT / "scenes" / "pipe.toml")
    with pytest.raises(
        SceneError, match=r"^scene 'pip': does not come with this software; allowed: closure, cooling, .*relaxation"
    ):
        shipped("pip")
