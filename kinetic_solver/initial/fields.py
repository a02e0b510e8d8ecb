"""The scene's conventions for density, mean velocity and temperature over x at time 0."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Pulse, Scene, fourier_sum
from kinetic_solver.stability.homogeneous import HomogeneousState, homogeneous_state


def start_state(scene: Scene) -> tuple[float, float]:
    """(u0, θ0): the scene's own where given, else the homogeneous state's; of beams those of all particles together.

    Where that does not exist, the mean velocity is g/γ (0 for γ = 0), and the temperature σ (1 for σ = 0).
    """
    start, model = scene.initial, scene.model
    if start.beams:
        mean = math.fsum(b.share * b.mean_velocity for b in start.beams)
        return mean, math.fsum(b.share * (b.temperature + (b.mean_velocity - mean) ** 2) for b in start.beams)
    u0, theta0 = start.mean_velocity, start.temperature
    keeps_momentum = scene.law is not None and "momentum" in scene.law.conserves
    if u0 is None and theta0 is not None and keeps_momentum and model.friction * model.noise > 0:
        u0 = model.gravity / model.friction  # known without solving for the temperature
    if u0 is None or theta0 is None:
        state = homogeneous_state(scene)
        if state is None:
            terminal = model.gravity / model.friction if model.friction > 0 else 0.0
            state = HomogeneousState(terminal, model.noise if model.noise > 0 else 1.0, 0.0, 0.0)
        u0 = state.mean_velocity if u0 is None else u0
        theta0 = state.temperature if theta0 is None else theta0
    return u0, theta0


def beams(scene: Scene) -> list[tuple[float, float, float]]:
    """(share, u, θ) of every Maxwellian that the start is made of, without the modes of velocity and temperature."""
    if scene.initial.beams:
        return [(b.share, b.mean_velocity, b.temperature) for b in scene.initial.beams]
    return [(1.0, *start_state(scene))]


def density(scene: Scene, x: ArrayLike) -> Array:
    """ρ0(x), of the shape of x; its mean over the pipe is `initial.density`."""
    start = scene.initial
    x = np.asarray(x, dtype=float)
    if start.pulse is not None:
        return start.density / start.pulse.whole * (1 + start.pulse.height * _gaussians(start.pulse, x / scene.pipe.length))
    if start.step is None:
        return start.density * (1 + fourier_sum(start.density_modes, x, scene.pipe.length))
    place = np.mod(x / scene.pipe.length, 1.0)
    inside = (place >= start.step.start) & (place < start.step.end)
    return _outer_density(scene) * np.where(inside, start.step.ratio, 1.0)


def resolved_density(scene: Scene, x: Array) -> Array:
    """ρ0 as a grid can carry it, on the points of a period: a step or a pulse cut off after the last Fourier mode, not sampled.

    Samples of a jump misplace it by up to dx, in the mass as in every wave, and samples of a narrow pulse miss some of its mass;
    the cut leaves all waves that the grid holds exact.
    """
    step, pulse, n = scene.initial.step, scene.initial.pulse, x.size
    if step is None and pulse is None:
        return density(scene, x)
    k = 2 * np.pi * np.arange(1, n // 2 + 1)
    waves = np.empty(n // 2 + 1, dtype=complex)
    waves[0] = scene.initial.density
    if step is not None:
        jump = (step.ratio - 1) * _outer_density(scene)
        waves[1:] = jump * (np.exp(-1j * k * step.start) - np.exp(-1j * k * step.end)) / (1j * k)
    elif pulse is not None:
        area = scene.initial.density * (1 - 1 / pulse.whole)
        waves[1:] = area * np.exp(-((k * pulse.width) ** 2) / 2 - 1j * k * pulse.at)
    return np.fft.irfft(waves * n, n=n)


def resolved_lifted_density(scene: Scene, cross_section: float, x: Array) -> Array:
    """ρ0 exp(SΦ) over the largest exp(SΦ), Φ the periodic part of ∫ρ0 dx, on the points of a period: a step likewise cut off.

    Between its jumps ρ0 is constant and exp(SΦ) an exponential, whose waves are integrals in closed form. For any S > 0.
    """
    step, length, s, mean = scene.initial.step, scene.pipe.length, cross_section, scene.initial.density
    assert step is not None
    k, outer = 2 * np.pi / length * np.arange(x.size // 2 + 1), _outer_density(scene)
    edges = length * np.array([0.0, step.start, step.end, 1.0])
    phi = s * (density_integral(scene, edges) - mean * edges)
    waves = np.zeros(k.size, dtype=complex)
    for a, z, level, rho in zip(edges[:-1], edges[1:], phi - phi.max(), (outer, outer * step.ratio, outer), strict=False):
        rate = (s * (rho - mean) - 1j * k) * (z - a)
        waves += rho * (z - a) / length * np.exp(level - 1j * k * a) * _mean_of_exponential(rate)
    return np.fft.irfft(waves * x.size, n=x.size)


def _mean_of_exponential(rate: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """The mean of exp(rate·y) over y from 0 to 1."""
    still = rate == 0
    return np.where(still, 1.0, np.expm1(rate) / np.where(still, 1.0, rate))


def _gaussians(pulse: Pulse, place: Array) -> Array:
    """Σ exp(-(place - at - m)²/(2 width²)), place over the pipe's length."""
    nearest = place - pulse.at - np.round(place - pulse.at)
    return np.asarray(sum(np.exp(-(((nearest - m) / pulse.width) ** 2) / 2) for m in _neighbours(pulse)))


