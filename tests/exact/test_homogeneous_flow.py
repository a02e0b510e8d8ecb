"""Homogeneous runs of (12) in velocities that follow them: known states, a second discretisation, closed forms, conservation."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, solve
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.collisions import PairCollisions
from kinetic_solver.operators.homogeneous import HomogeneousFlow, Shape, ShapedCollisions, points
from kinetic_solver.plan import make_plan
from kinetic_solver.scene import Model
from kinetic_solver.stability.scaling import white_noise_state
from kinetic_solver.theory.ornstein_uhlenbeck import transition

HOT, COLD = {"mean_velocity": -0.3, "temperature": 9.0}, {"mean_velocity": 0.2, "temperature": 0.01}
BEAMS = {
    "beams": [
        {"share": 0.3, "mean_velocity": -2.0, "temperature": 0.2},
        {"share": 0.7, "mean_velocity": 1.5, "temperature": 0.05},
    ]
}


def scene(
    cross_section: float,
    restitution: float,
    initial: dict[str, object],
    end: float,
    rtol: float = 1e-7,
    model: tuple[float, float, float] = (0.7, 1.3, 0.6),
    **tables: object,
) -> Scene:
    g, gamma, sigma = model
    law = {"operator": "inelastic", "cross_section": cross_section, "restitution": restitution}
    return Scene.model_validate(
        {
            "model": {"gravity": g, "friction": gamma, "noise": sigma},
            "collisions": law,
            "pipe": {"length": 1.3},
            "initial": {"density": 0.9, **initial},
            "run": {"end_time": end, "output_every": end / 3},
            "accuracy": {"rtol": rtol},
            **tables,
        }
    )


def kurtosis_excess(ds: xr.Dataset) -> float:
    """a2 of the last frame."""
    v, w = ds["v"].values, ds["velocity_distribution"].values[-1]
    c = v - w @ v / w.sum()
    return float((w @ c**4) * w.sum() / (3 * (w @ c**2) ** 2) - 1)


def worst(ds: xr.Dataset, other: xr.Dataset) -> float:
    """The largest difference of f at a frame over the largest f then, or in θ."""
    f, g = ds["f"].values, other["f"].values
    of_f = (np.abs(f - g).max(axis=(1, 2)) / g.max(axis=(1, 2))).max()
    return max(float(of_f), float(np.abs(ds["temperature"] / other["temperature"] - 1).max()))


# (ε, Sρ) at γ = σ = 1: θ and a2, each from two computations that share nothing with this one (tests/exact/test_homogeneous.py).
@pytest.mark.parametrize(
    ("restitution", "rate", "theta", "a2"),
    [(0.0, 1.0, 0.680434509, 0.04815877), (0.5, 1.0, 0.733296232, 0.01993970), (0.5, 10.0, 0.299768893, 0.0443248)],
)
def test_relaxation_ends_in_known_states(restitution: float, rate: float, theta: float, a2: float) -> None:
    """From hot, displaced gas: θ and a2 to 1e-7."""
    final = solve(scene(rate / 0.9, restitution, HOT, 30.0, model=(0.7, 1.0, 1.0)))
    assert float(final["temperature"][-1, 0]) == pytest.approx(theta, abs=1e-8)
    assert kurtosis_excess(final) == pytest.approx(a2, abs=1e-7)
    assert float(final["mean_velocity"][-1, 0]) == pytest.approx(0.7, abs=1e-10)


@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_strong_collisions_end_in_the_white_noise_state(restitution: float) -> None:
    """R* = 1e6, θ falls by 10⁴: θ = (γσ/κSρ)^(2/3) and a2, from which homogeneous states differ by O(θ/σ)."""
    state = white_noise_state(restitution)
    final = solve(scene(1e6 / 0.9, restitution, HOT, 30.0, model=(0.0, 1.0, 1.0), output={"f": False}))
    theta = (1 / (state.cooling_rate * 1e6)) ** (2 / 3)
    assert float(final["temperature"][-1, 0]) == pytest.approx(theta, rel=2 * theta)
    assert kurtosis_excess(final) == pytest.approx(state.kurtosis_excess, abs=3e-4)


@pytest.mark.parametrize("start", [HOT, COLD, BEAMS], ids=["hot", "cold", "beams"])
@pytest.mark.parametrize(("cross_section", "restitution"), [(0.1, 0.2), (3.0, 0.6), (40.0, 0.95)])
def test_against_pairs_of_cells(start: dict[str, object], cross_section: float, restitution: float) -> None:
    """On the way, where nothing is stationary: pairs of cells and Lawson's method share neither C nor steps with it."""
    ours = scene(cross_section, restitution, start, 0.4, 1e-5)
    plan = make_plan(ours)
    assert plan.stepping == "homogeneous"
    found = solve(ours)
    v = found["v"].values
    half = float(v[1] - v[0]) / 2
    same = {"output.nv": v.size, "output.velocity_window": [float(v[0]) - half, float(v[-1]) + half]}
    other = ours.replace(**{"grid.deposit": "quintic", "accuracy.rtol": 3e-6, **same})
    assert make_plan(other).stepping != "homogeneous"
    assert worst(found, solve(other).assign_coords(v=v)) < 1e-5


