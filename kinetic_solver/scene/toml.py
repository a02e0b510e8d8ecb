"""Scenes from TOML and back, and keys set one by one."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from kinetic_solver.errors import SceneError
from kinetic_solver.scene.messages import shorten

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
        set_dotted(data, dotted, value)
    start = data.get("initial", {}).get("file") if isinstance(data.get("initial"), dict) else None
    if isinstance(start, str):
        data["initial"]["file"] = str(path.parent / start)
    return data


def validated(model: type[Validated], data: dict[str, Any], source: str | Path) -> Validated:
    """The model of these tables. Raises SceneError, one line that begins with the source."""
    try:
        return model.model_validate(data)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def set_dotted(data: dict[str, Any], dotted: str, value: Any) -> None:
    """data["a"]["b"] = value for "a.b". Raises SceneError where "a" is no table."""
    *parents, last = dotted.split(".")
    table = data
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SceneError(f"{shorten(dotted)}: {shorten(name)} is not a table")
    table[last] = value


def plain(value: Any) -> Any:
    """A value as TOML knows it: NumPy's numbers and arrays as Python's, a table as a dictionary."""
    if isinstance(value, BaseModel):
        return value.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)
    return of_python(value)


def of_python(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, in lists and pairs too: pydantic takes nothing else for an int."""
    if type(value) in (list, tuple):
        return type(value)(map(of_python, value))
    return value.tolist() if hasattr(value, "tolist") else value


def written(data: dict[str, Any]) -> str:
    """Tables as TOML: keys of their own, each value on one line."""
    parts = []
    for name, table in data.items():
        lines = [f"{key} = {_value(value)}" for key, value in table.items()]
        parts.append("\n".join([f"[{name}]", *lines]))
    return "\n\n".join(parts) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(part)}" for key, part in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, str):
        # JSON's escapes are TOML's too, but for this one character that JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower() if isinstance(value, bool) else repr(value)


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