def _neighbours(pulse: Pulse) -> range:
    """The periods from which a Gaussian still reaches this one: nine of its widths, exp(-40)."""
    reach = math.ceil(9 * pulse.width) + 1
    return range(-reach, reach + 1)


def _outer_density(scene: Scene) -> float:
    """The density outside the step."""
    step = scene.initial.step
    assert step is not None
    return scene.initial.density / (1 + (step.ratio - 1) * (step.end - step.start))


def mean_velocity(scene: Scene, x: ArrayLike, base: float) -> Array:
    """u0(x) = base + Σ velocity_modes."""
    return base + fourier_sum(scene.initial.velocity_modes, x, scene.pipe.length)


def temperature(scene: Scene, x: ArrayLike, base: float) -> Array:
    """θ0(x) = base·(1 + Σ temperature_modes)."""
    return base * (1 + fourier_sum(scene.initial.temperature_modes, x, scene.pipe.length))


def density_integral(scene: Scene, y: ArrayLike) -> Array:
    """Φ0(y) = ∫_0^y ρ0, ρ0 continued periodically: its linear part is included. Any real y."""
    start, length = scene.initial, scene.pipe.length
    y = np.asarray(y, dtype=float)
    if start.step is not None or start.pulse is not None:
        periods = np.floor(y / length)
        return length * (start.density * periods + _swept(scene, y / length - periods))
    return start.density * (y + _swept_by_waves(scene, y))


def density_excess(scene: Scene, y: ArrayLike) -> Array:
    """Φ0(y) - ρ̄y, the periodic part of `density_integral`, whose error does not grow with y."""
    start, length = scene.initial, scene.pipe.length
    y = np.asarray(y, dtype=float)
    if start.step is not None or start.pulse is not None:
        place = y / length - np.floor(y / length)
        return length * (_swept(scene, place) - start.density * place)
    return start.density * _swept_by_waves(scene, y)


def _swept(scene: Scene, place: Array) -> Array:
    """∫ρ0 over a step or a pulse from 0 to a place in the first period, both over the pipe's length."""
    start = scene.initial
    if start.step is not None:
        inside = np.clip(place - start.step.start, 0.0, start.step.end - start.step.start)
        return _outer_density(scene) * (place + (start.step.ratio - 1) * inside)
    from scipy.special import erf

    pulse = start.pulse
    assert pulse is not None
    root = math.sqrt(2) * pulse.width
    swept = sum(erf((place - pulse.at + m) / root) - math.erf((m - pulse.at) / root) for m in _neighbours(pulse))
    area = pulse.height * pulse.width * math.sqrt(math.pi / 2) * swept
    return np.asarray(start.density * (place + area) / pulse.whole)


def _swept_by_waves(scene: Scene, y: Array) -> Array:
    """∫_0^y of the density's waves, over the mean density."""
    total = np.zeros_like(y)
    for m in scene.initial.density_modes:
        k = 2 * np.pi * m.mode / scene.pipe.length
        if m.cos:
            total += m.cos / k * np.sin(k * y)
        if m.sin:  # 1 - cos = 2 sin²(./2), without cancellation at small y
            total += m.sin / k * 2 * np.sin(k * y / 2) ** 2
    return total
