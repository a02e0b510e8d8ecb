"""What keys a scene may have, as editors and people read it: of every key, and as the code has it."""

from __future__ import annotations

import json
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from kinetic_solver import Scene
from kinetic_solver.scene import shipped
from kinetic_solver.scene.schema import described, keys_table, schema
from kinetic_solver.scene.tables import Model, Pipe

ROOT = Path(__file__).parents[2]
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def whole() -> dict[str, Any]:
    return schema()


def keys(whole: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """(table.key, what is said of it, whether it is required) of every key below the tables of a scene."""
    for name, table in whole["$defs"].items():
        for key, said in table["properties"].items():
            yield f"{name}.{key}", said, key in table.get("required", ())


def test_what_is_shipped_is_current(whole: dict[str, Any]) -> None:
    """After a key has changed: make keys."""
    assert json.loads(files("kinetic_solver").joinpath("scene.schema.json").read_text(encoding="utf-8")) == whole
    assert (ROOT / "docs" / "keys.md").read_text(encoding="utf-8") == keys_table()


def test_every_key_has_a_description_a_unit_and_a_default(whole: dict[str, Any]) -> None:
    for name, said, required in keys(whole):
        assert len(said["description"]) > 8, name
        assert said["description"][0].isupper() or said["description"][0] in "fguεγσθM", name
        assert "[" not in said["description"] or "[grid]" in said["description"], name
        kinds = [part for part in said.get("anyOf", [said]) if part.get("type") != "null"]
        words = all(part.get("type") == "string" for part in kinds)
        assert ("unit" in said) != words, name
        assert required != ("default" in said), name
    for name, said in whole["properties"].items():
        assert len(said["description"]) > 8, name


def test_units_and_texts_are_those_below_the_keys() -> None:
    assert described(Pipe) == {"length": ("L, the period of the pipe.", "length")}
    assert described(Model)["noise"][1] == "length²/time²"


def test_every_key_of_a_scene_is_in_it(whole: dict[str, Any]) -> None:
    assert set(whole["properties"]) == set(Scene.model_fields)
    sections = keys_table().split("\n## ")
    assert len(sections) == 1 + len(Scene.model_fields) + 5
    pipe = next(section for section in sections if section.startswith("[pipe]"))
    assert "**`length`** (number > 0; in length; required)  \nL, the period of the pipe." in pipe
    assert max(len(line) for line in keys_table().splitlines()) <= 130


@pytest.mark.parametrize("path", [*sorted((ROOT / "scenes").glob("*.toml")), shipped("pipe")], ids=lambda path: path.stem)
def test_shipped_scenes_have_no_other_keys(path: Path, whole: dict[str, Any]) -> None:
    for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
        said = whole["properties"][name]
        ref = next(part["$ref"] for part in (said, *said.get("anyOf", ())) if "$ref" in part)
        assert set(table) <= set(whole["$defs"][ref.rpartition("/")[2]]["properties"])


def test_init_writes_it_where_the_template_looks_for_it(command: Command, tmp_path: Path) -> None:
    assert command("init", "--schema", folder=tmp_path).stdout == "wrote scene.schema.json\n"
    assert command("init", folder=tmp_path).returncode == 0
    first = (tmp_path / "scene.toml").read_text(encoding="utf-8").splitlines()[0]
    named = tmp_path / first.removeprefix("#:schema ")
    assert json.loads(named.read_text(encoding="utf-8"))["title"] == "A scene of kinetic-solver"
    assert command("init", "--schema", folder=tmp_path).returncode == 2


def test_init_writes_an_example(command: Command, tmp_path: Path) -> None:
    assert command("init", "--example", "cooling", folder=tmp_path).stdout.startswith("wrote cooling.toml; now: ")
    assert Scene.from_toml(tmp_path / "cooling.toml") == Scene.from_toml(shipped("cooling"))
    assert command("init", "mine.toml", "--example", "pipe", folder=tmp_path).returncode == 0
    assert (tmp_path / "mine.toml").exists()
    wrong = command("init", "--example", "heating", folder=tmp_path)
    assert (wrong.returncode, "allowed: closure, cooling" in wrong.stderr) == (2, True)
    assert command("init", "--example", "pipe", "--schema", folder=tmp_path).returncode == 2
