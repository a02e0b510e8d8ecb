"""The exponential method about the homogeneous state of (12): order, exact solutions, conservation, and when it is chosen."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError, solve
from kinetic_solver.arrays import Array
from kinetic_solver.laws import PairLaw
from kinetic_solver.plan import make_plan, measured
from kinetic_solver.solver.relaxing import relaxation
from kinetic_solver.solver.representation import collision_operator
from kinetic_solver.solver.scheme import Scheme, assemble
from kinetic_solver.stability import growth_rates
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stepping import Embedded, OneStep, embedded_lawson, krogstad

MakeScene = Callable[..., Scene]
EXPONENTIAL = {"stepping": "exponential"}


def twelve(cross_section: float, restitution: float = 0.5) -> dict[str, Any]:
    return {"operator": "inelastic", "cross_section": cross_section, "restitution": restitution}


def schemes(make_scene: MakeScene) -> tuple[Scheme, Array]:
    """Sρ = 2 of a wave of 50 %, warm and off the mean velocity, on a small grid that is given; in x enough for what products fold
    back to be 1e-9: the exponential method sees them in another frame."""
    grid = {"nx": 21, "nv": 48, "velocity_window": (-4.5, 6.5), **EXPONENTIAL}
    start = {"modes": [{"mode": 1, "cos": 0.5}], "mean_velocity": 0.9, "temperature": 0.8}
    scheme = assemble(make_plan(make_scene(collisions=twelve(2.5), initial=start, grid=grid)))
    return scheme, scheme.representation.start()


def repeated(one: OneStep, f: Array, interval: float, steps: int) -> Array:
    known = None
    for _ in range(steps):
        taken = one(f, interval / steps, known, None)
        f, known = taken.state, taken.rate
    return f


def orders(counts: Sequence[int], errors: Sequence[float]) -> list[float]:
    pairs = zip(itertools.pairwise(counts), itertools.pairwise(errors), strict=True)
    return [math.log(a / b) / math.log(q / p) for (p, q), (a, b) in pairs]


def test_order(make_scene: MakeScene) -> None:
    """Four, against the same grid at many steps of Lawson's method, which takes another form of the kernel."""
    scheme, start = schemes(make_scene)
    assert scheme.operator is not None
    one = krogstad(scheme.operator.rate, relaxation(scheme.plan))
    reference = repeated(one, start, 1.0, 192)
    lawson = repeated(embedded_lawson(scheme.operator.rate, scheme.representation.linear), start, 1.0, 400)
    assert np.abs(lawson - reference).max() < 1e-6 * reference.max()
    steps = (8, 12, 16, 24)
    errors = [float(np.abs(repeated(one, start, 1.0, n) - reference).max()) for n in steps]
    assert all(abs(seen - 4) < 0.3 for seen in orders(steps, errors)), (errors, orders(steps, errors))


def test_the_estimate_and_the_error_of_a_step(make_scene: MakeScene) -> None:
    """Told at once to twenty times, while both fall by four orders of magnitude."""
    scheme, start = schemes(make_scene)
    assert scheme.operator is not None
    method = Embedded(krogstad(scheme.operator.rate, relaxation(scheme.plan)), measured.EXPONENTIAL_SIGNS)
    for h in (0.2, 0.1, 0.05, 0.025):
        found, estimate, _ = method.onward(start, h)
        error = float(np.abs(found - repeated(method.one, start, h, 24)).max())
        assert 1 < estimate / error < 20, (h, estimate / error)


def test_it_sees_the_same_in_every_frame(make_scene: MakeScene) -> None:
    """What only passes by is no change: a wave in a flow of 60√σ, moved on by its way, is that at rest after as many steps."""
    slow = schemes(make_scene)[0]
    speed, plan = 60.0, slow.plan
    model, grid = plan.inner.model, plan.grid
    faster = model.model_copy(update={"gravity": model.gravity + speed * model.friction})
    scene = plan.inner.model_copy(update={"model": faster})
    moving = dataclasses.replace(grid, low=grid.low + speed, high=grid.high + speed)
    fast = dataclasses.replace(plan, scales=dataclasses.replace(plan.scales, scene=scene), grid=moving)
    start, found = slow.representation.start(), []
    for each in (plan, fast):
        operator = collision_operator(each)
        assert operator is not None
        found.append(repeated(krogstad(operator.rate, relaxation(each)), start, 0.7, 3))
    k = grid.wavenumbers[:, None]
    on = np.fft.irfft(np.fft.rfft(found[0], axis=0) * np.exp(-1j * k * speed * 0.7), grid.nx, axis=0)
    assert np.abs(found[1] - on).max() < 1e-10 * on.max()


def test_mass_over_a_thousand_steps(make_scene: MakeScene) -> None:
    scheme, f = schemes(make_scene)
    assert scheme.operator is not None
    later = repeated(krogstad(scheme.operator.rate, relaxation(scheme.plan)), f, 50.0, 1000)
    assert np.abs(later - f).max() > 0.1 * f.max()
    assert abs(later.sum() / f.sum() - 1) < 5e-13


