"""Every way of making a scene: the same errors, keys replaced one by one, TOML and back."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError
from kinetic_solver.scene import Initial, Model, shipped

MakeScene = Callable[..., Scene]

WRONG = {"pipe": {"length": -3.0}, "run": {"end_time": 1.0}}


def from_toml(folder: Path) -> Scene:
    (folder / "scene.toml").write_text("[pipe]\nlength = -3.0\n[run]\nend_time = 1.0\n")
    return Scene.from_toml(folder / "scene.toml")


WAYS: dict[str, Callable[[Path], Any]] = {
    "Scene": lambda folder: Scene(**WRONG),  # type: ignore[arg-type]
    "model_validate": lambda folder: Scene.model_validate(WRONG),
    "model_validate_json": lambda folder: Scene.model_validate_json(json.dumps(WRONG)),
    "from_toml": from_toml,
    "replace": lambda folder: Scene.from_toml(shipped("pipe")).replace(**{"pipe.length": -3.0}),
}


@pytest.mark.parametrize("way", WAYS)
def test_what_is_wrong_is_said_likewise(way: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"pipe\.length = -3\.0: input should be greater than 0") as caught:
        WAYS[way](tmp_path)
    assert "\n" not in str(caught.value)


def test_tables_alone_and_what_is_no_table() -> None:
    with pytest.raises(SceneError, match=r"unknown key 'frictoin' = 2\.0; did you mean 'friction'"):
        Model(frictoin=2.0)  # type: ignore[call-arg]
    with pytest.raises(SceneError, match=r"modes\.0\.mode: is missing"):
        Initial(modes=({"cos": 0.1},))  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="input should be a valid dictionary"):
        Scene.model_validate(3)
    with pytest.raises(SceneError, match="JSON"):
        Scene.model_validate_json("{")


def test_replacing_keys(make_scene: MakeScene) -> None:
    """The scene that has the keys from the start; the first one stays as it is."""
    scene = make_scene(collisions={"operator": "inelastic", "cross_section": 1.7, "restitution": 0.4})
    other = scene.replace(**{"collisions.cross_section": 3, "grid.nx": np.int64(31), "initial.temperature": np.float64(0.3)})
    collisions = {"operator": "inelastic", "cross_section": 3, "restitution": 0.4}
    assert other == make_scene(collisions=collisions, grid={"nx": 31}, initial={"temperature": 0.3})
    assert (scene.cross_section, scene.grid.nx) == (1.7, None)
    window = scene.replace(**{"grid.velocity_window": np.array([-4.0, 5.0])})
    assert window.grid.velocity_window == (-4.0, 5.0)


def test_replacing_whole_tables(make_scene: MakeScene) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    assert scene.replace(collisions=None) == make_scene()
    assert make_scene().replace(collisions=scene.collisions) == scene
    assert make_scene().replace(model=Model(gravity=0.9)).model == Model(gravity=0.9)
    assert scene.replace() == scene


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"colisions.cross_section": 3.0}, "unknown key 'colisions' = {'cross_section': 3.0}; did you mean 'collisions'?"),
        ({"model.frictoin": 3.0}, "model: unknown key 'frictoin' = 3.0; did you mean 'friction'?"),
        ({"model.friction": "thick"}, "model.friction = 'thick': input should be a valid number"),
        ({"pipe.length.of": 3.0}, "'pipe.length.of': 'length' is not a table"),
        ({"collisions.cross_section": 3.0}, "collisions.operator: is missing"),
        ({"run.end_time": None}, "run.end_time = None: input should be a valid number"),
    ],
)
def test_what_cannot_be_replaced(make_scene: MakeScene, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene().replace(**keys)
    assert message in str(caught.value)


NAMES = ["pipe", "inelastic", "cooling", "ten_million", "closure", "kramers"]


@pytest.mark.parametrize("name", NAMES)
def test_toml_and_back(name: str, tmp_path: Path) -> None:
    scene = Scene.from_toml(shipped(name))
    path = tmp_path / "again.toml"
    path.write_text(scene.to_toml(), encoding="utf-8")
    assert Scene.from_toml(path) == scene


def test_toml_of_all_kinds_of_values(make_scene: MakeScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables in lists, "from", which is no name in Python, booleans, small numbers, and text with whatever is in it."""
    monkeypatch.chdir(tmp_path)
    changes: dict[str, dict[str, Any]] = {
        "initial": {"modes": (), "step": {"from": 0.1, "to": 0.4, "ratio": 3.0}, "velocity_modes": [{"mode": 2, "cos": 0.1}]},
        "output": {"f": False, "scalars": 1e-3},
        "accuracy": {"rtol": 1e-7},
        "grid": {"velocity_window": (-4.0, 5.5)},
        "units": {"length": "µm", "time": "s"},
    }
    scenes = [make_scene(**changes)]
    scenes += [
        Scene.model_validate({"pipe": {"length": 3}, "run": {"end_time": 1e16}, "initial": {"file": name, "density": 2.5}})
        for name in ('a "b".nc', "back\\slash.nc", "tab\tand\x7f.nc", "ρ.nc")
    ]
    for scene in scenes:
        Path("again.toml").write_text(scene.to_toml(), encoding="utf-8")
        assert Scene.from_toml("again.toml") == scene
