"""What keys a scene may have, for people and editors: a JSON schema, and a table for the documentation.

Descriptions are the docstrings that stand below the keys in `tables` and `initial`; a unit is what these end with in brackets.
Nothing here is needed for a run: the schema that is shipped, and docs/keys.md, were made by `write`.
Tests: tests/interface/test_schema.py.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from kinetic_solver.scene.scene import Scene
from kinetic_solver.scene.tables import Table

NAME = "scene.schema.json"
"""Of the file that is shipped, in the folder of the package."""
_UNIT = re.compile(r"\s*\[([^]]+)\]$")

_Key = tuple[str, str]
"""Description and unit."""


def described(table: type[Table]) -> dict[str, _Key]:
    """Of each field the text below it, on one line, and its unit: "1" where it ends with none."""
    found: dict[str, _Key] = {}
    for base in reversed([base for base in table.__mro__ if issubclass(base, Table) and base is not Table]):
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for statement, below in zip(body.body, body.body[1:], strict=False):
            is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and is_text:
                text = " ".join(below.value.value.split())  # type: ignore[attr-defined]
                unit = _UNIT.search(text)
                found[statement.target.id] = (_UNIT.sub("", text), unit[1] if unit else "1")
    return found


def schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a scene: of every key a description, its unit, its default."""
    result = Scene.model_json_schema(by_alias=True)
    kinds: dict[str, type[Table]] = {Scene.__name__: Scene, **{kind.__name__: kind for kind in _tables(Scene)}}
    for name, table in {Scene.__name__: result, **result["$defs"]}.items():
        kind = kinds[name]
        table["description"] = " ".join(str(inspect.getdoc(kind)).split())
        texts = described(kind)
        for field, info in kind.model_fields.items():
            key = table["properties"][info.alias or field]
            key.pop("title", None)
            if field not in texts:  # a table, which says itself what it is
                below = next(part for part in _parts(info.annotation) if isinstance(part, type) and issubclass(part, Table))
                key["description"] = " ".join(str(inspect.getdoc(below)).split())
                if len(key.get("allOf", ())) == 1:  # as older versions of pydantic have it
                    key |= key.pop("allOf")[0]
                key.pop("default", None)
                continue
            key["description"], unit = texts[field]
            if _counts(info.annotation):
                key["unit"] = unit
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **result, "title": "A scene of kinetic-solver"}


def _parts(annotation: Any) -> Iterator[Any]:
    yield annotation
    for part in get_args(annotation):
        yield from _parts(part)


def _tables(table: type[Table]) -> Iterator[type[Table]]:
    """The tables below one, and those below them."""
    for info in table.model_fields.values():
        for part in _parts(info.annotation):
            if isinstance(part, type) and issubclass(part, Table):
                yield part
                yield from _tables(part)


def _counts(annotation: Any) -> bool:
    """Whether a key takes numbers, which have a unit, or tables of numbers."""
    return any(part in (int, float) or (isinstance(part, type) and issubclass(part, Table)) for part in _parts(annotation))


WIDTH = 120
"""Characters in a line of docs/keys.md."""


def keys_table() -> str:
    """docs/keys.md: every key of a scene."""
    whole = schema()
    lines = [
        "# Every key of a scene",
        "",
        "Made from the scene's own tables (`make keys`). Units of length, time and number are your own; 1 is a plain",
        'number; "required" has no default. `kinetic-solver init --schema` writes the same as a JSON schema, with which editors',
        "check and complete a scene (its line `#:schema`).",
    ]
    for name, key in whole["properties"].items():
        lines += _section(f"[{name}]", key, whole["$defs"][_table_of(key)])
    for name in ("Mode", "Eigenmode", "DensityStep", "Pulse", "Beam"):
        lines += _section(_WITHIN[name], whole["$defs"][name], whole["$defs"][name])
    return "\n".join(lines) + "\n"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, break_on_hyphens=False, break_long_words=False)


_WITHIN = {
    "Mode": "Of `modes`, `velocity_modes` and `temperature_modes` in [initial]",
    "Eigenmode": "Of `eigenmodes` in [initial]",
    "DensityStep": "Of `step` in [initial]",
    "Pulse": "Of `pulse` in [initial]",
    "Beam": "Of `beams` in [initial]",
}


def _table_of(key: dict[str, Any]) -> str:
    refs = [key, *key.get("anyOf", ())]
    return next(part["$ref"] for part in refs if "$ref" in part).rpartition("/")[2]


def _section(title: str, about: dict[str, Any], table: dict[str, Any]) -> list[str]:
    lines = ["", f"## {title}", "", *_wrapped(about["description"]), ""]
    for name, key in table["properties"].items():
        said = [_kind(key)]
        if key.get("unit", "1") != "1":
            said.append(f"in {key['unit']}")
        if name in table.get("required", ()):
            said.append("required")
        elif key.get("default") not in (None, []):
            said.append(f"default `{json.dumps(key['default'])}`")
        lines += [f"**`{name}`** ({'; '.join(said)})  ", *_wrapped(key["description"]), ""]
    return lines[:-1]


def _kind(key: dict[str, Any]) -> str:
    """What a value may be, in a few words."""
    if "anyOf" in key:
        return ", ".join(dict.fromkeys(_kind(part) for part in key["anyOf"] if part.get("type") != "null"))
    if "enum" in key:
        return ", ".join(f'"{word}"' for word in key["enum"])
    if "const" in key:
        return f'"{key["const"]}"'
    if "$ref" in key:
        return "table"
    if key["type"] == "array":
        return "two numbers" if "prefixItems" in key else "tables"
    bounds = [
        f"{sign} {key[name]:.10g}"
        for name, sign in (("exclusiveMinimum", ">"), ("minimum", "≥"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
        if name in key
    ]
    word = {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}[key["type"]]
    return f"{word} {', '.join(bounds)}".strip()


def write(root: Path) -> None:
    """The shipped schema and docs/keys.md of a checkout."""
    text = json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"
    (root / "kinetic_solver" / NAME).write_text(text, encoding="utf-8")
    (root / "docs" / "keys.md").write_text(keys_table(), encoding="utf-8")
