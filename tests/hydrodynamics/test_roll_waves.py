"""Roll waves of (6) above the critical density: the solver's saturated state is the travelling wave with its sub-shock.

In the frame of a wave of speed c, w = u - c, ρw = Q and, by (4) and (5),

    w' = [(g - γu - Sρθ) w - 2γ(σ - θ)]/(w² - 3θ),    θ' = [2γ(σ - θ) - 2θw']/w.

The gas passes through w² = 3θ smoothly, where the numerator must vanish too, and back again in a shock which conserves mass,
momentum and energy. c, θ at that point and the two ends of the profile follow from the jump's two conditions, the period and
the mean density."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.closure import conserved, primitive
from kinetic_solver.hydrodynamics.gas import Gas
from kinetic_solver.hydrodynamics.lawson import ClosureSteps
from kinetic_solver.scene import Scene

NUMBER, WAVENUMBER = 1.5, 2.0
"""R*, 8 % above R*_c = 1.385 at this k*."""


class RollWave:
    """γ = σ = ρ̄ = 1 and g = S = R*, so that the homogeneous state is at rest."""

    def __init__(self, number: float, period: float, guess: tuple[float, float, float, float]) -> None:
        self.number, self.period = number, period
        found = root(self._misfit, guess, tol=1e-11)
        assert np.abs(found.fun).max() < 1e-9, found.message
        self.speed, theta, self.begin, self.end = found.x
        self.flow, self._before, self._after = self._profile(self.speed, theta, self.begin, self.end)

    def fields(self, x: Array) -> Array:
        """(ρ, u, θ) at x, 0 where the gas becomes supersonic."""
        xi = np.mod(x - self.begin, self.period) + self.begin
        w, theta = np.where(xi < 0, self._before.sol(np.minimum(xi, -1e-4))[:2], self._after.sol(np.maximum(xi, 1e-4))[:2])
        return np.stack([self.flow / w, w + self.speed, theta])

    def _profile(self, c: float, theta: float, begin: float, end: float) -> tuple[float, Any, Any]:
        s, w = self.number, math.sqrt(3 * theta)
        force = 2 * (1 - theta) / w
        flow = (s - (c + w) - force) * w / (s * theta)
        # At the critical point w' = p solves p(d0 + d1 p) = n0 + n1 p, numerator' = p · denominator'; θ' = t0 + t1 p
        t0, t1 = 2 * (1 - theta) / w, -2 * theta / w
        f0, f1 = -s * flow * t0 / w, -1 - s * flow * (t1 / w - theta / w**2)
        n0, n1 = f0 * w + 2 * t0, f1 * w + force + 2 * t1
        d0, d1 = -3 * t0, 2 * w - 3 * t1
        p = float(np.roots([d1, d0 - n1, -n0]).real.max())

        def rate(_: float, y: Array) -> list[float]:
            v, t, _mass = y
            dv = ((s - (c + v) - s * flow * t / v) * v - 2 * (1 - t)) / (v * v - 3 * t)
            return [dv, (2 * (1 - t) - 2 * t * dv) / v, flow / v]

        sides = []
        for to in (begin, end):
            step = math.copysign(1e-4, to)
            start = [w + p * step, theta + (t0 + t1 * p) * step, flow / w * step]
            sides.append(solve_ivp(rate, (step, to), start, "DOP853", rtol=1e-11, atol=1e-13, dense_output=True))
        return flow, sides[0], sides[1]

    def _misfit(self, z: Array) -> list[float]:
        c, theta, begin, end = z
        _, before, after = self._profile(c, theta, begin, end)
        (w0, t0, m0), (w1, t1, m1) = before.y[:, -1], after.y[:, -1]
        momentum, energy = w0 + t0 / w0 - w1 - t1 / w1, w0**2 + 3 * t0 - w1**2 - 3 * t1
        return [momentum, energy, end - begin - self.period, (m1 - m0) / self.period - 1]


@pytest.fixture(scope="module")
def wave() -> RollWave:
    return RollWave(NUMBER, 2 * math.pi / WAVENUMBER, (-1.94, 1.1, -0.53, 2.6))


def steps(nx: int) -> ClosureSteps:
    scene = Scene.model_validate(
        {
            "model": {"gravity": NUMBER},
            "collisions": {"operator": "follow-the-leader", "cross_section": NUMBER},
            "pipe": {"length": 2 * math.pi / WAVENUMBER},
            "run": {"end_time": 1.0},
        }
    )
    return ClosureSteps(Gas.of(scene), scene.pipe.length / nx, math.inf)


def difference(state: Array, wave: RollWave, nx: int) -> float:
    """The density's in L1, at the place where it is least."""
    x = wave.period / nx * np.arange(nx)
    offsets = wave.period * np.arange(0, 1, 1 / 4096)
    rho = primitive(state)[0]
    return float(min(np.abs(wave.fields(x - offset)[0] - rho).mean() for offset in offsets))


def test_the_travelling_wave_is_one(wave: RollWave) -> None:
    """Its speed is near √3 thermal velocities against the gas: slower than the least characteristic, as a shock must be."""
    assert wave.speed == pytest.approx(-1.94173209, abs=1e-7)
    assert np.ptp(wave.fields(np.array([wave.begin, wave.end - 1e-12]))[0]) == pytest.approx(0.170268, abs=1e-5)


def test_the_solver_carries_it(wave: RollWave) -> None:
    """Once around the pipe and a half: of order 1 in L1, and at the speed of the equation."""
    time = 1.5 * wave.period / abs(wave.speed)
    errors = []
    for nx in (64, 128, 256):
        x = wave.period / nx * np.arange(nx)
        state = steps(nx).advance(conserved(*wave.fields(x)), 0.0, time)
        errors.append(float(np.abs(primitive(state)[0] - wave.fields(x - wave.speed * time)[0]).mean()))
    assert 0.7 < 0.5 * math.log2(errors[0] / errors[-1]) < 1.4, errors
    assert errors[-1] < 2e-3


def test_small_waves_grow_into_it(wave: RollWave) -> None:
    nx = 64
    x = wave.period / nx * np.arange(nx)
    state = steps(nx).advance(conserved(1 + 0.08 * np.cos(WAVENUMBER * x), np.zeros(nx), np.ones(nx)), 0.0, 30.0)
    assert difference(state, wave, nx) < 8e-3
    assert np.ptp(primitive(state)[0]) == pytest.approx(0.170268, rel=0.2)
