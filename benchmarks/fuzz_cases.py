"""Commands and scenes that people, and worse, might type: drawn by a grammar, one from each number.

A case is the text of a scene, which is valid but for some faults (other values, misspelt and unknown keys, tables in place of
numbers, damaged text), and a command, whose arguments are right, wrong, or missing. Nothing in a case takes long to run when it
is right: grids and particles are few, and runs have a wall-clock limit.
"""

from __future__ import annotations

import random
import string
from dataclasses import dataclass
from typing import Any

Tables = dict[str, Any]

NUMBERS = (0, 1, -1, 2, 7, 0.5, -0.0, 1.5, -3.25, 1e-300, 5e-324, 1e-9, 1e9, 1e16, 1e300, 1.7e308, 2**31, 2**63, 10**30)
ODD = (
    float("inf"), float("-inf"), float("nan"), True, False, "", "x", "σ", "1.0", "a" * 1000, "inelastic", "dsmc", "../x",
    "\n", "\0", [], [1.0], [1.0, 2.0], [2.0, 1.0], [-4.0, 4.0], [[]], [{}], {}, {"mode": 1}, [{"mode": 1, "cos": 0.5}],
    [{"mode": 3, "branch": 1, "cos": 1e-3}], [{"mode": 10**6, "cos": 0.1}],
    [{"share": 1.0, "mean_velocity": 0.0, "temperature": 1.0}],
    {"from": 0.2, "to": 0.5, "ratio": 3.0}, {"at": 0.5, "width": 0.05, "height": 3.0}, {"at": 0.5, "width": 1e-3, "height": -1.0},
)  # fmt: skip
"""Of other types, or at the edge of what is allowed."""
FILES = ("state.nc", "particles.nc", "particles.csv", "bad.nc", "empty.nc", "nothing.nc", ".", "scene.toml", "other.nc", "")

BASE: dict[str, Tables] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 0.5},
    "collisions": {"operator": "follow-the-leader", "cross_section": 0.9},
    "pipe": {"length": 9.0},
    "initial": {"density": 0.8, "modes": [{"mode": 1, "cos": 0.3}]},
    "run": {"end_time": 0.2},
    "accuracy": {"rtol": 1e-3},
    "grid": {"nx": 9, "nv": 24},
    "particles": {"count": 200, "replicas": 2, "seed": 3},
}
MORE: dict[str, Tables] = {
    "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6},
    "run": {"end_time": 0.2, "output_every": 0.05},
    "output": {"f": False, "moments": 0.1, "scalars": True, "budgets": True, "moment_equations": True, "particles": True},
    "grid": {"nx": 8, "nv": 40, "velocity_window": [-6.0, 8.0], "time_step": 0.05, "velocity": "points", "stepping": "strang"},
    "particles": {"count": 100, "replicas": 1, "time_step": 0.02, "collisions": "single-file"},
    "hydrodynamics": {"moments": 5},
    "units": {"length": "m", "time": "s", "number": "1"},
    "initial": {"density": 0.8, "mean_velocity": -1.0, "temperature": 0.4, "velocity_modes": [{"mode": 2, "cos": 0.1}],
                "temperature_modes": [{"mode": 1, "cos": 0.1}], "time": 3.0},
}  # fmt: skip
KEYS = sorted({f"{table}.{key}" for tables in (BASE, MORE) for table, keys in tables.items() for key in keys} | {
    "initial.step", "initial.pulse", "initial.beams", "initial.eigenmodes", "initial.file", "grid.drift_diffusion",
    "grid.deposit",
})  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What is typed: the file scene.toml, and the command's arguments."""

    number: int
    scene: bytes
    arguments: tuple[str, ...]


def case(number: int) -> Case:
    """The case of a number: always the same."""
    draw = random.Random(number)
    return Case(number, _scene(draw), tuple(_command(draw)))


def _value(draw: random.Random) -> Any:
    return draw.choice(NUMBERS) if draw.random() < 0.5 else draw.choice(ODD)


def _misspelt(draw: random.Random, word: str) -> str:
    at = draw.randrange(len(word) + 1)
    return draw.choice([word[:at] + draw.choice("xe_ .σ\"'=[") + word[at:], word[:at] + word[at + 1 :], word.upper(), word[::-1]])


def _scene(draw: random.Random) -> bytes:
    tables = {name: dict(table) for name, table in BASE.items()}
    for name in draw.sample(sorted(MORE), draw.choice((0, 0, 1, 2))):
        tables[name] = dict(MORE[name])
    for _ in range(draw.choice((0, 0, 1, 1, 2, 3))):
        _spoil(draw, tables)
    text = "\n".join(_table(name, table) for name, table in tables.items())
    return _damaged(draw, text.encode()) if draw.random() < 0.1 else text.encode()


def _spoil(draw: random.Random, tables: dict[str, Any]) -> None:
    table, key = draw.choice(KEYS).split(".")
    if not isinstance(tables.get(table, {}), dict):
        return
    there = tables.setdefault(table, {})
    kind = draw.random() ** 1.5
    if kind < 0.4 and isinstance(there.get(key), int | float):
        there[key] = type(there[key])(there[key] * 10 ** draw.choice((-6, -3, -1, -0.3, 0.3, 1, 2, 3, 6)))
    elif kind < 0.7:
        there[key] = draw.choice(FILES) if key == "file" else _value(draw)
    elif kind < 0.8:
        there[_misspelt(draw, key)] = _value(draw)
    elif kind < 0.88:
        there.pop(draw.choice(sorted(there)) if there else "", None)
    elif kind < 0.94:
        tables.pop(table, None)
    else:
        tables[_misspelt(draw, table)] = draw.choice([there, _value(draw)])


