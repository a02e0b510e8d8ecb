"""A second discretisation of (2) with operator (12), to hold the grid solver against: it shares no numerics with it.

f is a Fourier series in x and in v. In v the gain and the loss of the weak form are exact sums over pairs of modes (a Galerkin
method in the manner of Pareschi and Russo 2000): with r = a - b, α = (1 - ε)/2,

    Ĉ_q = S/2 Σ_{l+m=q} f_l f_m ∫_{-R}^{R} |r| [cos((q_l - αq) r) + cos((q_l - (1 - α)q) r) - cos(q_l r) - cos((q_l - q) r)] dr

which is known in closed form. Time is left to an explicit Runge-Kutta method of order 8 with error control (DOP853 of SciPy), all
terms of (2) together: no splitting, no kernel, no deposit. Everything converges faster than any power, so `solve` takes more of
what its own spectra find too few. Test: tests/reference/test_fourier_inelastic.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from kinetic_solver import Scene, initial

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

REACH = 6.0
"""Standard deviations of the hottest Maxwellian that the window holds about all means: e^-18 = 1.5e-8 of it is beyond."""
RESOLVED = 6.0
"""Likewise in q, of the coldest."""
MOST_WORK = 1.5e10
"""Multiplications, about: ten seconds. More is not tried."""


class OutOfReach(Exception):
    """This discretisation would need too many points."""


@dataclass(frozen=True)
class Points:
    """Odd numbers of points, so that there is no Nyquist mode."""

    nx: int
    nv: int
    centre: float
    half: float
    """v in [centre - half, centre + half], periodic."""
    longest: float
    """R: pairs further apart are left out."""
    length: float

    @property
    def x(self) -> Array:
        return np.asarray(self.length * np.arange(self.nx) / self.nx)

    @property
    def v(self) -> Array:
        return np.asarray(self.centre - self.half + 2 * self.half * np.arange(self.nv) / self.nv)


def _integral(kappa: Array, longest: float) -> Array:
    """∫_{-R}^{R} |r| cos(κr) dr."""
    z = kappa * longest
    small = np.abs(z) < 1e-2
    safe = np.where(small, 1.0, z)
    series = 1 - z**2 / 4 + z**4 / 72 - z**6 / 2880
    return np.asarray(longest**2 * np.where(small, series, 2 * (np.sin(safe) / safe + (np.cos(safe) - 1) / safe**2)))


def weights(points: Points, restitution: float) -> Array:
    """β(q, l), q = 0 … M, l = -M … M, in units of one mode; (M + 1, 2M + 1)."""
    m = points.nv // 2
    unit = math.pi / points.half
    q, left = unit * np.arange(m + 1)[:, None], unit * np.arange(-m, m + 1)[None, :]
    alpha = (1 - restitution) / 2
    places = ((alpha, 1.0), (1 - alpha, 1.0), (0.0, -1.0), (1.0, -1.0))
    return np.asarray(sum(sign * _integral(left - part * q, points.longest) for part, sign in places))


@numba.njit(cache=True)
def _pair_sums(modes, beta, out):  # type: ignore[no-untyped-def]
    """out[x, q] = Σ_l β(q, l) f_l f_{q-l}; modes (nx, 2M + 1) from -M to M."""
    m = beta.shape[0] - 1
    for x in range(modes.shape[0]):
        for q in range(m + 1):
            total = 0j
            for left in range(q - m, m + 1):
                total += beta[q, left + m] * modes[x, left + m] * modes[x, q - left + m]
            out[x, q] = total


class Rate:
    """∂f/∂t, f (nx, nv) at the points."""

    def __init__(self, scene: Scene, points: Points) -> None:
        self.points, model = points, scene.model
        self.shape = (points.nx, points.nv)
        self.v = points.v
        self.force = model.gravity - model.friction * self.v
        self.q = math.pi / points.half * np.arange(points.nv // 2 + 1)
        self.k = 2 * math.pi / points.length * np.arange(points.nx // 2 + 1)
        self.diffusion = model.noise * model.friction * self.q**2
        # The series of f has its coefficients over nv; the window begins at -half, which gives mode l a sign; C_q = period·Ĉ_q.
        self.scale = scene.cross_section / 2
        self.beta = weights(points, scene.restitution)

    def collisions(self, spectrum: Complex) -> Complex:
        """Modes 0 … M of C, from those of f, as np.fft.rfft has them."""
        nv, m = self.points.nv, self.points.nv // 2
        phase = np.where(np.arange(m + 1) % 2, -1.0, 1.0)  # modes about the middle of the window, not its lower end
        half = spectrum * phase / nv
        modes = np.concatenate([np.conj(half[:, :0:-1]), half], axis=1)
        out = np.empty_like(half)
        _pair_sums(modes, self.beta, out)
        return np.asarray(self.scale * out * phase * nv)

    def __call__(self, _: float, flat: Array) -> Array:
        f = flat.reshape(self.shape)
        spectrum = np.fft.rfft(f, axis=1)
        change = self.collisions(spectrum) - 1j * self.q * np.fft.rfft(self.force * f, axis=1) - self.diffusion * spectrum
        rate = np.fft.irfft(change, n=self.points.nv, axis=1)
        if self.points.nx > 1:
            rate -= self.v * np.fft.irfft(1j * self.k[:, None] * np.fft.rfft(f, axis=0), n=self.points.nx, axis=0)
        return np.asarray(rate.ravel())


LEAST_HARMONICS = 3
"""Modes in x over the highest of the start, at least. Its own harmonics, which collisions make first, are twice and three times
as high: on fewer points they would be taken for lower modes, and not be seen among the highest."""


def highest_mode(scene: Scene) -> int:
    """Of the start's lists of modes; 0 where it has none. A step or a pulse has all."""
    start = scene.initial
    lists = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
    return max((m.mode for m in lists if m.cos or m.sin), default=0)