@pytest.mark.parametrize("start", [COLD, BEAMS], ids=["cold", "beams"])
def test_without_effective_collisions_it_is_the_closed_form(start: dict[str, object]) -> None:
    """Gaussians under friction and noise stay Gaussians; f to 0.1 rtol."""
    weak = scene(1e-300, 0.4, start, 1.1, 1e-8)
    assert make_plan(weak).stepping == "homogeneous"
    found = solve(weak)
    v, worst_error = found["v"].values, 0.0
    parts = start.get("beams", [{"share": 1.0, **start}])
    assert isinstance(parts, list)
    for n, time in enumerate(found["time"].values.tolist()):
        step = transition(weak.model, time)
        f = np.zeros(v.size)
        for part in parts:
            u = part["mean_velocity"] * step.decay + step.velocity_shift
            theta = part["temperature"] * step.decay**2 + step.velocity_variance
            f += 0.9 * part["share"] * np.exp(-((v - u) ** 2) / (2 * theta)) / math.sqrt(2 * math.pi * theta)
        worst_error = max(worst_error, float(np.abs(found["f"].values[n, 0] - f).max() / f.max()))
    assert worst_error < 1e-9


@pytest.mark.parametrize("start", [HOT, COLD, BEAMS], ids=["hot", "cold", "beams"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-7])
def test_errors_stay_far_below_rtol(start: dict[str, object], rtol: float) -> None:
    """Local errors of 0.003 rtol, or 1e-9, add up to less than 0.15 rtol; the reference's tolerance is 1e-10."""
    for cross_section, restitution in ((3.0, 0.5), (100.0, 0.9)):
        found, reference = (solve(scene(cross_section, restitution, start, 0.6, value)) for value in (rtol, 1e-10))
        assert worst(found, reference) < 0.15 * rtol
        assert worst(found, reference) < found["error_estimate"].values[-1] < rtol


@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
def test_conservation_and_budgets(rtol: float) -> None:
    """Mass to round-off; momentum as friction and gravity have it, and energy's books, to what the local errors leave."""
    for start in (HOT, BEAMS):
        found = solve(scene(20.0, 0.3, start, 3.0, rtol))
        mass, energy = found["mass"].values, found["energy"].values
        assert np.abs(mass / mass[0] - 1).max() < 1e-12
        assert mass[0] == pytest.approx(0.9 * 1.3, rel=1e-13)
        assert np.abs(found["momentum_residual"]).max() < max(1e-3 * rtol, 1e-9) * mass[0]
        assert np.abs(found["energy_residual"]).max() < max(1e-2 * rtol, 1e-7) * energy.max()
        assert float(np.abs(found["energy_from_collisions"][-1])) > 0.1 * energy[0]


