"""Pictures of linear theory: what is drawn is what the theory says, and a file is written."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from kinetic_solver import Scene, SceneError
from kinetic_solver.analysis.stability_examples import save_growth, save_moments, save_structure_factors
from kinetic_solver.analysis.stability_figure import save_scene_figure
from kinetic_solver.stability import critical_density, density_gain, growth_rates, structure_factor

MakeScene, Draw = Callable[..., Scene], Callable[..., Figure]
LEADER = {"operator": "follow-the-leader", "cross_section": 2.3}
INELASTIC = {"operator": "inelastic", "cross_section": 3.1, "restitution": 0.6}


def dots(axes: Any, n: int = 0) -> np.ndarray:
    """The values of the n-th series of dots."""
    return np.asarray([line for line in axes.get_lines() if line.get_marker() == "o"][n].get_ydata())


@pytest.mark.parametrize("table", [LEADER, INELASTIC, None], ids=["(6)", "(12)", "no collisions"])
def test_a_scene(make_scene: MakeScene, table: dict[str, Any] | None, draw: Draw) -> None:
    """The dots are the pipe's modes 1 to 8, in units of γ and of the scene's density."""
    scene = make_scene(collisions=table, particles={"count": 2_000}, pipe={"length": 31.0})
    rates, critical, noise = draw(save_scene_figure, scene).axes
    theory = growth_rates(scene)
    assert dots(rates) == pytest.approx(theory["closure_growth_rate"].values / 0.7, rel=1e-9)
    assert dots(rates, 1) == pytest.approx(theory["kinetic_growth_rate"].values / 0.7, rel=1e-9)
    assert dots(noise) == pytest.approx(structure_factor(scene).values, rel=1e-9)
    if scene.operator == LEADER["operator"]:
        assert dots(critical) == pytest.approx([critical_density(scene, n) for n in range(1, 9)], rel=1e-9)
    else:
        assert [text.get_text() for text in critical.texts] == ["the closure has none:\nstable at every density"]
    # The second axis: a density wave of relative amplitude A has |ρ_k|/ρ = A/2, and ⟨|ρ_k|²⟩ = Sρ²/N.
    (amplitude,) = noise.child_axes
    bottom = noise.get_ylim()[0]
    assert amplitude.get_ylim()[0] == pytest.approx(2 * math.sqrt(bottom / 2_000), rel=1e-9)


def test_noise_beyond_linear_theory_is_shown_as_such(make_scene: MakeScene, draw: Draw) -> None:
    """S > N gets a line where S = N; S beyond the largest number is said to be so."""
    noise = draw(save_scene_figure, make_scene(collisions=LEADER | {"cross_section": 4.5}, particles={"count": 2_000})).axes[2]
    assert "S = N, where linear theory ends" in noise.get_legend_handles_labels()[1]
    noise = draw(save_scene_figure, make_scene(collisions=LEADER | {"cross_section": 70.0})).axes[2]
    assert [text.get_text() for text in noise.texts] == ["S(k) > $10^{308}$ where not drawn"]


def test_moments(draw: Draw) -> None:
    """Every closure has a critical density, which grows with M at k* = 1 and for k* → ∞, there above (2/3)√(2(M - 1))."""
    long, short, law = (np.asarray(line.get_ydata()) for line in draw(save_moments).axes[0].get_lines()[:3])
    assert (np.diff(long) > 0).all()
    assert (np.diff(short) > 0).all()
    assert (long[1:] > short[1 : long.size]).all()
    assert (short >= law).all()


def test_structure_factors(draw: Draw) -> None:
    """Towards long waves the curves join the marks of their limits; noise is above that of the ideal gas."""
    for axes in draw(save_structure_factors).axes:
        lines = axes.get_lines()[:-1]
        for curve, mark in zip(lines[::2], lines[1::2], strict=True):
            values = np.asarray(curve.get_ydata())
            assert (np.diff(values) < 0).all()
            assert values[-1] > 1
            assert values[0] == pytest.approx(np.asarray(mark.get_ydata())[0], rel=3e-3)


def test_growth(make_scene: MakeScene, draw: Draw) -> None:
    """Above R* ≈ 2 a wave first grows, and then decays as exp(-k*²γt); in the scene's units as in the picture's."""
    lines = {line.get_label(): line for line in draw(save_growth).axes[0].get_lines()}
    t, gain = (np.asarray(part) for part in lines["R* = 4"].get_data())
    assert gain.max() > 60
    assert np.diff(np.log(gain))[-1] == pytest.approx(-(t[1] - t[0]), rel=1e-2)
    assert np.asarray(lines["R* = 1"].get_ydata()).max() == 1
    # R* = Sρ√σ/γ = 4 and k* = k√σ/γ = 1
    width = math.sqrt(0.5) / 0.7
    scene = make_scene(collisions=LEADER | {"cross_section": 4 / (0.8 * width)}, pipe={"length": 2 * math.pi * width})
    assert gain == pytest.approx(np.sqrt(density_gain(scene, 1, t / 0.7)), rel=1e-9)


def test_what_cannot_be_drawn_or_written_is_refused(make_scene: MakeScene, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"model\.noise = 0"):
        save_scene_figure(make_scene(model={"noise": 0.0}), tmp_path / "scene.png")
    for path in (tmp_path / "no folder" / "a.png", tmp_path / "a.unknown"):
        with pytest.raises(SceneError, match="cannot be written"):
            save_scene_figure(make_scene(), path)
