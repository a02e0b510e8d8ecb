"""Starts from eigenmodes of the linearised equation on the homogeneous state: `initial.eigenmodes`
(docs/stability_details.md)."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver import stability
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability.units import Complex

SHORTEST_EIGENMODE = 12.0
"""The largest k√θ_h/γ of a wave that a run may start from. An eigenfunction of operator (6) is up to exp(k²σ/2γ²) times its own
density, 2e31 here: with f ≥ 0 its density is lost in rounding errors at waves much longer than that."""


def eigenmode_state(scene: Scene, x: Array, v: Array, mean_velocity: float) -> Array:
    """f = ρ̄[f_h + Σ Re (cos - i sin) h exp(ikx)], shape (nx, nv): `initial.eigenmodes` on the homogeneous state f_h, which has
    the given mean velocity.

    h is a branch's eigenfunction of unit density, so that the density has the waves cos·cos(kx) + sin·sin(kx).
    """
    f = np.tile(eigenmode_background(scene, v, mean_velocity), (x.size, 1))
    for mode, shape in eigenmode_shapes(scene, v, mean_velocity):
        f += (np.exp(2j * np.pi * mode / scene.pipe.length * x)[:, None] * shape).real
    return scene.initial.density * f


def eigenmode_background(scene: Scene, v: Array, mean_velocity: float) -> Array:
    """f_h(v), ∫f_h dv = 1."""
    return stability.homogeneous_distribution(scene, _beside_homogeneous(scene, v, mean_velocity))


def eigenmode_shapes(scene: Scene, v: Array, mean_velocity: float) -> list[tuple[int, Complex]]:
    """(mode, (cos - i sin) h(v)) of each of `initial.eigenmodes`."""
    place = _beside_homogeneous(scene, v, mean_velocity)
    return [
        (m.mode, (m.cos - 1j * m.sin) * stability.eigenfunction(scene, m.mode, m.branch, place)) for m in scene.initial.eigenmodes
    ]


def _beside_homogeneous(scene: Scene, v: Array, mean_velocity: float) -> Array:
    """v, in a frame in which the homogeneous state has this mean velocity, as the theory has it: about its own u_h."""
    return v - mean_velocity + stability.mean_velocity(scene)


def check_eigenmodes(scene: Scene, mean_velocity: float, temperature: float) -> None:
    """Raises SceneError where a branch is not resolved, or f would be negative: f < -1e-12 max f_h somewhere within 12 thermal
    velocities, at any of 64 places on the shortest wave."""
    waves = scene.initial.eigenmodes
    for m in waves:
        free_paths = 2 * math.pi * m.mode / scene.pipe.length * math.sqrt(temperature) / scene.model.friction
        if free_paths > SHORTEST_EIGENMODE:
            raise SceneError(
                f"initial.eigenmodes: mode = {m.mode} is too short a wave, k√θ/γ = {free_paths:.4g}; "
                f"allowed: {SHORTEST_EIGENMODE:g} or less"
            )
        rates, uncertainty = stability.kinetic_rates(scene, m.mode, m.branch + 1)
        if not uncertainty[-1] <= 1e-3 * abs(rates[-1].real):  # NaN, where nothing is resolved, as well
            raise SceneError(
                f"initial.eigenmodes: branch = {m.branch} of mode {m.mode} is not resolved (s = {rates[-1]:.3g} ± "
                f"{uncertainty[-1]:.1g}); allowed: a lower branch or mode"
            )
    v = mean_velocity + math.sqrt(temperature) * np.linspace(-12, 12, 513)
    background = eigenmode_background(scene, v, mean_velocity)
    background = background + 1e-12 * background.max()
    period = math.gcd(*(m.mode for m in waves))
    half = 32 * max(m.mode for m in waves) // period
    shapes = eigenmode_shapes(scene, v, mean_velocity)
    share = 1.0
    for j in np.flatnonzero(sum(np.abs(shape) for _, shape in shapes) > background):
        spectrum = np.zeros(half + 1, dtype=complex)
        for mode, shape in shapes:
            spectrum[mode // period] += half * shape[j]
        share = min(share, float(-background[j] / np.fft.irfft(spectrum, n=2 * half).min()))
    if share < 1:
        sizes = np.array([math.hypot(m.cos, m.sin) for m in waves])
        given, largest = (", ".join(f"{size:.3g}" for size in part) for part in (sizes, 0.995 * share * sizes))
        raise SceneError(f"initial.eigenmodes: amplitude {given} makes f negative; allowed here: {largest} or less")
