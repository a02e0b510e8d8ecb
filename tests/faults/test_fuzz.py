"""Nearly right scenes and commands: a seeded draw of benchmarks/fuzz.py, and what it found, each with its answer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.fuzz import Answer, here, place, prepare, wrong
from benchmarks.fuzz_cases import Case, case
from kinetic_solver import Scene, SceneError, run_to_file
from kinetic_solver.scene import parse_override

MakeScene = Callable[..., Scene]
SCENE = """
[pipe]
length = 9.0
[initial]
modes = [{ mode = 1, cos = 0.1 }]
[run]
end_time = 0.2
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    prepare(folder)
    return folder


@pytest.mark.parametrize("first", range(20_000, 20_160, 40))
def test_a_draw(files: Path, first: int) -> None:
    for number in range(first, first + 40):
        given = case(number)
        with place(files, given) as folder:
            answer = here(given, folder)
        assert wrong(answer, given.arguments[0]) is None, (number, given.arguments, answer.err[-300:])


def test_cases_are_the_same_every_time_and_of_every_command() -> None:
    assert case(7) == case(7)
    seen = {case(number).arguments[0] for number in range(200)}
    assert seen == {"describe", "run", "stability", "plot", "info", "compare", "figure", "init", "nonsense"}


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (Answer(0, "", "", frozenset({"out.nc"})), None),
        (Answer(2, "", "error: pipe.length: is missing\n", frozenset()), None),
        (Answer(2, "", "Usage: …\n", frozenset()), None),
        (Answer(-1, "", "hangs", frozenset()), "hangs"),
        (Answer(-2, "", "Traceback (most recent call last): …", frozenset()), "a traceback"),
        (Answer(7, "", "", frozenset()), "exit code 7"),
        (Answer(0, "", "warning: overflow encountered in exp\n", frozenset()), "a warning of NumPy's"),
        (Answer(2, "", "error: " + "k" * 2000, frozenset()), "a line that is too long"),
        (Answer(2, "", "error: one\nerror: two\n", frozenset()), "no error in one line"),
        (Answer(2, "", "error: \n", frozenset()), "an error without a word"),
        (Answer(1, "", "error: it fails\n", frozenset()), "fails"),
        (Answer(2, "", "error: no\n", frozenset({"out.nc"})), "left out.nc"),
        (Answer(0, "", "", frozenset({"out.nc.lock"})), "left out.nc.lock"),
    ],
)
def test_what_is_wrong_with_an_answer_is_seen(answer: Answer, problem: str | None) -> None:
    assert wrong(answer, "describe") == problem


def describe(files: Path, scene: bytes, *arguments: str) -> str:
    """The error of a scene that is refused, with exit code 2, in one line."""
    with place(files, Case(0, scene, ("describe", "scene.toml", *arguments))) as folder:
        answer = here(Case(0, scene, ("describe", "scene.toml", *arguments)), folder)
    assert answer.code == 2, answer.err
    assert answer.err.count("\n") == 1
    return answer.err


@pytest.mark.parametrize(
    ("added", "message"),
    [
        (b"z = " + b"[" * 1000 + b"]" * 1000, "not valid TOML: tables or lists hundreds deep"),
        (b"z" + b".a" * 1000 + b" = 1", "; allowed: end_time, output_every"),
        (b"z = " + b"{a=" * 2000 + b"1" + b"}" * 2000, "not valid TOML: tables or lists hundreds deep"),
        (b"k" * 10**6 + b" = 1", "run: unknown key 'kkkkkkkkkkkkkkkkkkkk"),
        (b'end_times = "' + b"k" * 10**6 + b'"', "run: unknown key 'end_times' = 'kkkkkkkkkkkkkk"),
        (b"output_every = " + b"9" * 5000, "not valid TOML: Exceeds the limit"),
        (b"output_every = 1e-200", "run.output_every: 1e-200 is too small; allowed: 1e-100 to 1e+100"),
        (b"[model]\ngravity = -1e200", "model.gravity: -1e+200 is too large; allowed: 0 to 1e+100"),
        (b"[particles]\ntime_step = 1e-101", "particles.time_step: 1e-101 is too small; allowed: 1e-100 to 1e+100"),
        (b"[hydrodynamics]\nmoments = 5000000", "hydrodynamics.moments = 5000000: input should be less than or equal to 1000"),
    ],
    ids=["lists", "keys", "tables", "a long key", "a long text", "digits", "small", "large", "a short step", "moments"],
)
def test_scenes_beyond_all_measure(files: Path, added: bytes, message: str) -> None:
    said = describe(files, SCENE.encode() + added)
    assert message in said
    assert len(said) < 400


