"""Particles in CSV: what is read, what a run starts from, what compare makes of them, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError
from kinetic_solver.compare import compare
from particles.files import holds_particles
from particles.plan import make_plan
from particles.simulation import Simulation, simulate
from particles.tables import read_table

MakeScene = Callable[..., Scene]


@pytest.mark.parametrize(
    "text",
    [
        "x,v\n0.5,-1.25\n3,2e-1\n",
        "\ufeffid;Position ;velocity\r\n7;0.5;-1.25\r\n8;3;0.2\r\n",
        '# x\tv\tcolour\n0.5\t-1.25\t"red"\n3\t0.2\t"green"\n',
        "time,x,v\n1.5,0.5,-1.25\n1.5,3,0.2\n",
        "replica,v,x\n2,0.2,3\n1,-1.25,0.5\n",
    ],
    ids=["commas", "semicolons", "tabs", "time", "replicas"],
)
def test_a_table(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8", newline="")
    found = read_table(tmp_path / "a.csv")
    assert found["position"].values.ravel().tolist() == [0.5, 3.0]
    assert found["velocity"].values.ravel().tolist() == [-1.25, 0.2]
    assert found["position"].dims == (("replica", "particle") if "replica" in text else ("particle",))
    assert ("time" in found.coords) == ("time" in text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.5,1.25\n3,0.2\n", "its first line, '0.5,1.25', names no columns x and v; allowed: x,v or position,velocity first$"),
        ("x,speed\n1,2\n", "names no columns x and v"),
        ("x,v\n", "has no particles; allowed: a line for each"),
        ("x,v\n1,two\n", "is no table of numbers .*two"),
        ("x,v\n1,2\n3\n", "is no table of numbers"),
        ("x,v,replica\n1,2,1\n3,4,1\n5,6,2\n", "its replicas have 1 to 2 particles; allowed: the same number each"),
        ("x,v,time\n1,2,0\n3,4,0.5\n", "its times go from 0 to 0.5; allowed: one time in a table"),
        (b"x,v\n1,\xff\n", "is not a text file in UTF-8"),
        (None, "there is no such file"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str | bytes | None, message: str) -> None:
    path = tmp_path / "a.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SceneError, match=message):
        read_table(path)
    assert not holds_particles(path)


def test_a_run_starts_from_a_table_and_is_compared_with_it(make_scene: MakeScene, tmp_path: Path) -> None:
    """One that was written from a run's particles is no different from the run; one that is shifted in v by a fifth is."""
    scene = make_scene(particles={"count": 3000, "replicas": 1}, output={"particles": True})
    run = simulate(scene)
    x, v = (run[name].values[-1, 0] for name in ("position", "velocity"))
    for name, shift in (("same", 0.0), ("other", 0.2)):
        np.savetxt(tmp_path / f"{name}.csv", np.stack([x + 18.0, v + shift], axis=1), delimiter=",", header="x,v", comments="")
    found = compare(run, tmp_path / "same.csv")
    assert not found.differ
    assert "3000 particles, one ensemble, positions of 3000 outside the pipe taken modulo its period" in found.sides[1]
    assert compare(run, tmp_path / "other.csv").differ
    data = make_scene().model_dump(exclude_none=True, exclude_unset=True)
    again = Scene.model_validate({**data, "initial": {"density": 0.8, "file": str(tmp_path / "same.csv")}})
    with pytest.warns(UserWarning, match="3000 of its 3000 positions lie outside"):
        plan = make_plan(again)
    start = Simulation(plan).state()
    assert start["x"][0] == pytest.approx(x, abs=1e-13)
    assert np.array_equal(start["v"][0], v)
