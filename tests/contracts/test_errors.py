"""Errors raised on purpose are KineticErrors, and speak of no flags; builtins are raised for programming errors alone."""

from __future__ import annotations

import ast
import builtins
import pickle
from functools import cache
from pathlib import Path

import pytest

from kinetic_solver import errors

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for package in ("kinetic_solver", "particles") for path in (ROOT / package).rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}
ELSEWHERE = {"AttributeError": "__getattr__ of a module", "KeyboardInterrupt": "a signal", "Exit": "typer's exit code"}
"""What Python's and typer's own rules ask to be raised."""
MARK = "# a programming error"
"""The comment, on the line before, of a builtin that no user meets."""


def name_of(node: ast.expr | None) -> str:
    if isinstance(node, ast.Call):
        return name_of(node.func)
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


@cache
def on_purpose() -> set[str]:
    """KineticError, the classes below it, and the functions that say to return one of them."""
    found = {"KineticError"}
    nodes = [node for tree in TREES.values() for node in ast.walk(tree)]
    while True:
        more = {c.name for c in nodes if isinstance(c, ast.ClassDef) and {name_of(base) for base in c.bases} & found}
        if more <= found:
            return found | {f.name for f in nodes if isinstance(f, ast.FunctionDef) and name_of(f.returns) in found}
        found |= more


@cache
def signals() -> set[tuple[Path, str]]:
    """Private exceptions that never leave the file they are made in."""
    return {
        (path, node.name)
        for path, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and node.name.startswith("_") and "Exception" in {name_of(b) for b in node.bases}
    }


def validators(tree: ast.Module) -> set[ast.AST]:
    """What lies in pydantic's validators, whose ValueErrors become SceneErrors in scene/toml.py."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    ours = [f for f in functions if {name_of(d) for d in f.decorator_list} & {"model_validator", "field_validator"}]
    return {inside for function in ours for inside in ast.walk(function)}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_is_raised_is_a_kinetic_error(path: Path) -> None:
    known, lines, validated = on_purpose(), path.read_text(encoding="utf-8").splitlines(), validators(TREES[path])
    for node in ast.walk(TREES[path]):
        if not isinstance(node, ast.Raise) or node.exc is None:
            continue
        name = name_of(node.exc)
        if name in known or name in ELSEWHERE or (path, name) in signals() or (name == "_fail" and path.parent.name == "cli"):
            continue
        if isinstance(node.exc, ast.Name) and not isinstance(getattr(builtins, name, None), type):
            continue  # an exception in a variable: raised again, or made above
        assert name == "ValueError", f"line {node.lineno}: raise {name}"
        assert node in validated or MARK in lines[node.lineno - 2], f"line {node.lineno}: raise ValueError without a word why"


@pytest.mark.parametrize("path", [p for p in SOURCES if p.parent.name != "cli"], ids=lambda path: str(path.relative_to(ROOT)))
def test_messages_of_the_library_speak_of_no_flags(path: Path) -> None:
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Raise) and node.exc is not None:
            texts = [c.value for c in ast.walk(node.exc) if isinstance(c, ast.Constant) and isinstance(c.value, str)]
            assert not any("--" in text or " -o" in text for text in texts), f"line {node.lineno}"


def test_the_errors_have_one_base_and_their_builtin() -> None:
    classes = [c for c in vars(errors).values() if isinstance(c, type) and issubclass(c, Exception)]
    assert all(issubclass(c, errors.KineticError) for c in classes)
    assert issubclass(errors.SceneError, ValueError)
    assert issubclass(errors.SolverStopped, RuntimeError)
    assert issubclass(errors.OutputExistsError, errors.SceneError)
    for kind in classes:
        assert str(pickle.loads(pickle.dumps(kind("one line")))) == "one line"
