"""What pydantic says of a wrong scene, as a SceneError of one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pydantic import ValidationError

from kinetic_solver.errors import SceneError

LONGEST_SHOWN = 60
"""Characters of what was given that a message repeats."""


def shorten(value: Any) -> str:
    """repr, cut to the length of a message."""
    try:
        text = repr(value)
    except RecursionError:
        return "(tables or lists hundreds deep)"
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


@contextmanager
def in_one_line() -> Iterator[None]:
    """A ValidationError becomes a SceneError."""
    try:
        yield
    except ValidationError as error:
        raise SceneError(one_line(error)) from None


def one_line(error: ValidationError) -> str:
    """A pydantic error as one line: the key, what was given, what is allowed (the first problem, and how many more)."""
    problems = error.errors()
    first = problems[0]
    where = ".".join(_part(str(part)) for part in first["loc"] if not _is_union_branch(str(part)))
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:].replace("tuple", "pair of numbers")
    if first["type"] == "missing":
        text = f"{where}: is missing"
    elif first["type"] == "value_error":
        text = f"{where}: {message}" if where else message
    else:
        text = f"{where} = {shorten(first['input'])}: {message}"
    if "\n" in text:
        text = " ".join(text.split())
    on_cadence = first["loc"][:1] == ("output",) and not {"nx", "nv", "velocity_window"} & set(first["loc"])
    if on_cadence and first["type"] != "value_error":
        message = "input should be false, true, or a time interval greater than 0"
        text = f"{where} = {shorten(first['input'])}: {message}"
    others = len({tuple(map(str, p["loc"][:2])) for p in problems}) - 1
    return text + (f" (and {others} more)" if others > 0 else "")


def _part(name: str) -> str:
    return name if len(name) <= LONGEST_SHOWN else name[: LONGEST_SHOWN - 3] + "..."


def _is_union_branch(part: str) -> bool:
    return part.startswith(("constrained-", "function-", "bool", "float", "tuple["))
