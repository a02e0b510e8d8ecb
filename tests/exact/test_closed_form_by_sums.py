"""The closed form against a slow twin: plain sums over starting points in long double, on panels narrower than anything in the
integrand, from offsets that hold all their digits; E by parts. Early times, weak noise, streams that have met, steep
temperatures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kinetic_solver import initial
from kinetic_solver.exact import Solution, nearby, uniform
from kinetic_solver.scene import Modes, Scene
from kinetic_solver.theory.ornstein_uhlenbeck import transition

LD = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(LD).eps > 2e-19, reason="long double is no wider than double on this machine")
TURN = 8 * np.arctan(LD(1))
ORDER = 16


def rule() -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights in long double, by Newton's method from those in double."""
    z = np.polynomial.legendre.leggauss(ORDER)[0].astype(LD)
    for _ in range(4):
        before, last = np.ones_like(z), z
        for n in range(2, ORDER + 1):
            before, last = last, ((2 * n - 1) * z * last - (n - 1) * before) / n
        slope = ORDER * (z * last - before) / (z * z - 1)
        z = z - last / slope
    return z, 2 / ((1 - z * z) * slope**2)


def fourier(modes: Modes, y: np.ndarray, length: LD, order: int) -> np.ndarray:
    """The sum (order 0), its derivative (1), or its integral from 0 (-1)."""
    total = np.zeros_like(y)
    for m in modes:
        k = TURN * m.mode / length
        c, s, cos, sin = LD(m.cos), LD(m.sin), np.cos(k * y), np.sin(k * y)
        total += {0: c * cos + s * sin, 1: k * (s * cos - c * sin), -1: (c * sin + s * (1 - cos)) / k}[order]
    return total