def test_many_frames_and_long_times() -> None:
    """Once f is at rest nothing is integrated: the same state however far the end, with its budgets."""
    short, long = (solve(scene(5.0, 0.5, HOT, end, 1e-6)) for end in (60.0, 1e9))
    assert worst(short.isel(time=[-1]), long.isel(time=[-1]).assign_coords(time=short["time"][-1:])) < 1e-8
    taken = float(long["energy_from_collisions"][-1] / long["energy_rate_collisions"][-1])
    assert taken == pytest.approx(1e9, rel=1e-6)


def test_rate_and_jacobian() -> None:
    """The rate is that of (2) for f; the Jacobian is its derivative."""
    model, law = Model(gravity=0.0, friction=0.7, noise=0.5), Inelastic(cross_section=1.7, restitution=0.4)
    half, count, width = 10.0, 95, 1.3
    w, xi = points(half, count), 1j * np.pi / half * np.arange(count // 2 + 1)

    def slope(g: np.ndarray) -> np.ndarray:
        return np.asarray(np.fft.irfft(np.fft.rfft(g) * xi, count)) / width

    for even in (True, False):
        values = np.exp(-(w**2) / 2)
        if not even:
            values += 0.3 * np.exp(-((w - 1) ** 2) / 0.8)
            off = float(w @ values) / values.sum()
            values = np.exp(-((w + off) ** 2) / 2) + 0.3 * np.exp(-((w + off - 1) ** 2) / 0.8)
        shape = Shape.of(values, 0.8, 0.0, width, half, even)
        np.testing.assert_allclose(shape.values, values, atol=1e-13)
        flow = HomogeneousFlow(model, law, shape)
        flow.width = width
        y = np.append(shape.waves, np.zeros(3))
        rate = flow.rate(0.0, y)
        assert rate[0] == 0.0  # the mass
        # ∂f/∂t at v = sw is (F' - s'/s ∂(wF))/s; here by pairs of cells and derivatives of the same waves.
        v, f = width * w, 0.8 * values / width
        cells = PairCollisions(v, law, "quintic")
        expected = model.friction * slope(v * f + model.noise * slope(f)) + cells.rate(f[None])[0]
        changed = Shape(rate[: shape.waves.size], even, 1.0, 0.0, 1.0, half).values
        seen = 0.8 * (changed - rate[shape.waves.size] * slope(v * values)) / width
        np.testing.assert_allclose(seen, expected, atol=2e-4 * np.abs(expected).max())
        h = 1e-5
        by_hand = [(flow.rate(0.0, y + h * e) - flow.rate(0.0, y - h * e)) / (2 * h) for e in np.eye(y.size)]
        np.testing.assert_allclose(flow.jacobian(0.0, y), np.array(by_hand).T, atol=1e-5 * np.abs(by_hand).max())


def test_collisions_of_what_is_seen() -> None:
    """C on the run's points, by way of F, against the pairs of cells on three times as many."""
    plan = make_plan(scene(3.0, 0.6, BEAMS, 0.4, 1e-6))
    grid, law = plan.grid, plan.law
    assert isinstance(law, Inelastic)
    f = plan.scales.start.distribution(grid.x, grid.v)
    found = ShapedCollisions(grid, law, 20.0, 801).rate(f)[0]
    fine = np.linspace(grid.v[0] - grid.dv / 3, grid.v[-1] + grid.dv / 3, 3 * grid.nv)
    expected = PairCollisions(fine, law, "quintic").rate(plan.scales.start.distribution(grid.x, fine))[0, 1::3]
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert abs(found.sum()) < 1e-12 * np.abs(found).sum()


def test_what_is_said_of_the_grid_is_kept() -> None:
    """Given points, or a start that is not a sum of Gaussians, take the way that other runs take."""
    for key, value in (("grid.nv", 300), ("grid.deposit", "cubic"), ("grid.stepping", "exponential"), ("grid.nx", 4)):
        assert make_plan(scene(3.0, 0.6, HOT, 0.4).replace(**{key: value})).stepping != "homogeneous"
