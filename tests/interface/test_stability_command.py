"""`kinetic-solver stability`: the verdict in words, its dataset, a run measured, and what is refused."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene
from kinetic_solver.analysis.describe import describe
from kinetic_solver.stability import critical_density, growth_rates, kinetic_rates, structure_factor
from kinetic_solver.stability.verdict import closure_in_words, linear_theory, verdict

Command = Callable[..., subprocess.CompletedProcess[str]]
SCENE = """
[model]
gravity = 1.3
friction = 0.7
noise = 0.5
[collisions]
operator = "follow-the-leader"
cross_section = 1.7
[pipe]
length = 9.0
[initial]
density = 1.2
modes = [{ mode = 1, cos = 1e-4 }]
[run]
end_time = 12.0
output_every = 0.25
[output]
f = false
budgets = false
[particles]
count = 10000
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


@pytest.fixture
def scene(folder: Path) -> Scene:
    return Scene.from_toml(folder / "scene.toml")


def answer(sections: list[tuple[str, list[str]]], number: int) -> str:
    return " ".join(next(lines for title, lines in sections if title.startswith(f"{number}.")))


def test_the_verdict_answers_each_question(scene: Scene) -> None:
    """Above the closure's critical density: the closure grows, the equation decays, noise is amplified."""
    theory = linear_theory(scene)
    sections = verdict(scene, theory)
    assert critical_density(scene, 2) < scene.initial.density
    assert answer(sections, 1).startswith("Yes: the scene's ρ = 1.2 is above the lowest critical density, ρ_c = 0.784")
    assert answer(sections, 2).startswith("No: every wave decays")
    slowest = kinetic_rates(scene, 1)[0][0].real
    assert f"exp({slowest:.6g} t)" in answer(sections, 2)
    amplitude = 2 * np.sqrt(float(structure_factor(scene, 3)[0]) / 10_000)
    assert float(theory["wave_amplitude"].sel(mode=3)) == pytest.approx(amplitude)
    assert "apparent critical density" in answer(sections, 4)


def test_which_waves_of_the_closure_grow(scene: Scene) -> None:
    """From the first whose own critical density is below the scene's, however short it has to be; one wording in `describe`."""
    for density in (0.79, 1.0, 2.0):
        there = scene.replace(**{"initial.density": density})
        said = " ".join(closure_in_words(there))
        first = next(n for n in range(1, 1000) if critical_density(there, n) < density)
        if first > 1:
            assert f"Waves from mode {first} on grow; " in said
            assert f"ρ_c of mode {first - 1} is {critical_density(there, first - 1):.6g}" in said
        else:
            assert "Every wave of the pipe grows." in said
        rows = dict(dict(describe(there, on_the_grid=False))["Three-moment closure of the paper"])
        assert said == f"{rows['is it unstable?']} {rows['which waves grow']}"
        assert rows["ρ_c of mode 1"].endswith("this wave grows" if first == 1 else "this wave decays")


def test_no_contrast_where_linear_theory_has_left_its_range(scene: Scene) -> None:
    dense = scene.replace(**{"collisions.cross_section": 5.0, "particles.count": 1000})
    sections = dict(verdict(dense, linear_theory(dense)))
    noise = sections["4. What do the fluctuations of N particles look like?"]
    assert noise[0].startswith("With N = 1000 (particles.count) linear theory has left its range: waves are no longer small")
    assert sections["Mode by mode"][2].rstrip().endswith("out of range")


def test_below_the_critical_density_and_without_one(scene: Scene) -> None:
    thin = scene.model_copy(update={"initial": scene.initial.model_copy(update={"density": 0.1})})
    sections = verdict(thin, linear_theory(thin))
    assert answer(sections, 1).startswith("No: the scene's ρ = 0.1 is below the lowest critical density, ρ_c = 0.784")
    inelastic = Scene.model_validate(
        {
            **scene.model_dump(exclude_none=True, by_alias=True),
            "collisions": {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.4},
        }
    )
    theory = linear_theory(inelastic)
    sections = verdict(inelastic, theory)
    assert answer(sections, 1).startswith("No, at no density")
    assert "numerical finding" in answer(sections, 2)
    assert np.isinf(theory["critical_density"].values).all()


def test_the_command_writes_what_it_prints(command: Command, folder: Path, scene: Scene) -> None:
    done = command("stability", "scene.toml", "-o", "theory.nc", "--figure", folder=folder)
    assert done.returncode == 0, done.stderr
    with xr.open_dataset(folder / "theory.nc") as written:
        expected = growth_rates(scene)
        for name in ("critical_density", "closure_growth_rate", "kinetic_growth_rate"):
            assert np.array_equal(written[name].values, expected[name].values)
        assert Scene.model_validate_json(written.attrs["scene"]) == scene
    assert (folder / "theory.png").stat().st_size > 20_000
    assert len(re.findall(r"^ +\d+ +[\d.]+ ", done.stdout, re.MULTILINE)) == 8
    again = command("stability", "scene.toml", "-o", "theory.nc", folder=folder)
    assert again.returncode == 2
    assert "exists already" in again.stderr


def test_a_run_is_measured(command: Command, folder: Path, scene: Scene) -> None:
    assert command("run", "scene.toml", folder=folder).returncode == 0
    done = command("stability", "scene.nc", "-o", "measured.nc", folder=folder)
    assert done.returncode == 0, done.stderr
    assert "What the run did" in done.stdout
    with xr.open_dataset(folder / "measured.nc") as measured:
        first = measured.sel(mode=1)
        s = float(first["growth_rate"]) + 1j * float(first["frequency"])
        assert abs(s - kinetic_rates(scene, 1)[0][0]) <= float(first["uncertainty"]) < 0.02 * abs(s.real)
        assert float(first["closure_growth_rate"]) > 0 > float(first["growth_rate"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "nothing to do"),
        (("scene.toml", "--set", "model.friction=0.0"), "model.friction = 0"),
        (("missing.nc",), "missing.nc: there is no such file"),
        (("missing.toml",), "missing.toml: cannot be read"),
    ],
)
def test_refusals(command: Command, folder: Path, arguments: tuple[str, ...], message: str) -> None:
    done = command("stability", *arguments, folder=folder)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
