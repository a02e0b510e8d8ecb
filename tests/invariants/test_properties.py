"""What (2) has whatever its parameters: conservation, its symmetries, its units, and the limits in which collisions vanish.

Scenes are drawn by hypothesis; the draws are the same in every run. Fields of runs on different grids are compared by their
longest waves in x, which every grid holds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from kinetic_solver import Scene, exact, solve
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions import FollowLeader, Inelastic
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model

RTOL = 1e-4
WAVES = 4
few, several, many = (settings(max_examples=count) for count in (15, 40, 60))
"""Of three accurate runs an example, of one or two, and of operators alone."""
FOLLOW, INELASTIC = "follow-the-leader", "inelastic"


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda value: round(value, 3))


@st.composite
def scenes(draw: st.DrawFn, operators: tuple[str | None, ...] = (FOLLOW, INELASTIC, None), **changes: Any) -> Scene:
    """Extended scenes of all operators, R* up to 1.2, not far from what they relax to. `changes` are tables' keys."""
    friction, noise, density = draw(numbers(0.4, 1.5)), draw(numbers(0.3, 1.5)), draw(numbers(0.3, 2.0))
    operator = draw(st.sampled_from(operators))
    tables: dict[str, dict[str, Any]] = {
        "model": {"gravity": draw(numbers(-2, 2)), "friction": friction, "noise": noise},
        "pipe": {"length": draw(numbers(6, 12))},
        "initial": {
            "density": density,
            "modes": [{"mode": 1, "cos": draw(numbers(0.1, 0.4))}, {"mode": 2, "sin": draw(numbers(-0.3, -0.05))}],
            "mean_velocity": draw(numbers(-1, 1)),
            "temperature": noise * draw(numbers(0.7, 1.5)),
        },
        "run": {"end_time": draw(numbers(0.3, 0.9))},
        "accuracy": {"rtol": RTOL},
        "output": {"f": True, "budgets": False},
    }
    if operator is not None:
        strength = draw(numbers(0.1, 1.2)) * friction / noise**0.5 / density
        tables["collisions"] = {"operator": operator, "cross_section": round(strength, 4)}
        if operator == INELASTIC:
            tables["collisions"]["restitution"] = draw(numbers(0, 0.95))
    for name, table in changes.items():
        tables[name] |= table
    return Scene.model_validate(tables)


def changed(scene: Scene, **changes: Any) -> Scene:
    tables = scene.model_dump(exclude_none=True)
    for name, table in changes.items():
        tables[name] |= table
    return Scene.model_validate(tables)


def waves(run: xr.Dataset, velocity: float = 0.0) -> Array:
    """ρ, ρ(u - V) and ½ρ[(u - V)² + θ] at the end, their longest waves; shape (3, WAVES)."""
    rho, u, theta = (run[name].values[-1] for name in ("density", "mean_velocity", "temperature"))
    moments = np.stack([rho, rho * (u - velocity), 0.5 * rho * ((u - velocity) ** 2 + theta)])
    found = np.fft.rfft(moments, axis=1, norm="forward")[:, :WAVES]
    return np.pad(found, ((0, 0), (0, WAVES - found.shape[1])))


def close(found: Array, expected: Array, rtol: float) -> bool:
    """Each moment to rtol of what it could be: its own largest wave, or √ρe and ρ for the momentum, which may be near 0."""
    rho, momentum, energy = np.abs(expected).max(axis=1)
    scale = np.array([rho, max(momentum, np.sqrt(rho * energy)), energy])
    return bool((np.abs(found - expected) < rtol * scale[:, None]).all())


# -- conservation and positivity


@several
@given(scenes())
def test_mass_is_kept_and_nothing_is_negative(scene: Scene) -> None:
    run = solve(scene)
    assert np.abs(run["mass"] / (scene.initial.density * scene.pipe.length) - 1).max() < 1e-12
    f = run["f"].values
    assert f.min() > -RTOL * f.max()
    assert (run["density"] > 0).all()
    assert (run["temperature"] > 0).all()