def _damaged(draw: random.Random, text: bytes) -> bytes:
    """Text that is no TOML any more, mostly."""
    at = draw.randrange(len(text))
    deep = draw.choice((10, 120, 1000, 5000))
    return draw.choice(
        [
            text[:at],
            text[:at] + bytes(draw.randrange(256) for _ in range(4)) + text[at:],
            b"\xef\xbb\xbf" + text,
            text.decode().encode("utf-16"),
            text + text,
            text + b"\nz = " + b"[" * deep + b"]" * deep,
            text + b"\n" + b".".join([b"a"] * deep) + b" = 1",
            text + b"\nz = " + b"{a=" * deep + b"1" + b"}" * deep,
            text + b"\n" + b"k" * draw.choice((1000, 10**6)) + b" = 1",
            text + b'\nz = "' + b"k" * draw.choice((1000, 10**6)) + b'"',
            text + b"\nz = " + b"9" * 5000,
            text[:at] + b"\0" + text[at:],
            b"",
        ]
    )


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value) + '"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(part)}" for key, part in value.items()) + "}"
    return repr(value)


def _key(key: str) -> str:
    return key if key and set(key) <= set(string.ascii_letters + string.digits + "_-") else _toml(key)


def _table(name: str, table: Any) -> str:
    if not isinstance(table, dict):
        return f"[{_key(name)}_]\nvalue = {_toml(table)}\n"
    return f"[{_key(name)}]\n" + "".join(f"{_key(key)} = {_toml(value)}\n" for key, value in table.items())


def _set(draw: random.Random) -> list[str]:
    key = draw.choice([*KEYS, "friction", "nx", "model", "", ".", "a.b.c.d", "model.friction.x", "σ", ".".join("a" * 2000)])
    if draw.random() < 0.2 and key:
        key = _misspelt(draw, key)
    value = draw.choice([_toml(_value(draw)), "", "1e", "[", "x y", "1\n2", "[" * 1500, "--set", "1 # no"])
    return ["--set", draw.choice([f"{key}={value}", f"{key}={value}", f"{key}={value}", key, value])]


def _output(draw: random.Random) -> list[str]:
    odd = ["out", ".", "..", "", "none/out.nc", "scene.toml", "state.nc", "out.png", "o" * 300, "-"]
    name = "out.nc" if draw.random() < 0.9 else draw.choice(odd)
    return ["-o", name] + (["--overwrite"] if draw.random() < 0.3 and name not in ("scene.toml", "state.nc") else [])


def _command(draw: random.Random) -> list[str]:
    scene = "scene.toml" if draw.random() < 0.97 else draw.choice((*FILES, "missing.toml", "--", "-x"))
    command = draw.choices(("describe", "run", "stability", "plot", "info", "compare", "figure", "init", "nonsense"),
                           (40, 30, 8, 5, 4, 7, 2, 2, 2))[0]  # fmt: skip
    sets = [part for _ in range(draw.choice((0, 0, 0, 0, 1))) for part in _set(draw)]
    figure = draw.choice([[], [], [], ["--figure"]])
    number = draw.choice(["0", "1", "-1", "nan", "1e-3", "inf", "x", ""])
    if command == "describe":
        arguments = [scene, *sets]
    elif command == "run":
        method = draw.choice([*("grid", "exact", "particles", "hydrodynamics") * 3, "Grid", ""])
        arguments = [scene, "--method", method, *sets, *_output(draw)]
        if method != "hydrodynamics":
            arguments += ["--max-walltime", number if draw.random() < 0.1 else "0.2"]
        arguments += draw.choice([[], [], ["--format", draw.choice(["netcdf4", "netcdf4", "netcdf4", "x"])]])
        if draw.random() < 0.1:
            arguments.append("--resume")
    elif command == "stability":
        arguments = [draw.choice([scene, "state.nc", "bad.nc"]), *sets, *draw.choice([[], _output(draw)]), *figure]
    elif command == "plot":
        times = draw.choice([[], ["--times", draw.choice(["0", "0,1", number, "0,,1", "1;2", "9" * 400])]])
        arguments = [draw.choice(FILES), *times, *draw.choice([[], _output(draw), ["-o", "p.png"], ["-o", "p.xyz"]])]
    elif command == "info":
        arguments = [draw.choice(FILES)]
    elif command == "compare":
        options = draw.choice([[], ["--level", number], ["--time", number], _output(draw)])
        arguments = [draw.choice(FILES[:4]), draw.choice(FILES), *options, *figure]
    elif command == "figure":
        arguments = [draw.choice(["4", "", "2", "closure"]), "--operator", "nonsense", *draw.choice([[], ["--count", number]])]
    else:
        arguments = draw.choice([[], [draw.choice(FILES)], ["--help"], ["new.toml"]])
    if draw.random() < 0.05:
        arguments.insert(draw.randrange(len(arguments) + 1), draw.choice(["--what", "", "-o", "--set", "x", "--version"]))
    return [command, *arguments]
