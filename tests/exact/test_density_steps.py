"""Jumps in the initial density, and frames too early for the kernel on the run's own velocity points."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, exact, initial, solve
from kinetic_solver.plan import make_plan
from kinetic_solver.scene import Accuracy, Grid, Output, Run

MakeScene = Callable[..., Scene]
STEP = {"modes": [], "step": {"from": 0.2, "to": 0.45, "ratio": 3.0}}


def follow(cross_section: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": cross_section}


def worst(scene: Scene) -> float:
    """max|Δf|/max f over all frames but the first, at some 150 places."""
    run, found = solve(scene), 0.0
    chosen = slice(None, None, max(1, run.sizes["x"] // 150))
    for time in run["time"].values[1:]:
        truth = exact.Solution(scene, float(time)).distribution(run["x"].values[chosen], run["v"].values)
        found = max(found, float(np.abs(run["f"].sel(time=time).values[chosen] - truth).max() / truth.max()))
    return found


@pytest.mark.parametrize("cross_section", [0.0, 0.6, 2.0])
@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_a_step_against_the_closed_form(make_scene: MakeScene, cross_section: float, rtol: float) -> None:
    scene = make_scene(
        collisions=follow(cross_section), initial=STEP, run={"end_time": 1.5, "output_every": 0.5}, accuracy={"rtol": rtol}
    )
    assert worst(scene) <= rtol
    mass = solve(scene)["mass"].values
    assert np.abs(mass / mass[0] - 1).max() < 1e-12
    assert mass[0] == pytest.approx(0.8 * 9.0, rel=rtol)  # but for what lies beyond the window


def test_the_grid_carries_exact_waves_of_a_step(make_scene: MakeScene) -> None:
    """Fourier coefficients against sums over a million samples, whose own error is 1e-6 of the jump; the mean to round-off."""
    scene = make_scene(initial=STEP)
    x = 9.0 / 45 * np.arange(45)
    waves = np.fft.rfft(initial.resolved_density(scene, x)) / 45
    many = np.fft.rfft(initial.density(scene, 9.0 / 1_000_000 * np.arange(1_000_000))) / 1_000_000
    assert np.abs(waves - many[: waves.size]).max() < 3e-6
    assert waves[0].real == pytest.approx(0.8, rel=1e-15)


def test_what_is_shown_at_time_0_is_the_step_itself(make_scene: MakeScene) -> None:
    run = solve(make_scene(collisions=follow(0.6), initial=STEP, run={"end_time": 0.5}, accuracy={"rtol": 1e-2}))
    outer = 0.8 / (1 + 2 * 0.25)
    assert set(np.round(run["density"].values[0] / outer, 2)) == {1.0, 3.0}


def test_a_step_is_refused_where_it_cannot_be_resolved(make_scene: MakeScene) -> None:
    """By keys, and following what is allowed works."""
    inelastic = {"operator": "inelastic", "cross_section": 0.6, "restitution": 0.5}
    for collisions, pipe, words in (
        (follow(4.0), {"length": 30.0}, r"with initial\.step f is accurate to 5e-05 only"),
        (inelastic, {"length": 60.0}, r"the products of a jump's waves .* would need \S+ modes, more than 2500"),
    ):
        fine = make_scene(collisions=collisions, initial=STEP, pipe=pipe, accuracy={"rtol": 1e-6}, run={"end_time": 2.0})
        with pytest.raises(SceneError, match=rf"accuracy\.rtol: {words}") as refused:
            make_plan(fine)
        found = re.search(r"accuracy\.rtol = (\S+) or more", str(refused.value))
        assert found is not None
        make_plan(fine.model_copy(update={"accuracy": Accuracy(rtol=float(found[1]))}))
    early = make_scene(initial=STEP, run={"end_time": 0.05, "output_every": 1e-4}, accuracy={"rtol": 1e-2})
    with pytest.raises(SceneError, match=r"initial\.step: .* more than 20000 modes at the first frame, t = 0\.0001") as refused:
        solve(early)
    found = re.search(r"run\.output_every = (\S+) or more", str(refused.value))
    assert found is not None
    later = early.model_copy(update={"run": Run(end_time=0.05, output_every=float(found[1])), "output": Output(f=0.05)})
    assert make_plan(later).grid.nx < 40_001


def test_a_step_without_noise_has_moments_but_no_f(make_scene: MakeScene) -> None:
    still = {"gravity": 0.0, "friction": 0.0, "noise": 1.0}
    table = {"initial": {**STEP, "mean_velocity": 0.3, "temperature": 0.7}, "run": {"end_time": 2.0}, "accuracy": {"rtol": 1e-3}}
    with pytest.raises(SceneError, match=r"initial\.step: without noise .* allowed: output\.f = false"):
        solve(make_scene(model=still, **table))
    scene = make_scene(model=still, output={"f": False}, **table)
    run = solve(scene)
    truth = exact.Solution(scene, 2.0).moments(run["x"].values)
    for name, field in zip(("density", "mean_velocity", "temperature"), truth, strict=False):
        assert np.abs(run[name].values[-1] - field).max() < 1e-3 * np.abs(truth[0 if name == "density" else 2]).max()


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_a_step_of_operator_6_is_cut_off_after_its_product(make_scene: MakeScene, rtol: float) -> None:
    """The waves of ρ0 exp(SΦ) are known, so rtol is met at any tolerance, also where ρ0 is a thousand times thinner outside."""
    for ratio in (3.0, 1e3):
        start = {"modes": [], "step": {"from": 0.2, "to": 0.45, "ratio": ratio}}
        scene = make_scene(collisions=follow(0.7), initial=start, run={"end_time": 1.5}, accuracy={"rtol": rtol})
        assert worst(scene) <= rtol


@pytest.mark.parametrize("cross_section", [1.2, 6.5])
def test_early_frames(make_scene: MakeScene, cross_section: float) -> None:
    """A fiftieth of the shortest link and on: R* = 1 and 5.3, both gauges."""
    scene = make_scene(
        collisions=follow(cross_section), run={"end_time": 0.3, "output_every": 0.01}, accuracy={"rtol": 1e-5},
        output={"budgets": False},
    )  # fmt: skip
    assert worst(scene) <= 1e-5


@pytest.mark.parametrize("cross_section", [0.0, 0.9])
def test_totals_of_the_closed_form(make_scene: MakeScene, cross_section: float) -> None:
    """Of a step, on 16 places: the mass, what gravity and friction make of momentum, and at time 0 all three, to 1e-9; a grid run
    agrees as far as its own window goes."""
    scene = make_scene(
        collisions=follow(cross_section), initial={**STEP, "mean_velocity": 0.4, "temperature": 0.6},
        run={"end_time": 1.2}, accuracy={"rtol": 1e-5}, grid={"nx": 16},
    )  # fmt: skip
    truth = exact.solve(scene)
    run = solve(scene.model_copy(update={"grid": Grid()}))
    assert truth["mass"].values == pytest.approx([7.2, 7.2], rel=1e-12)
    assert float(truth["momentum"][0]) == pytest.approx(0.4 * 7.2, rel=1e-12)
    assert float(truth["energy"][0]) == pytest.approx(7.2 * (0.16 + 0.6) / 2, rel=1e-12)
    for name in ("momentum", "energy"):
        assert float(truth[name][1]) == pytest.approx(float(run[name][1]), rel=2e-5)


def test_points_that_show_nothing_are_refused(make_scene: MakeScene) -> None:
    with pytest.raises(
        SceneError, match=r"grid\.velocity_window: from 40 to 50 f is zero everywhere; allowed: velocities between"
    ):
        exact.solve(make_scene(grid={"velocity_window": (40.0, 50.0)}))
    with pytest.raises(SceneError, match=r"grid\.nx: one place does not hold a scene that depends on x"):
        exact.solve(make_scene(grid={"nx": 1}))