@several
@given(scenes((INELASTIC, None), model={"friction": 0.0}))
def test_without_friction_gravity_alone_brings_momentum(scene: Scene) -> None:
    """p = p₀ + gNt to round-off, with (12) and without collisions; energy E₀ + gp₀t + ½g²Nt², less what (12) takes."""
    run, t = solve(scene), scene.run.end_time
    g, mass = scene.model.gravity, float(run["mass"][0])
    (p, after), (energy, then) = run["momentum"].values[[0, -1]], run["energy"].values[[0, -1]]
    scale = np.sqrt(mass * max(energy, then))
    assert abs(after - p - g * mass * t) < 1e-10 * scale
    brought = g * p * t + 0.5 * g * g * mass * t * t
    if scene.law is None:
        assert abs(then - energy - brought) < RTOL * max(energy, then)
    else:
        assert then < energy + brought


# -- symmetries


@several
@given(scenes(), numbers(-3, 3))
def test_galilean_invariance(scene: Scene, velocity: float) -> None:
    """Seen from a frame of velocity -V the same gas has u + V, and is driven by g + γV."""
    t = scene.run.end_time
    moving = changed(
        scene,
        model={"gravity": scene.model.gravity + scene.model.friction * velocity},
        initial={"mean_velocity": (scene.initial.mean_velocity or 0.0) + velocity},
    )
    k = 2 * np.pi / scene.pipe.length * np.arange(WAVES)
    assert close(waves(solve(moving), velocity) * np.exp(1j * k * velocity * t), waves(solve(scene)), 3 * RTOL)


def mirrored(scene: Scene) -> Scene:
    """x → -x, v → -v, g → -g."""
    start = scene.initial
    return changed(
        scene,
        model={"gravity": -scene.model.gravity},
        initial={
            "mean_velocity": -(start.mean_velocity or 0.0),
            "modes": [{"mode": m.mode, "cos": m.cos, "sin": -m.sin} for m in start.modes],
        },
    )


@several
@given(scenes((INELASTIC, None)))
def test_mirror_symmetry_of_12_and_of_no_collisions(scene: Scene) -> None:
    expected = np.conj(waves(solve(scene))) * np.array([[1], [-1], [1]])
    assert close(waves(solve(mirrored(scene))), expected, 3 * RTOL)


@many
@given(st.integers(0, 2**32 - 1), st.integers(16, 60), st.floats(0, 0.95))
def test_the_mirror_turns_6_around_and_leaves_12_alone(seed: int, nv: int, restitution: float) -> None:
    """Rates of any f(v): (6) has no such symmetry, since both particles take the lower velocity; what it does in the mirror is
    what it would with -S."""
    v = np.linspace(-4, 4, nv)
    f = np.random.default_rng(seed).random((2, nv))
    for operator, sign in ((FollowLeader(v, 1.7), -1), (Inelastic(v, 1.7, restitution), 1)):
        rate = operator.rate(f)
        assert np.abs(operator.rate(f[:, ::-1].copy())[:, ::-1] - sign * rate).max() < 1e-12 * np.abs(rate).max()


powers = st.integers(-12, 12)


def in_other_units(scene: Scene, length: float, time: float, number: float) -> Scene:
    """The same scene, its numbers in units that are so many times smaller."""
    speed, model, start = length / time, scene.model, scene.initial
    changes: dict[str, dict[str, Any]] = {
        "model": {
            "gravity": model.gravity * speed / time,
            "friction": model.friction / time,
            "noise": model.noise * speed**2,
        },
        "pipe": {"length": scene.pipe.length * length},
        "initial": {
            "density": start.density * number / length,
            "mean_velocity": (start.mean_velocity or 0.0) * speed,
            "temperature": (start.temperature or 0.0) * speed**2,
        },
        "run": {"end_time": scene.run.end_time * time},
    }
    if scene.law is not None:
        changes["collisions"] = {"cross_section": scene.cross_section / number}
    return changed(scene, **changes)