class Twin:
    """Sums at one time."""

    def __init__(self, scene: Scene, time: float) -> None:
        self.scene, self.step, self.beams = scene, transition(scene.model, time), initial.beams(scene)
        start, k, s = scene.initial, self.step, scene.cross_section
        swing_u, swing_theta = (
            sum(math.hypot(m.cos, m.sin) for m in modes) for modes in (start.velocity_modes, start.temperature_modes)
        )
        hot, cold = max(t for _, _, t in self.beams) * (1 + swing_theta), min(t for _, _, t in self.beams) * (1 - swing_theta)
        wide = math.sqrt(hot * k.drift_time**2 + k.displacement_variance)
        dense = float(initial.density(scene, scene.pipe.length * np.arange(4096) / 4096).max())
        self.low = -k.drift_time * (max(u for _, u, _ in self.beams) + swing_u) - 13 * wide
        self.high = -k.drift_time * (min(u for _, u, _ in self.beams) - swing_u) + 13 * wide + s * dense * wide**2
        most = max((m.mode for m in (*start.modes, *start.velocity_modes, *start.temperature_modes)), default=1)
        steep = 1 + k.drift_time * swing_u * 2 * math.pi * most / scene.pipe.length
        narrow = math.sqrt(cold * k.drift_time**2 + k.displacement_variance) / 2 / steep
        e, b, c, d, r = k.decay, k.drift_time, k.covariance, k.velocity_variance, k.displacement_variance
        self.place, self.noise = max(0.0, b * b * d + e * e * r - 2 * b * e * c), max(0.0, r * d - c * c)
        of_f = math.sqrt((cold * self.place + self.noise) / (cold * e * e + d))
        self.reach = 13 * math.sqrt(self.place) / e + s * dense * self.place / e**2
        waves = [scene.pipe.length / most / 12, 1 / (s * dense + 1e-9)]
        if start.pulse is not None:
            waves.append(start.pulse.width * scene.pipe.length / 2)
        self.width, self.width_of_f = ((1 - swing_theta) * min(w, *waves) for w in (narrow, min(narrow, of_f)))
        self.origin = k.velocity_shift + self.beams[0][1] * e

    def at(self, x: float, v: float | None) -> list[float]:
        """[ρ, u, θ] at x, and f at (x, v)."""
        (m0, m1, m2), scale = self._sums(x, None, self.low, self.high, self.width)
        u = m1 / m0
        found = [m0 / scale, self.origin + u, m2 / m0 - u**2]
        if v is not None:
            start = -self.step.drift_time / self.step.decay * (v - self.step.velocity_shift)  # without noise
            low, high = max(self.low, start - self.reach), min(self.high, start + self.reach)
            found.append(self._sums(x, v, low, high, self.width_of_f)[0][0] / scale)
        return [float(value) for value in found]

    def _sums(self, x: float, v: float | None, low: float, high: float, width: float) -> tuple[list[LD], LD]:
        """Moments of F about the origin, or F at v; and E."""
        start, k, length = self.scene.initial, self.step, LD(self.scene.pipe.length)
        s, mean, place = LD(self.scene.cross_section), LD(start.density), LD(x) - LD(k.displacement_shift)
        e, b, c, r = LD(k.decay), LD(k.drift_time), LD(k.covariance), LD(k.displacement_variance)
        assert (high - low) / width < 4e4, "too many panels for a test"
        edges = LD(low) + LD(width) * np.arange(int((high - low) / width) + 2)
        if start.step is not None:
            periods = np.arange(-20, 21) + math.floor(place / length)
            jumps = [
                length * (periods + LD(end)) - LD(x) + LD(k.displacement_shift) for end in (start.step.start, start.step.end)
            ]
            edges = np.concatenate([edges, *jumps])
            edges = np.sort(edges[(edges >= LD(low)) & (edges <= LD(high))])
        z, weights = rule()
        middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
        offset, quadrature = middle[:, None] + half[:, None] * z, half[:, None] * weights
        y = place + offset
        rho, phi = self._density(y, place + middle)
        sums, scale = np.zeros(3, LD), LD(0)
        for share, u0, theta0 in self.beams:
            u = LD(u0) + fourier(start.velocity_modes, y, length, 0)
            theta = LD(theta0) * (1 + fourier(start.temperature_modes, y, length, 0))
            xx, xv = theta * b * b + r, theta * b * e + c
            vv, apart = (theta * LD(self.place) + LD(self.noise)) / xx, -offset - u * b
            kernel = LD(share) * np.exp(s * (phi - mean * LD(x)) - apart**2 / (2 * xx)) / np.sqrt(TURN * xx) * quadrature
            means = LD(k.velocity_shift) - LD(self.origin) + u * e + xv / xx * apart
            if v is None:
                parts = [rho, rho * means, rho * (means**2 + vv)]
            else:
                parts = [rho * np.exp(-((LD(v) - LD(self.origin) - means) ** 2) / (2 * vv)) / np.sqrt(TURN * vv)]
            sums[: len(parts)] += [(kernel * part).sum() for part in parts]
            du, dtheta = (fourier(modes, y, length, 1) for modes in (start.velocity_modes, start.temperature_modes))
            scale += (kernel * (1 + b * du + apart * b * b * LD(theta0) * dtheta / (2 * xx))).sum()
        return list(sums), scale if s > 0 else LD(1)

    def _density(self, y: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ρ0 and Φ0; of a step ρ0 is that in the middle of a panel."""
        start, length, mean = self.scene.initial, LD(self.scene.pipe.length), LD(self.scene.initial.density)
        if start.step is not None:
            ratio, first, last = LD(start.step.ratio), LD(start.step.start), LD(start.step.end)
            outer = mean / (1 + (ratio - 1) * (last - first))
            of_panel = middle / length - np.floor(middle / length)
            rho = outer * np.where((of_panel >= first) & (of_panel < last), ratio, LD(1))[:, None] + 0 * y
            at = y / length - np.floor(y / length)
            return rho, length * (
                mean * np.floor(y / length) + outer * (at + (ratio - 1) * np.clip(at - first, LD(0), last - first))
            )
        if start.pulse is not None:
            assert self.scene.cross_section == 0, "Φ0 is not here"
            pulse = start.pulse
            near = y / length - LD(pulse.at)
            near -= np.round(near)
            gaussians = sum(np.exp(-(((near - m) / LD(pulse.width)) ** 2) / 2) for m in (-1, 0, 1))
            whole = 1 + LD(pulse.height) * LD(pulse.width) * np.sqrt(TURN)
            return mean * (1 + LD(pulse.height) * gaussians) / whole, np.zeros_like(y)
        return mean * (1 + fourier(start.modes, y, length, 0)), mean * (y + fourier(start.modes, y, length, -1))


BEAMS = {
    "mean_velocity": None,
    "temperature": None,
    "beams": [
        {"share": 0.4, "mean_velocity": -1.0, "temperature": 0.3},
        {"share": 0.6, "mean_velocity": 0.7, "temperature": 1.2},
    ],
}
STARTS: dict[str, dict[str, Any]] = {
    "uniform": {},
    "beams": BEAMS,
    "step": {"modes": [], "step": {"from": 0.25, "to": 0.5, "ratio": 3.0}},
    "varied": {"velocity_modes": [{"mode": 2, "cos": -0.9}], "temperature_modes": [{"mode": 3, "sin": 0.9}]},
    "varied, with a step": {
        "modes": [],
        "step": {"from": 0.25, "to": 0.5, "ratio": 0.2},
        "velocity_modes": [{"mode": 1, "sin": 0.6}],
        "temperature_modes": [{"mode": 2, "cos": 0.5}],
    },
}


def worst(scene: Scene, time: float) -> float:
    """Of ρ, u, θ and, with noise, f, over their largest values (u's also over √θ)."""
    x = scene.pipe.length * np.arange(8) / 8
    solution = Solution(scene, time)
    rho, u, theta, _ = solution.moments(x)
    reach = 5 * math.sqrt(theta.max())
    v = np.linspace(u.min() - reach, u.max() + reach, 48)
    f = solution.distribution(x, v)
    scales = [rho.max(), max(np.abs(u).max(), math.sqrt(theta.max())), theta.max(), f.max()]
    noisy = scene.model.friction * scene.model.noise > 0
    errors, twin = [], Twin(scene, time)
    for i, j in ((2, 20), (5, int(f[5].argmax()))):
        truth = twin.at(float(x[i]), float(v[j]) if noisy else None)
        found = [rho[i], u[i], theta[i], f[i, j]]
        errors += [abs(a - b) / scale for a, b, scale in zip(truth, found, scales, strict=False)]
    return max(errors)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("cross_section", [0.0, 1.7])
@pytest.mark.parametrize("time", [1e-12, 1e-9, 1e-4, 0.2, 3.0])
def test_from_early_to_late(make_scene: Callable[..., Scene], start: str, cross_section: float, time: float) -> None:
    collisions = {"operator": "follow-the-leader", "cross_section": cross_section}
    scene = make_scene(collisions=collisions, initial={"mean_velocity": -0.4, "temperature": 0.9, **STARTS[start]})
    assert worst(scene, time) < 1e-13


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-3])
def test_weak_noise(make_scene: Callable[..., Scene], start: str, noise: float) -> None:
    model = {"gravity": 1.3, "friction": 0.2, "noise": noise}
    collisions = {"operator": "follow-the-leader", "cross_section": 0.6}
    scene = make_scene(model=model, collisions=collisions, initial={"mean_velocity": -0.4, "temperature": 0.2, **STARTS[start]})
    assert worst(scene, 2.1) < 1e-13


