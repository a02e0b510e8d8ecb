"""The second discretisation of (12) is right by itself: conservation, the rate on a Maxwellian in closed form, elastic limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinetic_solver import Scene, exact
from tests.reference import fourier_inelastic as reference

RHO, U, THETA, S = 1.4, 0.6, 0.8, 0.7


def scene(restitution: float, **keys: object) -> Scene:
    return Scene.model_validate(
        {
            "model": {"gravity": 0.3, "friction": 0.6, "noise": 0.9},
            "collisions": {"operator": "inelastic", "cross_section": S, "restitution": restitution},
            "pipe": {"length": 7.0},
            "initial": {"density": RHO, "mean_velocity": U, "temperature": THETA},
            "run": {"end_time": 0.4},
            **keys,
        }
    )


@pytest.mark.parametrize("restitution", [0.0, 0.55, 0.9])
def test_rate_on_a_maxwellian(restitution: float) -> None:
    """Mass and momentum are kept, and ∫v² C = -2S(1 - ε²)/√π ρ²θ^(3/2)."""
    subject = scene(restitution)
    points = reference.points_for(subject, 0, finer=1.6)
    rate, v = reference.Rate(subject, points), points.v
    f = RHO * np.exp(-((v - U) ** 2) / (2 * THETA)) / math.sqrt(2 * math.pi * THETA)
    change = np.fft.irfft(rate.collisions(np.fft.rfft(f)[None, :])[0], n=points.nv)
    dv = 2 * points.half / points.nv
    energy = -2 * S * (1 - restitution**2) / math.sqrt(math.pi) * RHO**2 * THETA**1.5
    assert abs(change.sum() * dv) < 1e-9
    assert abs(change @ v * dv) < 1e-7
    assert change @ v**2 * dv == pytest.approx(energy, rel=1e-6)


def test_without_collisions_it_is_the_closed_form() -> None:
    """S → 0: transport, friction, noise and gravity."""
    subject = scene(0.5, initial={"density": RHO, "mean_velocity": U, "temperature": THETA, "modes": [{"mode": 1, "cos": 0.4}]})
    subject = subject.replace(**{"collisions.cross_section": 1e-14})
    found = reference.solve(subject, 1e-7, 3)
    v = np.linspace(-1.5, 2.5, 9)
    truth = exact.solve(subject.replace(collisions=None), x=7.0 * np.arange(5) / 5, v=v)
    assert np.abs(found.at(truth["x"].values, v)[-1] - truth["f"].values[-1]).max() < 1e-6 * float(truth["f"].max())
    rho, u, theta = found.moments(truth["x"].values)
    for field, name in ((rho, "density"), (u, "mean_velocity"), (theta, "temperature")):
        assert np.abs(field[-1] - truth[name].values[-1]).max() < 1e-6


def test_too_many_points_are_not_tried() -> None:
    with pytest.raises(reference.OutOfReach):
        reference.solve(scene(0.5, initial={"temperature": 1e-6, "mean_velocity": 0.0}), 1e-5)


def test_harmonics_must_have_room() -> None:
    """Of a start in mode 7 the second harmonic is mode 14, which 8 modes take for mode 3, and the third is all but mode 4."""
    start = {"density": RHO, "mean_velocity": U, "temperature": THETA, "modes": [{"mode": 7, "cos": 0.3}]}
    with pytest.raises(ValueError, match="modes = 20: the start has mode 7; allowed: 21 or more"):
        reference.solve(scene(0.5, initial=start), 1e-5, 20)