@several
@given(scenes(), powers, powers, powers)
def test_units_do_not_matter(scene: Scene, length: int, time: int, number: int) -> None:
    """In powers of two, which rounding does not see, the same bits; but for (6), whose gauge takes a logarithm of the density."""
    a, b, n = 2.0**length, 2.0**time, 2.0**number
    run, other = solve(scene), solve(in_other_units(scene, a, b, n))
    for name, unit in (("x", a), ("v", a / b), ("density", n / a), ("temperature", (a / b) ** 2), ("f", n * b / a**2)):
        found, expected = other[name].values / unit, run[name].values
        if scene.operator == FOLLOW:
            assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max(), name
        else:
            assert np.array_equal(found, expected), name


@several
@given(scenes((FOLLOW, None)), powers, powers, powers)
def test_units_do_not_matter_to_the_closed_form(scene: Scene, length: int, time: int, number: int) -> None:
    a, b, n = 2.0**length, 2.0**time, 2.0**number
    x, v = scene.pipe.length * np.arange(9) / 9, np.linspace(-4, 4, 21)
    run, other = exact.solve(scene, x=x, v=v), exact.solve(in_other_units(scene, a, b, n), x=a * x, v=a / b * v)
    for name, unit in (("density", n / a), ("mean_velocity", a / b), ("f", n * b / a**2)):
        assert np.allclose(other[name], unit * run[name], rtol=1e-11, atol=1e-11 * unit * float(np.abs(run[name]).max())), name


# -- limits


@few
@given(scenes((FOLLOW, INELASTIC)))
def test_collisions_vanish_in_proportion_to_their_cross_section(scene: Scene) -> None:
    """S → 0."""
    accurate = changed(scene, accuracy={"rtol": 1e-6})
    free = waves(solve(changed(accurate, collisions={"cross_section": 0.0})))
    small = 0.02 * scene.cross_section
    once, twice = (waves(solve(changed(accurate, collisions={"cross_section": s}))) - free for s in (small, 2 * small))
    assert np.abs(twice - 2 * once).max() < 0.1 * np.abs(twice).max()


@few
@given(scenes((INELASTIC,)))
def test_12_vanishes_in_proportion_to_the_energy_that_a_collision_takes(scene: Scene) -> None:
    """ε → 1: collisions of equal particles then exchange their velocities, and nobody sees it."""
    accurate = changed(scene, accuracy={"rtol": 1e-6})
    free = waves(solve(changed(accurate, collisions={"restitution": 1.0})))
    taken = [(1 - share) ** 0.5 for share in (0.02, 0.04)]
    once, twice = (waves(solve(changed(accurate, collisions={"restitution": restitution}))) - free for restitution in taken)
    assert np.abs(twice - 2 * once).max() < 0.1 * np.abs(twice).max()


# -- reversibility


@many
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(4, 30), st.floats(0, 100))
def test_transport_is_undone_by_reversed_velocities(seed: int, waves: int, nv: int, time: float) -> None:
    """Any f on an odd number of points, to round-off: f(x, v) → f(x - vt, v), v → -v, and again."""
    grid = PhaseSpaceGrid(2 * waves + 1, nv, 7.0, -3.0, 3.0)
    f = np.random.default_rng(seed).random((grid.nx, nv))
    still = Model(gravity=0.0, friction=0.0, noise=0.0)
    transport = LinearStep(grid, still, OrnsteinUhlenbeckKernel(grid, still))
    there = transport(f, time)[:, ::-1].copy()
    assert np.abs(transport(there, time)[:, ::-1] - f).max() < 1e-11


@several
@given(scenes((None,), model={"friction": 0.0, "noise": 0.0}))
def test_flight_is_undone_by_reversed_velocities(scene: Scene) -> None:
    """A whole run without friction, noise and collisions, gravity included: what is thrown up falls down the same way."""
    there = solve(scene)
    reversed_ = there["f"].isel(time=-1, drop=True).isel(v=slice(None, None, -1)).assign_coords(v=-there["v"].values[::-1])
    empty = {name: table for name, table in scene.model_dump(exclude_none=True).items() if name != "initial"}
    back = solve(Scene.model_validate(empty), initial=reversed_)
    start, end = waves(there.isel(time=[0])), waves(back)
    assert close(end, start * np.array([[1], [-1], [1]]), 3 * RTOL)
