"""The hard cases of benchmarks/hard_cases.py at tolerances that take about a second each, and what is known of them exactly."""

from __future__ import annotations

import math
from typing import Any

import pytest

from benchmarks import hard_cases
from kinetic_solver import Scene, solve
from kinetic_solver.homogeneous import homogeneous_state

LIMIT = 15.0
"""Seconds that a run may take; its truth twice that."""
SLOW: dict[str, tuple[float, ...]] = {}
"""Left to the benchmark, by tolerance."""
MAY_REFUSE: tuple[str, ...] = ()
"""Where one line that names a key to change will do instead of an answer."""


CHOSEN = [(name, rtol) for name in hard_cases.CASES for rtol in (1e-3, 1e-6) if rtol not in SLOW.get(name, ())]


@pytest.mark.parametrize(("name", "rtol"), CHOSEN)
def test_meets_rtol_or_says_why_not(name: str, rtol: float) -> None:
    """f, density, mean velocity and temperature within rtol in every frame; mass to round-off; budgets closed to rtol; and
    neither noise from numpy nor a closed form that contradicts itself."""
    out = hard_cases.measure(name, rtol, LIMIT, repeat=False)
    assert out.faults == []
    if out.refused and name in MAY_REFUSE:
        assert hard_cases.KEY.search(out.said)
        return
    assert not out.refused, out.said
    assert out.errors, f"nothing to compare with: {out.said} {out.truth}"
    assert out.worst[0] <= 1, out.errors
    assert out.mass_drift < 1e-12
    assert max(out.momentum_residual, out.energy_residual) <= rtol


def homogeneous(restitution: float, cross_section: float, **changes: dict[str, Any]) -> Scene:
    """Of operator (12), g = σ = ρ = 1, γ = 1 unless given."""
    table: dict[str, Any] = {
        "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
        "collisions": hard_cases.inelastic(restitution, cross_section),
        "pipe": {"length": 1.0},
        "output": {"budgets": False},
    }
    return Scene.model_validate(table | changes)


@pytest.mark.parametrize(("restitution", "cross_section"), [(0.0, 100.0), (0.999, 10.0)])
def test_relaxes_to_the_stationary_state(restitution: float, cross_section: float) -> None:
    """From 1.5 times its temperature over 6/γ, when friction alone has left e^-12 of the difference: u = g/γ, and θ as Newton's
    method finds it on velocity points of its own (homogeneous.py)."""
    state = homogeneous_state(homogeneous(restitution, cross_section, run={"end_time": 1.0}))
    assert state is not None
    scene = homogeneous(
        restitution,
        cross_section,
        run={"end_time": 12.0},
        initial={"temperature": 4 * state.temperature},
        accuracy={"rtol": 1e-4},
    )
    last = solve(scene).isel(time=-1, x=0)
    assert float(last["temperature"]) == pytest.approx(state.temperature, rel=1e-3)
    assert float(last["mean_velocity"]) == pytest.approx(1.0, rel=1e-3)
    assert float(last["density"]) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.999])
def test_starts_to_cool_as_haff_says(restitution: float) -> None:
    """Without friction a Maxwellian loses temperature at the rate -2Cρθ^{3/2}, C = S(1 - ε²)/√π, at first (Haff 1983); later
    its shape changes that. Two short times give the rate at 0, with an error of second order in the time."""
    scene = homogeneous(
        restitution, 3.0,
        model={"gravity": 1.0, "friction": 0.0, "noise": 1.0}, initial={"temperature": 0.8},
        run={"end_time": 4e-3, "output_every": 2e-3}, accuracy={"rtol": 1e-9},
    )  # fmt: skip
    theta = solve(scene)["temperature"].values[:, 0]
    rate = (-3 * theta[0] + 4 * theta[1] - theta[2]) / 4e-3
    law = -2 * 3.0 * (1 - restitution**2) / math.sqrt(math.pi) * 0.8**1.5
    assert rate == pytest.approx(law, rel=1e-4, abs=1e-6)