def points_for(scene: Scene, modes: int, finer: float = 1.0, theta_min: float | None = None) -> Points:
    """Enough for Maxwellians between the coldest and the hottest, and for so many modes in x."""
    model, places = scene.model, scene.pipe.length * np.arange(1024) / 1024
    beams = initial.beams(scene)
    u = np.array([initial.mean_velocity(scene, places, mean) for _, mean, _ in beams])
    theta = np.array([initial.temperature(scene, places, t) for _, _, t in beams])
    end = scene.run.end_time
    decay = math.exp(-model.friction * end)
    drift = model.gravity / model.friction * (1 - decay) if model.friction > 0 else model.gravity * end
    means = [float(u.min()), float(u.max()), float(u.min()) * decay + drift, float(u.max()) * decay + drift]
    heated = model.noise * (1 - decay**2)
    hottest = max(float(theta.max()), float(theta.max()) * decay**2 + heated)
    coldest = min(float(theta.min()), float(theta.min()) * decay**2 + heated) if theta_min is None else theta_min
    reach = (max(means) - min(means)) / 2 + REACH * math.sqrt(hottest)
    half, longest = math.sqrt(2) * reach, math.sqrt(2) * reach
    nv = 2 * math.ceil(finer * RESOLVED / math.sqrt(coldest) * half / math.pi) + 1
    nx = 1 if scene.homogeneous else 2 * math.ceil(finer * modes) + 1
    return Points(nx, nv, (max(means) + min(means)) / 2, half, longest, scene.pipe.length)


