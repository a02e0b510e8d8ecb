"""What docstrings and comments point to exists: tests, documents, modules, benchmarks."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted(path for folder in ("kinetic_solver", "particles", "benchmarks") for path in (ROOT / folder).rglob("*.py"))
MODULES = [path.relative_to(ROOT).as_posix() for path in FILES]


def prose(source: str) -> str:
    """Docstrings, of constants as well, and comments."""
    strings = [
        node.value.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return "\n".join([*strings, *(token.string for token in tokens if token.type == tokenize.COMMENT)])


def dangling(text: str) -> list[str]:
    """Names of files in the text that are not there.

    tests/… and docs/… are paths from the root, and so is what begins with the name of a package; any other name of a module is
    the end of a module's path.
    """
    found = []
    for name in re.findall(r"[\w/]+\.(?:py|md)\b", text):
        there = (ROOT / name).is_file() if "/" in name or name.endswith(".md") else False
        if not there and not (name.endswith(".py") and any(f"/{module}".endswith(f"/{name}") for module in MODULES)):
            found.append(name)
    found += [name for name in re.findall(r"\bbenchmarks\.\w+", text) if f"{name.replace('.', '/')}.py" not in MODULES]
    return found


def test_what_is_missing_is_seen() -> None:
    assert dangling("tests/contracts/test_docstrings.py, docs/design.md, README.md, `fourier.py`, operators/fourier.py") == []
    assert dangling("kinetic_solver/grid.py, benchmarks/timing.py and `benchmarks.timing`") == []
    wrong = ["tests/contracts/test_nothing.py", "docs/nothing.md", "velocity/fourier.py", "ourier.py", "benchmarks.nothing"]
    assert dangling(", ".join(wrong)) == wrong
    assert prose('"""A."""\nX = "B"  # C\n"""D."""\n') == "A.\nD.\n# C"


@pytest.mark.parametrize("path", FILES, ids=MODULES)
def test_what_prose_points_to_exists(path: Path) -> None:
    assert dangling(prose(path.read_text(encoding="utf-8"))) == []
