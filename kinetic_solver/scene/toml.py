"""Scenes from TOML, keys set one by one, and pydantic's errors in one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from kinetic_solver.errors import SceneError
from kinetic_solver.scene.tables import LONGEST_SHOWN, shorten

LONGEST_REASON = 200
"""Characters of what the parser says."""
Validated = TypeVar("Validated", bound=BaseModel)


def read(path: str | Path, overrides: dict[str, Any] | None = None) -> dict[str, Any]:
    """The tables of a TOML file with `overrides`, dotted key → value; a relative `initial.file` made relative to the file's
    folder. Raises SceneError."""
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))  # editors of some systems begin a file with a mark
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text file"
        raise SceneError(f"{path}: cannot be read ({reason})") from None
    except (ValueError, RecursionError) as error:  # tomllib's own error is a ValueError, and not the only one
        raise SceneError(f"{path}: not valid TOML: {_reason(error)}") from None
    for dotted, value in (overrides or {}).items():
        _set_dotted(data, dotted, value)
    start = data.get("initial", {}).get("file") if isinstance(data.get("initial"), dict) else None
    if isinstance(start, str):
        data["initial"]["file"] = str(path.parent / start)
    return data


def validated(model: type[Validated], data: dict[str, Any], source: str | Path) -> Validated:
    """The model of these tables. Raises SceneError, one line that begins with the source."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}: {one_line(error)}") from None


def _set_dotted(data: dict[str, Any], dotted: str, value: Any) -> None:
    *parents, last = dotted.split(".")
    table = data
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SceneError(f"{shorten(dotted)}: {shorten(name)} is not a table")
    table[last] = value


def parse_override(text: str) -> tuple[str, Any]:
    """ "a.b=value", with the value in TOML ("0.5", "true", "[1, 2]"); a bare word is taken as text."""
    key, separator, raw = text.partition("=")
    if not separator or not key.strip():
        raise SceneError(f"{shorten(text)}: expected a.b=value")
    try:
        parsed = tomllib.loads(f"value = {raw}")
        if set(parsed) != {"value"}:
            raise SceneError(f"{shorten(text)}: expected one value")
        value = parsed["value"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{shorten(text)}: {_reason(error)}") from None
    return key.strip(), value


def _reason(error: Exception) -> str:
    """Why a text is no TOML, in one short line."""
    if isinstance(error, RecursionError):
        return "tables or lists hundreds deep"
    text = " ".join(str(error).split())
    return text if len(text) <= LONGEST_REASON else text[: LONGEST_REASON - 3] + "..."


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
    if first["loc"][:1] == ("output",) and first["type"] != "value_error":
        message = "input should be false, true, or a time interval greater than 0"
        text = f"{where} = {shorten(first['input'])}: {message}"
    others = len({tuple(map(str, p["loc"][:2])) for p in problems}) - 1
    return text + (f" (and {others} more)" if others > 0 else "")


def _part(name: str) -> str:
    return name if len(name) <= LONGEST_SHOWN else name[: LONGEST_SHOWN - 3] + "..."


def _is_union_branch(part: str) -> bool:
    return part.startswith(("constrained-", "function-", "bool", "float", "tuple["))
