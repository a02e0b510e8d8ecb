"""Every scene that ships validates, is described, and runs for a short while."""

from __future__ import annotations

from pathlib import Path

import pytest

from kinetic_solver import Scene, SolverStopped, exact, solve
from kinetic_solver.analysis.describe import describe
from kinetic_solver.scene import INELASTIC

FOLDER = Path(__file__).parents[2] / "scenes"
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name: str, **overrides: object) -> Scene:
    return Scene.from_toml(FOLDER / f"{name}.toml", overrides or None)


def test_all_are_here() -> None:
    assert " ".join(NAMES) == "closure cooling inelastic kramers pipe relaxation small sticky subcritical ten_million"


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_described_and_runs(name: str) -> None:
    scene = load(name)
    text = "\n".join(f"{label}: {value}" for _, rows in describe(scene) for label, value in rows)
    assert "steps: " in text
    end = min(0.3, scene.run.end_time)
    short = scene.model_copy(update={"run": type(scene.run)(end_time=end), "output": type(scene.output)()})
    if scene.operator == INELASTIC:
        short = short.model_copy(update={"accuracy": type(scene.accuracy)(rtol=1e-3)})
    run = solve(short)
    assert int(run["status"]) == 1
    if scene.operator != INELASTIC:
        truth = exact.solve(short, x=run["x"], v=run["v"])
        error = float(abs(run["f"] - truth["f"]).max() / truth["f"].max())
        assert error <= short.accuracy.rtol


def test_pipe_lies_above_the_closures_critical_density_and_subcritical_below() -> None:
    from kinetic_solver.stability import critical_density

    assert load("pipe").initial.density > critical_density(load("pipe"), 2)
    assert load("small").initial.density > critical_density(load("small"), 2)
    below = load("subcritical")
    assert all(below.initial.density < critical_density(below, mode) for mode in (1, 2, 10, 1000))


def test_small_decays_as_the_exact_spectrum_says() -> None:
    """Mode 1 falls as exp(-(σ/γ)k²t) once the fast modes are gone, above the closure's critical density."""
    import numpy as np

    scene = load("small")
    run = exact.solve(scene)
    k = 2 * np.pi / scene.pipe.length
    amplitude = np.abs(np.fft.rfft(run["density"].values, axis=1)[:, 1])
    t = run["time"].values
    late = t > 8
    slope = np.polyfit(t[late], np.log(amplitude[late]), 1)[0]
    assert slope == pytest.approx(-(k**2), rel=0.02)


@pytest.mark.filterwarnings("ignore:.*f has become negative")  # the cubic deposit's undershoots come first
def test_cooling_ends_when_it_is_no_longer_resolved() -> None:
    scene = load("cooling", **{"grid.nv": 100})
    with pytest.raises(SolverStopped, match="no longer resolved") as stop:
        solve(scene)
    assert stop.value.dataset.sizes["time"] > 20
