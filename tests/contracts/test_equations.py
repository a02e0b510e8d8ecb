"""docs/equations.md: each equation of the paper, and every function and test that it names exists."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
HEADINGS = re.findall(r"^## (.*)$", PAGE, re.MULTILINE)
NAMED = sorted(set(re.findall(r"`([\w/]+\.py)::([\w.]+)`", PAGE)))
PUBLIC = sorted(set(re.findall(r"\{func\}`([\w.]+)`", PAGE)))


def test_every_equation_has_its_place() -> None:
    numbers = [int(number) for heading in HEADINGS for number in re.findall(r"\((\d+)\)", heading)]
    assert numbers == list(range(1, 15))


def test_every_equation_has_a_test_and_something_that_computes_it() -> None:
    for section in PAGE.split("\n## ")[1:-1]:
        assert "*Computed by*" in section, section
        assert "`tests/" in section, section


@pytest.mark.parametrize(("path", "name"), NAMED)
def test_what_is_named_is_there(path: str, name: str) -> None:
    here = path.startswith(("tests/", "particles/"))
    body: list[ast.stmt] = ast.parse((ROOT / ("" if here else "kinetic_solver") / path).read_text(encoding="utf-8")).body
    for part in name.split("."):
        found = [node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == part]
        assert found, f"{path} has no {name}"
        body = found[0].body


@pytest.mark.parametrize("name", PUBLIC)
def test_public_functions_are_in_the_reference(name: str) -> None:
    module, _, function = name.rpartition(".")
    assert callable(getattr(importlib.import_module(module), function))
    reference = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert f"autofunction:: {name}\n" in reference or f"automodule:: {module}\n   :members:" in reference


def test_names_without_a_path_are_files_of_tests() -> None:
    """In the table at the top."""
    for name in re.findall(r"`(test_\w+\.py)`", PAGE):
        assert list((ROOT / "tests").rglob(name)), name