@dataclass(frozen=True)
class Frames:
    points: Points
    times: Array
    f: Array
    """(times, nx, nv)."""

    def at(self, x: Array, v: Array) -> Array:
        """f at other points, by its own Fourier series; 0 beyond the window."""
        p = self.points
        along_x = _series(p.nx, p.length, x)
        along_v = _series(p.nv, 2 * p.half, v - (p.centre - p.half)) * (np.abs(v - p.centre) < p.half)[:, None]
        return np.asarray(along_x @ self.f @ along_v.T)

    def moments(self, x: Array) -> tuple[Array, Array, Array]:
        """(density, mean velocity, temperature) at x, each (times, len(x)): sums over v of the series along x."""
        p = self.points
        f = _series(p.nx, p.length, x) @ self.f
        dv = 2 * p.half / p.nv
        rho = f.sum(axis=2) * dv
        u = f @ p.v * dv / rho
        theta = f @ p.v**2 * dv / rho - u**2
        return rho, u, theta

    def shortest(self) -> tuple[float, float]:
        """The largest amplitude of the highest eighth of modes in x and in v, over the largest of all, in any frame after 0."""
        found = []
        for axis, n in ((1, self.points.nx), (2, self.points.nv)):
            size = np.abs(np.fft.rfft(self.f[1:], axis=axis))
            top = size.max()
            tail = np.moveaxis(size, axis, 0)[size.shape[axis] - max(1, size.shape[axis] // 8) :]
            found.append(float(tail.max() / top) if n > 1 else 0.0)
        return found[0], found[1]


def _series(n: int, period: float, at: Array) -> Array:
    """Matrix from values at n even points of a period to the series' values elsewhere; n odd."""
    waves = np.arange(n // 2 + 1)
    weight = np.where(waves == 0, 1.0, 2.0) / n
    inward = np.exp(-2j * np.pi * np.outer(waves, np.arange(n)) / n)
    outward = np.exp(2j * np.pi / period * np.outer(at, waves)) * weight
    return np.asarray((outward @ inward).real)


def _start(scene: Scene, points: Points) -> Array:
    """f at time 0. Of a density step the modes that the points hold: samples would misplace its jumps."""
    step, k = scene.initial.step, 2 * math.pi / points.length * np.arange(1, points.nx // 2 + 1)
    density = initial.density(scene, points.x)
    if step is not None:
        outer = scene.initial.density / (1 + (step.ratio - 1) * (step.end - step.start))
        a, b = step.start * points.length, step.end * points.length
        modes = outer * (step.ratio - 1) * (np.exp(-1j * k * a) - np.exp(-1j * k * b)) / (1j * k * points.length)
        density = np.fft.irfft(np.append(scene.initial.density, modes), n=points.nx) * points.nx
    f = np.zeros((points.nx, points.nv))
    for share, mean, temperature in initial.beams(scene):
        u = initial.mean_velocity(scene, points.x, mean)
        f += share * initial.maxwellian(density, u, initial.temperature(scene, points.x, temperature), points.v)
    return f


def _work(scene: Scene, points: Points, end: float) -> float:
    """Multiplications, about: steps as long as an explicit method of 12 stages is stable; in each sums over modes, transforms."""
    q, k = math.pi / points.half * points.nv / 2, 2 * math.pi / points.length * (points.nx // 2)
    fastest = k * float(np.abs(points.v).max()) + scene.model.noise * scene.model.friction * q**2
    fastest += scene.model.friction * float(np.abs(scene.model.gravity / (scene.model.friction or 1) - points.v).max()) * q
    stages = 12 * max(20.0, end * fastest / 5)
    return float(stages * points.nx * points.nv * (40 + 0.75 * points.nv))


def integrate(scene: Scene, points: Points, rtol: float, most_work: float = MOST_WORK) -> Frames:
    """All frames of the scene. `rtol` bounds the error of each step in time, of the largest f."""
    times = scene.times()
    if (work := _work(scene, points, float(times[-1]))) > most_work:
        raise OutOfReach(f"{points.nx} × {points.nv} points, {work:.1g} multiplications")
    f = _start(scene, points)
    rate = Rate(scene, points)
    found = solve_ivp(
        rate, (0.0, float(times[-1])), f.ravel(), method="DOP853", t_eval=times, rtol=1e-12, atol=rtol * float(f.max())
    )
    assert found.success, found.message
    return Frames(points, times, found.y.T.reshape(times.size, points.nx, points.nv))


def solve(
    scene: Scene, tolerance: float, modes: int = 16, theta_min: float | None = None, most_work: float = MOST_WORK
) -> Frames:
    """The frames of a scene with operator (12), the highest modes in x and v below `tolerance` of the largest.

    Raises OutOfReach, and ValueError where `modes` are fewer than `LEAST_HARMONICS` times the start's highest mode.
    """
    highest = highest_mode(scene)
    if modes < LEAST_HARMONICS * highest:
        raise ValueError(f"modes = {modes}: the start has mode {highest}; allowed: {LEAST_HARMONICS * highest} or more")
    finer_x = finer_v = 1.0
    while True:
        points = points_for(scene, math.ceil(modes * finer_x), 1.0, theta_min)
        points = Points(
            points.nx, 2 * math.ceil(finer_v * (points.nv // 2)) + 1, points.centre, points.half, points.longest, points.length
        )
        frames = integrate(scene, points, tolerance / 100, most_work)
        in_x, in_v = frames.shortest()
        if max(in_x, in_v) <= tolerance:
            return frames
        finer_x *= 1.6 if in_x > tolerance else 1.0
        finer_v *= 1.5 if in_v > tolerance else 1.0
