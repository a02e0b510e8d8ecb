"""TOML → Scene → JSON → Scene: the same scene, to the last digit, whatever keys are given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kinetic_solver import Scene

Tables = dict[str, dict[str, Any]]
real = st.floats(-1e3, 1e3)
positive = st.floats(1e-3, 1e3)
count = st.integers(1, 10_000)
relative = st.floats(-0.2, 0.2)


def some(**keys: st.SearchStrategy[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Any of these keys."""
    return st.fixed_dictionaries({}, optional=keys)


def waves(amplitude: st.SearchStrategy[float]) -> st.SearchStrategy[list[dict[str, Any]]]:
    mode = st.fixed_dictionaries({"mode": st.integers(1, 9)}, optional={"cos": amplitude, "sin": amplitude})
    return st.lists(mode, min_size=1, max_size=2)


profile = st.one_of(
    some(modes=waves(relative)),
    st.fixed_dictionaries(
        {"step": st.fixed_dictionaries({"from": st.floats(0, 0.4), "to": st.floats(0.5, 1), "ratio": positive})}
    ),
    st.fixed_dictionaries(
        {"pulse": st.fixed_dictionaries({"at": st.floats(0, 1), "width": st.floats(1e-3, 1), "height": st.floats(0, 1e3)})}
    ),
)
beams = st.tuples(st.sampled_from([0.25, 0.5, 0.625]), real, real, positive, positive).map(
    lambda b: [
        {"share": b[0], "mean_velocity": b[1], "temperature": b[3]},
        {"share": 1 - b[0], "mean_velocity": b[2], "temperature": b[4]},
    ]
)
of_velocities = st.one_of(
    some(mean_velocity=real, temperature=positive, velocity_modes=waves(real), temperature_modes=waves(relative)),
    st.fixed_dictionaries({"beams": beams}),
)
start = st.one_of(
    st.tuples(profile, of_velocities).map(lambda parts: parts[0] | parts[1]),
    st.fixed_dictionaries({"file": st.just('/a folder/ρ "state".nc')}),
)
cadence = st.one_of(st.booleans(), st.floats(0.1, 10))
groups = ("f", "moments", "scalars", "budgets", "moment_equations", "particles")
scenes = st.fixed_dictionaries(
    {
        "pipe": st.fixed_dictionaries({"length": positive}),
        "run": st.fixed_dictionaries({"end_time": st.floats(0.1, 100)}, optional={"output_every": st.floats(0.1, 10)}),
    },
    optional={
        "model": some(gravity=real, friction=st.floats(0, 1e3), noise=st.floats(0, 1e3)),
        "collisions": st.one_of(
            st.fixed_dictionaries({"operator": st.just("follow-the-leader"), "cross_section": positive}),
            st.fixed_dictionaries({"operator": st.just("inelastic"), "cross_section": positive, "restitution": st.floats(0, 1)}),
        ),
        "initial": st.tuples(start, some(density=positive)).map(lambda parts: parts[0] | parts[1]),
        "output": some(**dict.fromkeys(groups, cadence)),
        "accuracy": some(rtol=st.floats(1e-10, 0.1)),
        "grid": some(
            nx=count,
            nv=st.integers(8, 1000),
            velocity_window=st.tuples(st.floats(-9, -1), st.floats(1, 9)).map(list),
            time_step=positive,
            velocity=st.sampled_from(["points", "hermite"]),
            stepping=st.sampled_from(["exact", "extrapolated", "strang"]),
            drift_diffusion=st.sampled_from(["kernel", "finite-volume-8", "finite-volume"]),
            deposit=st.sampled_from(["linear", "cubic", "quintic"]),
        ),
        "particles": some(
            count=count,
            cells=count,
            time_step=positive,
            seed=st.integers(0, 2**63 - 1),
            replicas=count,
            collisions=st.sampled_from(["dsmc", "single-file"]),
        ),
        "hydrodynamics": some(moments=st.integers(3, 50)),
    },
)


def toml(value: Any) -> str:
    """A value in TOML, tables inline: what JSON has no other form for than these."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tables=scenes)
def test_a_scene_comes_back_as_it_was(tmp_path: Path, tables: Tables) -> None:
    path = tmp_path / "scene.toml"
    lines = [
        f"[{name}]\n" + "".join(f"{key} = {toml(value)}\n" for key, value in table.items()) for name, table in tables.items()
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    scene = Scene.from_toml(path)
    assert scene == Scene.model_validate(tables)
    for name, table in tables.items():
        read = getattr(scene, name).model_dump(exclude_unset=True, by_alias=True)
        assert (
            read == {key: value if key != "velocity_window" else tuple(value) for key, value in table.items()}
            or name == "initial"
        )
    for text in (scene.model_dump_json(), scene.model_dump_json(exclude_none=True)):
        assert Scene.model_validate_json(text) == scene
