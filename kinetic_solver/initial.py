"""Initial states: the scene's conventions for density, mean velocity and temperature over x, and f from them or from a file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver import stability
from kinetic_solver.arrays import Array
from kinetic_solver.scene import Scene, SceneError, fourier_sum
from kinetic_solver.stability.units import Complex

if TYPE_CHECKING:
    import xarray as xr

SHORTEST_EIGENMODE = 12.0
"""k√θ_h/γ. An eigenfunction of operator (6) is up to exp(k²σ/2γ²) times its own density: no f can hold one long before this."""


def density(scene: Scene, x: ArrayLike) -> Array:
    """ρ0(x), of the shape of x; its mean over the pipe is `initial.density`."""
    start = scene.initial
    x = np.asarray(x, dtype=float)
    if start.step is None:
        return start.density * (1 + fourier_sum(start.density_modes, x, scene.pipe.length))
    place = np.mod(x / scene.pipe.length, 1.0)
    inside = (place >= start.step.start) & (place < start.step.end)
    return _outer_density(scene) * np.where(inside, start.step.ratio, 1.0)


def resolved_density(scene: Scene, x: Array) -> Array:
    """ρ0 as a grid can carry it, on the points of a period: a step cut off after the last Fourier mode, not sampled.

    Samples of a jump misplace it by up to dx, in the mass as in every wave; the cut leaves all waves that the grid holds exact.
    """
    step, n = scene.initial.step, x.size
    if step is None:
        return density(scene, x)
    k = 2 * np.pi * np.arange(1, n // 2 + 1)
    waves = np.empty(n // 2 + 1, dtype=complex)
    waves[0] = scene.initial.density
    jump = (step.ratio - 1) * _outer_density(scene)
    waves[1:] = jump * (np.exp(-1j * k * step.start) - np.exp(-1j * k * step.end)) / (1j * k)
    return np.fft.irfft(waves * n, n=n)


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
    if start.step is not None:
        periods = np.floor(y / length)
        place = y / length - periods
        inside = np.clip(place - start.step.start, 0.0, start.step.end - start.step.start)
        outer = _outer_density(scene)
        return length * (start.density * periods + outer * (place + (start.step.ratio - 1) * inside))
    total = y.copy()
    for m in start.density_modes:
        k = 2 * np.pi * m.mode / length
        # 1 - cos = 2 sin²(./2), without cancellation at small y
        total += (m.cos * np.sin(k * y) + m.sin * 2 * np.sin(k * y / 2) ** 2) / k
    return start.density * total


def maxwellian(density: Array, mean_velocity: Array, temperature: Array, v: Array) -> Array:
    """ρ N(v; u, θ), shape (nx, nv)."""
    w = v[None, :] - mean_velocity[:, None]
    theta = temperature[:, None]
    return density[:, None] * np.exp(-(w**2) / (2 * theta)) / np.sqrt(2 * np.pi * theta)


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


def from_file(scene: Scene, x: Array, v: Array) -> Array:
    """The last complete f(x, v) of the netCDF file `initial.file`, on the points x, v.

    In x the trigonometric interpolant, in v a cubic spline, zero outside the file's window; both exact where the points agree.
    Raises SceneError where the file has no such f, or another period.
    """
    from scipy.interpolate import make_interp_spline

    path = scene.initial.file
    with _opened(scene) as data:
        f, old_x, old_v = data["f"].values, data["x"].values, data["v"].values
    complete = f[np.isfinite(f).all(axis=(1, 2))]
    if not len(complete):
        raise SceneError(f"initial.file = {path!r}: has no complete frame of f")
    state = complete[-1]
    if not (old_v.shape == v.shape and np.allclose(old_v, v, rtol=1e-12, atol=1e-12 * (v[-1] - v[0]))):
        inside = (v >= old_v[0]) & (v <= old_v[-1])
        spline = make_interp_spline(old_v, state, k=3, axis=1)
        state = np.where(inside, spline(np.clip(v, old_v[0], old_v[-1])), 0.0)
    if old_x.size != x.size:
        spectrum = np.fft.rfft(state, axis=0) / old_x.size
        kept = min(spectrum.shape[0], x.size // 2 + 1)
        state = np.fft.irfft(spectrum[:kept] * x.size, n=x.size, axis=0)
    return np.ascontiguousarray(state)


def file_grid(scene: Scene) -> tuple[int, int, float, float]:
    """(nx, nv, low, high) of `initial.file`: the grid on which a run continues it without interpolation."""
    with _opened(scene) as data:
        v = data["v"].values
        half = (v[-1] - v[0]) / (v.size - 1) / 2
        return int(data.sizes["x"]), int(v.size), float(v[0] - half), float(v[-1] + half)


@contextmanager
def _opened(scene: Scene) -> Iterator[xr.Dataset]:
    import xarray as xr

    path = scene.initial.file
    assert path is not None
    try:
        data = xr.open_dataset(path)
    except (OSError, ValueError):
        raise SceneError(f"initial.file = {path!r}: is not a readable netCDF file") from None
    with data:
        if "f" not in data or data["f"].dims != ("time", "x", "v"):
            raise SceneError(f"initial.file = {path!r}: has no f(time, x, v); the grid method starts from nothing else")
        if "x_bounds" in data:
            bounds = data["x_bounds"].values
            period = bounds[-1, 1] - bounds[0, 0]
            if not np.isclose(period, scene.pipe.length, rtol=1e-9):
                raise SceneError(f"initial.file = {path!r}: its period is {period:.10g}, the scene's {scene.pipe.length:.10g}")
        yield data