def test_linear_waves_decay_at_the_kinetic_rate() -> None:
    """An eigenmode so weak that it is linear: its density after 3/γ is that of exp(st) to rtol, in a handful of steps."""
    scene = Scene.model_validate(
        {
            "model": {"gravity": 0.4, "friction": 0.7, "noise": 1.2},
            "collisions": twelve(3.0, 0.6),
            "pipe": {"length": 11.0},
            "initial": {"density": 1.3, "eigenmodes": [{"mode": 1, "branch": 0, "cos": 1e-3}]},
            "run": {"end_time": 4.0, "output_every": 2.0},
            "accuracy": {"rtol": 1e-6},
            "grid": EXPONENTIAL,
        }
    )
    theory = growth_rates(scene, modes=[1])
    rate, frequency = (float(theory[f"kinetic_{name}"].values.ravel()[0]) for name in ("growth_rate", "frequency"))
    run = solve(scene)
    waves = np.fft.rfft(run["density"].values, axis=1)[:, 1]
    assert abs(waves[2] / waves[0]) == pytest.approx(math.exp(4.0 * rate), rel=2e-3)
    turn = np.angle(waves[2] / waves[0] * np.exp(-4j * frequency)), np.angle(waves[2] / waves[0] * np.exp(4j * frequency))
    assert min(map(abs, turn)) < 2e-3


@pytest.mark.parametrize(("number", "restitution"), [(10.0, 0.0), (10.0, 0.9)])
def test_homogeneous_relaxation_ends_in_the_known_state(number: float, restitution: float) -> None:
    """θ to 1e-6 and a2 to 5e-6 of the stability theory, which shares nothing with the grid: the window, which holds f down to a
    share of rtol, cuts off a little of the fourth moment."""
    scene = Scene.model_validate(
        {
            "model": {"gravity": 1.0},
            "collisions": twelve(number, restitution),
            "pipe": {"length": 1.0},
            "initial": {"mean_velocity": 0.2, "temperature": 0.9},
            "run": {"end_time": 25.0},
            "accuracy": {"rtol": 1e-7},
            "grid": {"stepping": "exponential"},
        }
    )
    state, run = homogeneous_state(scene), solve(scene)
    assert state is not None
    assert make_plan(scene).stepping == "exponential"
    theta, w = float(run["temperature"][-1, 0]), run["v"].values - float(run["mean_velocity"][-1, 0])
    f = run["f"][-1, 0].values
    assert theta == pytest.approx(state.temperature, abs=1e-6, rel=0)
    assert float(w**4 @ f / f.sum()) / (3 * theta**2) - 1 == pytest.approx(state.kurtosis_excess, abs=5e-6, rel=0)


def test_when_it_is_chosen(make_scene: MakeScene) -> None:
    """For long runs with many collisions; not for few, nor where there is no homogeneous state, or a law of one's own."""
    wave = {"modes": [{"mode": 1, "cos": 0.5}]}
    long = make_plan(make_scene(collisions=twelve(10.0), initial=wave, run={"end_time": 40.0}, accuracy={"rtol": 1e-4}))
    assert long.stepping == "exponential"
    assert "cheaper" in long.reasons["stepping"]
    short = make_plan(make_scene(collisions=twelve(0.3), initial=wave, run={"end_time": 1.0}, accuracy={"rtol": 1e-6}))
    assert short.stepping == "extrapolated"
    assert "dearer" in short.reasons["stepping"]
    known = {"mean_velocity": 0.0, "temperature": 1.0}
    cooling = make_scene(model={"noise": 0.0}, collisions=twelve(10.0), initial=known, run={"end_time": 2.0})
    assert "no friction and noise" in make_plan(cooling).reasons["stepping"]
    own = make_plan(make_scene(initial=known), law=Mine())
    assert own.stepping == "extrapolated"
    assert "inelastic collisions (12) alone" in own.reasons["stepping"]


class Mine(PairLaw):
    """(12) by another name."""

    conserves = ("mass", "momentum")
    cross_section = 2.0

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.25 * r, 0.75 * r


def test_it_is_refused_where_there_is_none(make_scene: MakeScene) -> None:
    given = {"mean_velocity": 0.0, "temperature": 1.0}
    with pytest.raises(SceneError, match=r"grid\.stepping = 'exponential': no friction and noise .*'extrapolated'"):
        make_plan(make_scene(model={"noise": 0.0}, collisions=twelve(2.0), initial=given, grid=EXPONENTIAL))
    follow = {"operator": "follow-the-leader", "cross_section": 1.0}
    with pytest.raises(SceneError, match=r"grid\.stepping = 'exponential': operator follow-the-leader .*'exact'"):
        make_plan(make_scene(collisions=follow, grid=EXPONENTIAL))
