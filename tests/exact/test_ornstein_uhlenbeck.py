"""Statistics of the Ornstein-Uhlenbeck process against integrals of the Langevin equation's response, computed apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import (
    Transition,
    bridge_variance,
    bridge_variances,
    excess_displacement,
    half_transport_time,
    transition,
)


def by_quadrature(model: Model, t: float) -> Transition:
    """Gauss-Legendre quadrature of the response exp(-γs), in panels no longer than 1/γ."""
    g, gamma, sigma = model.gravity, model.friction, model.noise
    nodes, gauss = np.polynomial.legendre.leggauss(24)
    panels = max(1, math.ceil(gamma * t))
    width = t / panels
    s = (width * (np.arange(panels)[:, None] + (nodes + 1) / 2)).ravel()
    w = np.tile(width * gauss / 2, panels)
    response = np.exp(-gamma * s)
    moved = -np.expm1(-gamma * s) / gamma if gamma > 0 else s
    strength = 2 * sigma * gamma
    return Transition(
        decay=math.exp(-gamma * t),
        drift_time=float(w @ response),
        velocity_shift=g * float(w @ response),
        displacement_shift=g * float(w @ moved),
        velocity_variance=strength * float(w @ response**2),
        covariance=strength * float(w @ (moved * response)),
        displacement_variance=strength * float(w @ moved**2),
    )


@pytest.mark.parametrize("friction", [-1e-9, -1e-3, -0.7])
@pytest.mark.parametrize("t", [1e-6, 1e-2, 0.9, 8.0, 40.0])
def test_velocities_that_spread(friction: float, t: float) -> None:
    """Negative friction without noise, of a frame that follows a cooling gas."""
    model = Model(gravity=1.3, noise=0.0).model_copy(update={"friction": friction})
    nodes, weights = np.polynomial.legendre.leggauss(60)
    s = t * (nodes + 1) / 2
    spread = np.exp(-friction * s)
    found = transition(model, t)
    assert found.decay == pytest.approx(math.exp(-friction * t), rel=1e-14)
    assert found.drift_time == pytest.approx(t / 2 * weights @ spread, rel=1e-13)
    assert found.displacement_shift == pytest.approx(1.3 * t / 2 * weights @ ((t - s) * spread), rel=1e-12)
    assert (found.velocity_variance, found.covariance, found.displacement_variance) == (0, 0, 0)
    # tanh is odd: the times of transport do not depend on friction's sign.
    assert half_transport_time(friction, t) == half_transport_time(-friction, t)
    assert excess_displacement(friction, t) == excess_displacement(-friction, t)


@pytest.mark.parametrize("friction", [0.0, 1e-9, 1e-3, 0.7, 3.0])
@pytest.mark.parametrize("t", [1e-6, 1e-2, 0.9, 8.0, 40.0])
def test_every_statistic_to_round_off(friction: float, t: float) -> None:
    model = Model(gravity=1.3, friction=friction, noise=0.5)
    found, expected = transition(model, t), by_quadrature(model, t)
    for name, value in expected._asdict().items():
        assert getattr(found, name) == pytest.approx(value, rel=2e-14, abs=0), name


@pytest.mark.parametrize("friction", [0.0, 0.3, 7.0])
def test_many_bridges_are_as_one_by_one(friction: float) -> None:
    model = Model(gravity=1.3, friction=friction, noise=0.5)
    times = np.geomspace(1e-4, 30.0, 200)
    one_by_one = np.array([bridge_variance(model, h) for h in times.tolist()])
    assert bridge_variances(model, times) == pytest.approx(one_by_one, rel=1e-11)
