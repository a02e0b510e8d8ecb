"""Scenes: conventions pointwise, and every kind of bad input refused with one line."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene, fourier_sum, parse_override

MakeScene = Callable[..., Scene]

BAD: list[tuple[dict[str, Any], str]] = [
    ({"modle": {}}, "unknown key 'modle' = {}; did you mean 'model'?"),
    ({"model": {"frictoin": 1.0}}, "model: unknown key 'frictoin' = 1.0; did you mean 'friction'?"),
    ({"model": {"friction": -1.0}}, "model.friction = -1.0: input should be greater than or equal to 0"),
    ({"model": {"gravity": math.nan}}, "model.gravity = nan: input should be a finite number"),
    ({"model": {"noise": "1"}}, "model.noise = '1': input should be a valid number"),
    (
        {"collisions": {"operator": "inelastic", "cross_section": 1.0, "restitution": 1.5}},
        "collisions.restitution = 1.5: input should be less than or equal to 1",
    ),
    ({"collisions": {"operator": "elastic", "cross_section": 1.0}}, "'follow-the-leader' or 'inelastic'"),
    ({"collisions": {"operator": "inelastic", "cross_section": 1.0}}, "restitution is missing"),
    ({"initial": {"modes": [{"mode": 1, "cos": 1.5}]}}, "modes make the density negative"),
    (
        {"initial": {"pulse": {"at": 0.3, "width": 0.1, "height": 2.0}}},
        "modes and pulse are both given; allowed: one of them",
    ),
    (
        {"initial": {"modes": [], "pulse": {"at": 0.3, "width": 0.1, "height": -1.2}}},
        "pulse height = -1.2 makes the density negative; allowed with width = 0.1: -1 or more",
    ),
    (
        {"initial": {"beams": [{"share": 0.5, "mean_velocity": 0.0, "temperature": 0.2}]}},
        "beams: the shares add up to 0.5; allowed: 1",
    ),
    (
        {"initial": {"beams": [{"share": 1.0, "mean_velocity": 0.0, "temperature": 0.2}], "temperature": 0.3}},
        "beams are given together with temperature; beams have these of their own",
    ),
    ({"initial": {"beams": [{"share": 1.0, "mean_velocity": 0.0}]}}, "initial.beams.0.temperature: is missing"),
    ({"pipe": {"length": 0.0}}, "pipe.length = 0.0: input should be greater than 0"),
    ({"grid": {"velocity_window": [3.0, -3.0]}}, "velocity_window = [3.0, -3.0] is reversed or empty"),
    ({"run": {"end_time": math.inf}}, "run.end_time = inf: input should be a finite number"),
    ({"accuracy": {"rtol": 0.0}}, "accuracy: rtol = 0: allowed: 1e-10 to 0.1"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_scenes_are_refused_in_one_line(make_scene: MakeScene, change: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene(**change)
    line = str(caught.value)
    assert message in line
    assert "\n" not in line


def test_a_scene_is_frozen(make_scene: MakeScene) -> None:
    with pytest.raises(ValidationError):
        make_scene().model.gravity = 2.0  # type: ignore[misc]


def test_toml_and_python_give_the_same_scene(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(
        "[model]\ngravity = 2\n[pipe]\nlength = 3.0\n[run]\nend_time = 1.0\n"
        "[initial]\nstep = { from = 0.2, to = 0.5, ratio = 3.0 }\n"
    )
    expected = {
        "model": {"gravity": 2},
        "pipe": {"length": 3.0},
        "run": {"end_time": 1.0},
        "initial": {"step": {"from": 0.2, "to": 0.5, "ratio": 3.0}},
    }
    assert Scene.from_toml(path) == Scene.model_validate(expected)
    again = Scene.model_validate_json(Scene.from_toml(path).model_dump_json(by_alias=True, exclude_none=True))
    assert again == Scene.model_validate(expected)


@pytest.mark.parametrize("text", ["[model\n", "a = ", "\x00"])
def test_broken_toml(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match="not valid TOML"):
        Scene.from_toml(path)


def test_overrides() -> None:
    assert parse_override("model.gravity=2.5") == ("model.gravity", 2.5)
    assert parse_override("grid.velocity_window=[-1.0, 2.0]") == ("grid.velocity_window", [-1.0, 2.0])
    assert parse_override("collisions.operator=inelastic") == ("collisions.operator", "inelastic")
    with pytest.raises(SceneError, match=r"expected a\.b=value"):
        parse_override("nonsense")


def test_groups(make_scene: MakeScene) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    root = math.sqrt(0.5)
    assert scene.groups.collision_number == pytest.approx(1.7 * 0.8 * root / 0.7, rel=1e-14)
    assert scene.groups.wavenumber == pytest.approx(2 * math.pi / 9.0 * root / 0.7, rel=1e-14)
    assert scene.groups.length == pytest.approx(9.0 * 0.7 / root, rel=1e-14)


def test_elastic_collisions_are_no_collisions(make_scene: MakeScene) -> None:
    assert make_scene(collisions={"operator": "inelastic", "cross_section": 2.0, "restitution": 1.0}).operator is None


def test_frames_are_at_0_every_cadence_and_the_end(make_scene: MakeScene) -> None:
    scene = make_scene(run={"end_time": 1.0, "output_every": 0.3})
    assert scene.times() == pytest.approx([0, 0.3, 0.6, 0.9, 1.0])
    assert make_scene(run={"end_time": 0.3, "output_every": 0.1}).times()[-1] == 0.3
    assert len(make_scene(run={"end_time": 0.3, "output_every": 0.1}).times()) == 4
    assert scene.times(False).size == 0
    assert scene.times(2.0) == pytest.approx([0, 1.0])


@given(
    end=st.floats(1e-3, 1e3),
    ratio=st.floats(1e-2, 3.0),
)
def test_frame_times_increase_and_end_at_the_end(end: float, ratio: float) -> None:
    scene = Scene.model_validate({"pipe": {"length": 1.0}, "run": {"end_time": end, "output_every": end * ratio}})
    times = scene.times()
    assert times[0] == 0
    assert times[-1] == end
    assert np.all(np.diff(times) > 0)


def test_density_modes_pointwise(make_scene: MakeScene) -> None:
    scene = make_scene()
    x = 1.234
    expected = 0.4 * math.cos(2 * math.pi * x / 9) + 0.2 * math.sin(4 * math.pi * x / 9)
    assert float(fourier_sum(scene.initial.modes, x, 9.0)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("number", [np.int64(16), np.int32(16), np.uint8(16), np.array(16)])
def test_numbers_of_numpy_are_numbers(make_scene: MakeScene, number: Any) -> None:
    """However a scene is made, in tables, pairs and lists of tables; what is no whole number still is none."""
    table = {
        "grid": {"nx": number, "velocity_window": (np.float32(-4.5), np.int64(5))},
        "initial": {"density": np.float32(0.5), "modes": [{"mode": np.int64(3), "cos": np.float64(0.25)}]},
        "output": {"budgets": np.bool_(False), "f": np.float32(0.75)},
    }
    scene = make_scene(**table)
    assert scene.grid.nx == 16
    assert type(scene.grid.nx) is int
    assert scene.grid.velocity_window == (-4.5, 5.0)
    assert (scene.initial.density, scene.initial.modes[0].mode) == (0.5, 3)
    assert (scene.output.budgets, scene.output.f) == (False, 0.75)
    one_by_one = {f"{name}.{key}": value for name, keys in table.items() for key, value in keys.items()}
    assert make_scene().replace(**one_by_one) == scene
    assert type(scene.grid)(nx=number, velocity_window=table["grid"]["velocity_window"]) == scene.grid
    with pytest.raises(SceneError, match=r"grid.nx = 16.5: input should be a valid integer"):
        make_scene(grid={"nx": np.float64(16.5)})