def test_numbers_that_may_be_0_may_be_small(make_scene: MakeScene) -> None:
    collisions = {"operator": "inelastic", "cross_section": 1e-200, "restitution": 1e-158}
    assert make_scene(collisions=collisions, model={"gravity": -1e-300}).restitution == 1e-158


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("friction", "model.friction"),
        ("nx", "grid.nx"),
        ("seed", "particles.seed"),
        ("end_time", "run.end_time"),
        ("rtol", "accuracy.rtol"),
        ("σ", "allowed: accuracy, collisions"),
        ("modle", "model"),
    ],
)
def test_a_key_without_its_table(files: Path, key: str, meant: str) -> None:
    assert meant in describe(files, SCENE.encode(), "--set", f"{key}=3").partition("; ")[2]


@pytest.mark.parametrize("text", ["[" * 5000, "a=" + "[" * 5000, "a = " + "9" * 5000])
def test_overrides_beyond_all_measure(text: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_override(text)
    assert len(str(caught.value)) < 300


def test_a_mark_at_the_beginning(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("\ufeff" + SCENE, encoding="utf-8")
    assert Scene.from_toml(tmp_path / "scene.toml").pipe.length == 9.0


def test_a_run_in_place_of_a_scene(command: Any, make_scene: MakeScene, tmp_path: Path) -> None:
    run_to_file(make_scene(run={"end_time": 0.2}), tmp_path / "pipe.nc")
    (tmp_path / "hdf.nc").write_bytes(b"\x89HDF\r\n")
    for name in ("pipe.nc", "hdf.nc"):
        for verb in ("run", "describe"):
            done = command(verb, name, folder=tmp_path)
            assert (done.returncode, done.stderr) == (
                2,
                f"error: {name}: this is a run, and no scene in TOML; allowed: info {name}, or plot {name}\n",
            )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "scene.toml", "-o", "."), "-o .: is a folder; allowed: the name of a file"),
        (("stability", "scene.toml", "--figure", "-o", ""), "-o .: is a folder"),
        (("compare", "a.nc", "a.nc", "--figure", "-o", "."), "-o .: is a folder"),
        (("plot", ""), ".: is a folder"),
        (
            ("run", "scene.toml", "-o", "o" * 300),
            "oooooooooooooooooooo…: is too long a name, 300 letters; allowed: up to 230 bytes",
        ),
        (("run", "scene.toml", "-o", "o" * 300 + "/a.nc"), "is too long a name"),
    ],
    ids=["run", "stability", "compare", "plot", "long", "long folder"],
)
def test_names_that_are_none(command: Any, tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    done = command(*arguments, folder=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert message in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_a_picture_of_numbers_near_the_largest(command: Any, tmp_path: Path) -> None:
    """S(k) of R* = 909 is beyond what numbers can be, and its axis ends there."""
    collisions = '[collisions]\noperator = "follow-the-leader"\ncross_section = 0.9\n[model]\nfriction = 0.0007\nnoise = 0.5\n'
    (tmp_path / "scene.toml").write_text(collisions + SCENE)
    done = command("stability", "scene.toml", "--figure", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "scene-stability.png").stat().st_size > 20_000