@pytest.mark.parametrize("width", [0.1, 0.02])
def test_a_pulse_in_a_varied_start(make_scene: Callable[..., Scene], width: float) -> None:
    """No pulse hides between nodes, over dozens of periods."""
    pulse = {"at": 0.3, "width": width, "height": 2.5}
    start = {"modes": [], "pulse": pulse, "mean_velocity": 0.2, "temperature": 0.4, "velocity_modes": [{"mode": 1, "cos": 0.2}]}
    scene = make_scene(pipe={"length": 1.4}, model={"gravity": 1.3, "friction": 0.05, "noise": 5.0}, initial=start)
    assert worst(scene, 4.0) < 1e-13


def test_many_collisions_in_a_varied_start(make_scene: Callable[..., Scene]) -> None:
    """R* = 40: logarithms of the weights reach R*²/2, of which nothing is lost."""
    collisions = {"operator": "follow-the-leader", "cross_section": 3.7}
    varied = {"velocity_modes": [{"mode": 1, "cos": -0.2}], "temperature_modes": [{"mode": 1, "sin": 0.1}]}
    start = {"density": 2.0, "modes": [], **varied, "mean_velocity": -0.1, "temperature": 0.5}
    model = {"gravity": 1.0, "friction": 0.015, "noise": 0.06}
    assert worst(make_scene(model=model, collisions=collisions, initial=start), 8.6) < 1e-13


def test_each_way_is_taken_where_it_costs_less(make_scene: Callable[..., Scene]) -> None:
    """Terms of f at a place and a velocity: bounded at early times, where those that velocities share grow as t^(-1/2)."""
    settings = [Solution(make_scene(), time).setting for time in (1e-6, 1e-8, 1e-12)]
    shared = [uniform.count(setting, precise=True) for setting in settings]
    assert shared[2] / shared[1] == pytest.approx(100, rel=0.05)
    assert {nearby.count(setting) for setting in settings} == {100.0}
    assert uniform.count(settings[0], precise=False) < 100
    assert uniform.count(Solution(make_scene(), 1.5).setting, precise=True) < 300
