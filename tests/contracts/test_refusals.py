"""Every refusal of a scene names a key that mends it: what it allows is read from the line, applied to the scene, and run.

A table of scenes that provoke one refusal each, of the grid solver's plan and run, of the closed form and of hydrodynamics.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

import pytest

from kinetic_solver import KineticError, Scene, SceneError, SolverStopped, exact, hydrodynamics, solve
from kinetic_solver.plan import making

BASE: dict[str, Any] = {
    "model": {"gravity": 1.3, "friction": 0.7, "noise": 1.7},
    "pipe": {"length": 11.0},
    "initial": {"density": 1.2, "modes": [{"mode": 1, "cos": 0.4}], "mean_velocity": 0.3, "temperature": 0.9},
    "run": {"end_time": 1.9},
    "accuracy": {"rtol": 1e-3},
    "output": {"budgets": False},
}
FOLLOWING = {"operator": "follow-the-leader", "cross_section": 0.8}
INELASTIC = {"operator": "inelastic", "cross_section": 0.8, "restitution": 0.6}
STEP = {"modes": (), "step": {"from": 0.2, "to": 0.5, "ratio": 3.0}}
HERMITE = {"grid.velocity": "hermite"}
NUMBER = r"-?\d[\d.e+-]*"
MOVED = re.compile(rf"([a-z]+\.\w+)(?: and ([a-z]+\.\w+))? = ({NUMBER}) or (?:more|less|nearer to 0)")
IN_WORDS: dict[str, dict[str, Any]] = {
    "initial.modes in its place": {"initial.step": None, "initial.modes": [{"mode": 2, "sin": 0.3}]},
    "a given grid.nx and grid.nv": {"grid.nx": 101, "grid.nv": 128},
    "a given grid.nx": {"grid.nx": 81},
    "output.f = false": {"output.f": False},
    "'points'": {"grid.velocity": "points"},
    "'kernel'": {"grid.drift_diffusion": "kernel"},
    "'extrapolated'": {"grid.stepping": "extrapolated"},
    "'strang'": {"grid.stepping": "strang"},
    "remove grid.stepping": {"grid.stepping": None},
    "'follow-the-leader'": {"collisions": FOLLOWING},
    "a Maxwellian": {"initial.eigenmodes": (), "initial.file": None},
    "density, modes or step": {"initial.file": None},
    "mean_velocity and temperature": {"initial.beams": ()},
    "modes, velocity_modes": {"initial.eigenmodes": ()},
    "allowed: above 0": {"initial.step.ratio": 0.7},
    "1e-6 or more": {"initial.modes": [{"mode": 1, "cos": 0.9}]},
    "remove it for the closure": {"hydrodynamics.moments": None},
    "an earlier time": {"run.end_time": 1.1},
    "model.noise above 0": {"model.noise": 0.4},
    "no hydrodynamics.moments": {"hydrodynamics.moments": None},
}
"""What a line may allow besides numbers, and what it means for a scene. The first that fits a part of the line is taken."""

PLANNED: dict[str, dict[str, Any]] = {
    "no double holds it": {"model.gravity": 1e100},
    "velocities of extremes": {"initial.temperature": 1e-6},
    "velocities, (6) with many collisions": {"collisions": {**FOLLOWING, "cross_section": 1e3}},
    "velocities, huge noise": {"model.noise": 1e30},
    "what no double holds of the slow, (6)": {"collisions": {**FOLLOWING, "cross_section": 60.0}},
    "velocities that neighbours cannot be told apart": {
        "collisions": FOLLOWING,
        "model.friction": 1e-12,
        "initial.modes": (),
        "initial.mean_velocity": 3e11,
    },
    "turns around the pipe": {"initial.mean_velocity": 1e30},
    "a flow that goes far in v": {"model.gravity": 1e6},
    "a flow that becomes narrow": {"model.noise": 0.0, "run.end_time": 40.0},
    "modes": {"collisions": FOLLOWING, "pipe.length": 1e6},
    "steps": {"collisions": FOLLOWING, "run.end_time": 1e30},
    "steps of (12)": {"collisions": INELASTIC, "pipe.length": 1e-8},
    "output too large": {"output.nx": 60_000, "output.nv": 60_000},
    "grid too large": {"grid.nx": 1_000_001, "grid.nv": 1_000_000, "output.nx": 65, "output.nv": 64},
    "a jump too early": {"initial": {**BASE["initial"], **STEP}, "run.end_time": 1e-5},
    "a jump too early, (6)": {"initial": {**BASE["initial"], **STEP}, "collisions": FOLLOWING, "run.end_time": 1e-5},
    "a jump without noise": {"initial": {**BASE["initial"], **STEP}, "model.noise": 0.0},
    "a jump in the local gauge": {
        "initial": {**BASE["initial"], **STEP},
        "collisions": {**FOLLOWING, "cross_section": 4.0},
        "pipe.length": 30.0,
        "accuracy.rtol": 1e-6,
    },
    "a jump's products, (12)": {
        "initial": {**BASE["initial"], **STEP},
        "collisions": INELASTIC,
        "pipe.length": 90.0,
        "accuracy.rtol": 1e-6,
    },
    "a window beside the flow": {"grid.velocity_window": [5.0, 9.0]},
    "too few points for the start": {"initial.modes": [{"mode": 7, "cos": 0.3}], "grid.nx": 9},
    "Hermite functions, hot": {**HERMITE, "initial.temperature": 9.0},
    "Hermite functions, too cold": {**HERMITE, "initial.temperature": 0.01},
    "Hermite functions, no noise": {**HERMITE, "model.noise": 0.0},
    "Hermite functions, Strang": {**HERMITE, "grid.stepping": "strang", "collisions": FOLLOWING},
    "exact steps of (12)": {"grid.stepping": "exact", "collisions": INELASTIC},
    "finite volumes without noise": {"grid.drift_diffusion": "finite-volume-8", "model.noise": 0.0},
}
RUN: dict[str, dict[str, Any]] = {
    "a start narrower than dv": {"collisions": INELASTIC, "grid.nv": 16, "initial.temperature": 0.05},
    "a flow that becomes narrower than dv": {
        "collisions": {**INELASTIC, "cross_section": 3.0},
        "model.noise": 0.0,
        "grid.nv": 40,
        "grid.velocity_window": [-7.0, 8.0],
        "run.end_time": 1.2,
    },
}
CLOSED: dict[str, dict[str, Any]] = {
    "of (12)": {"collisions": INELASTIC},
    "of a file": {"initial": {"density": 1.2, "file": "state.nc"}},
    "of waves folded too often": {"model.friction": 0.0, "run.end_time": 1e6},
    "of waves of velocity folded too often": {
        "model.friction": 0.0,
        "initial.velocity_modes": [{"mode": 1, "sin": 0.2}],
        "run.end_time": 1e5,
    },
    "without any temperature left": {"model.noise": 0.0, "run.end_time": 1e3},
    "of eigenmodes": {"initial": {"density": 1.2, "eigenmodes": [{"mode": 1, "cos": 0.01}]}},
}
HYDRODYNAMIC: dict[str, dict[str, Any]] = {
    "a file": {"initial": {"density": 1.2, "file": "state.nc"}},
    "beams": {"initial": {"beams": [{"share": 1.0, "mean_velocity": 0.1, "temperature": 0.7}]}},
    "eigenmodes": {"initial": {"density": 1.2, "eigenmodes": [{"mode": 1, "cos": 0.01}]}},
    "a vacuum": {"initial": {**BASE["initial"], "modes": (), "step": {"from": 0.2, "to": 0.5, "ratio": 0.0}}},
    "nearly a vacuum": {"initial": {**BASE["initial"], "modes": [{"mode": 1, "cos": 1.0}]}},
    "a hierarchy of (12)": {"hydrodynamics.moments": 5, "collisions": INELASTIC},
    "a hierarchy from a step": {"initial": {**BASE["initial"], **STEP}, "hydrodynamics.moments": 5},
}
CASES = [
    *((f"plan: {name}", solve, keys) for name, keys in PLANNED.items()),
    *((f"run: {name}", solve, keys) for name, keys in RUN.items()),
    *((f"closed form: {name}", exact.solve, keys) for name, keys in CLOSED.items()),
    *((f"hydrodynamics: {name}", hydrodynamics.solve, keys) for name, keys in HYDRODYNAMIC.items()),
]


def scene_of(keys: dict[str, Any]) -> Scene:
    return Scene.model_validate(BASE).replace(**keys)


def remedies(line: str) -> list[dict[str, Any]]:
    """What a refusal allows, each as keys and values."""
    allowed = line.split(";", 1)[1]
    found = [{key: float(value) for key in (one, other) if key} for one, other, value in MOVED.findall(allowed)]
    if window := re.search(rf"as \[({NUMBER}), ({NUMBER})\]", allowed):
        found.append({"grid.velocity_window": [float(window[1]), float(window[2])]})
    if least := re.search(r"^ allowed: (\d+) or more", allowed):
        found.append({line.split(" ")[0]: int(least[1])})
    if enough := re.search(r"raise grid\.nv to (\d+) or more", allowed):
        found.append({"grid.nv": int(enough[1])})
    if "end the run before (run.end_time)" in allowed and (when := re.match(rf"t = ({NUMBER}):", line)):
        found.append({"run.end_time": 0.5 * float(when[1])})
    rest = MOVED.sub("", allowed)
    for words, keys in IN_WORDS.items():
        if words in rest:
            found.append(keys)
            rest = rest.replace(words, "")
    return found


def refused(run: Callable[[Scene], Any], scene: Scene) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises((SceneError, SolverStopped)) as caught:
            run(scene)
    return str(caught.value)


def changed(scene: Scene, keys: dict[str, Any]) -> Scene:
    whole = {"grid.nx", "grid.nv", "output.nx", "output.nv"}
    return scene.replace(**{key: int(value) if key in whole else value for key, value in keys.items()})


@pytest.mark.parametrize(("run", "keys"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_what_a_refusal_allows_is_allowed(
    run: Callable[[Scene], Any], keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line; at least one remedy in it; each of them, alone, makes a scene that runs. Remedies that cost little are asked
    for, so that this test does."""
    monkeypatch.setattr(making, "PRACTICAL", 0.3)
    scene = scene_of(keys)
    line = refused(run, scene)
    assert "\n" not in line
    found = remedies(line)
    assert found, line
    for remedy in found:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                run(changed(scene, remedy))
            except KineticError as again:
                pytest.fail(f"{line}\nfollowed by {remedy}:\n{again}")
