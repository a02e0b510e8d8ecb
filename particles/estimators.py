"""Fields from particles, with standard errors over replicas, and what stationary fluctuations say: S(k), S(k, ω), g(r).

A replica's particles are a sum of delta functions, of which the waves of x up to M = (nx - 1)//2 and the bins of v are kept:
linear in the particles, hence without bias. Point values in x are those of the Fourier series cut off after M, as the grid
solver holds them. Point values in v come from bin averages by (-1, 26, -1)/24; what that leaves is -(3/640) dv⁴ ∂⁴f/∂v⁴, and
the averages in the window's two outermost bins are kept as they are.

u, θ and q are nonlinear, and are made from the moments of all replicas together. With n = ρ(x) L R/(w(2M + 1)), the simulated
particles of R replicas in a share L/(2M + 1) of the pipe, half the shortest wavelength, their bias is O(1/n):
E[θ̂] = θ(1 - 1/n), as of n particles about their own mean; none of û where u does not depend on x. Standard errors are O(1/√n),
√n times as large.
Tests: tests/cross_validation/particles/test_estimators.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from kinetic_solver.arrays import Array
from particles.threads import over_particles

Complex = NDArray[np.complex128]

BLOCKS = 64
ACCUMULATORS = 80e6
"""Bytes of the accumulators of all blocks, at most; many modes and bins take fewer blocks."""

AT_ONCE = 2**23
"""Particles between two looks at whether to stop. Chosen: about a second."""
LEAST_AT_ONCE = 8
"""Blocks, so that there is one for each thread of some."""

MODES = 8
"""Relative amplitudes of the density that `density_modes` gives."""

SPANS = 20
"""Into which one replica's times are divided, to learn the error of its mean over time."""

SEGMENTS = 8
"""Of Welch's method: as many lengths of a segment as fit into the run, so 15 segments that overlap by half."""


@dataclass(frozen=True)
class Sample:
    """One replica at one time, w the number of real particles that each simulated one stands for."""

    modes: Complex
    """(4, M + 1): (1/L) Σ w (v - c)^p exp(-ik_m x), k_m = 2πm/L, for p = 0 … 3 [particles length^(p-1) time^-p]."""
    f_modes: Complex
    """(M + 1, nv): (1/L) Σ w exp(-ik_m x)/dv over the particles of each bin of v [particles time length^-2]."""
    outside: int
    """Simulated particles outside the velocity window: they count in `modes`, not in `f_modes`."""
    middle: float = 0.0
    """c."""


class Sampler:
    """Samples particles on a pipe of `length` for nx points and the bins about the uniform points v (nv,).

    Moments are taken about the middle of v, so that θ and q lose no digits where the mean velocity is large (test_far_from_rest).

    The same bits at any number of threads: particles are divided into blocks whose number depends on nx and nv alone, and
    which are added in order. exp(-ik_m x) is made of products of the first; sums at M = 200 are right to 1e-12 of Σ|w v^p|
    (test_sums). Every call uses the same accumulators, 80 MB at most.
    """

    def __init__(self, length: float, nx: int, v: Array, weight: float) -> None:
        self.length, self.weight = length, weight
        self.dv = (v[-1] - v[0]) / (v.size - 1)
        self._low = v[0] - self.dv / 2
        self.middle = float(v[0] + v[-1]) / 2
        waves = 2 * ((nx - 1) // 2 + 1)
        blocks = _blocks(waves, v.size)
        self._modes = np.empty((blocks, 4, waves))
        self._bins = np.empty((blocks, v.size, waves))
        self._outside = np.empty(blocks, dtype=np.int64)

    def sample(self, x: Array, v: Array, look: Callable[[], None] = lambda: None) -> Sample:
        """x, v (n,): positions, anywhere on the line, and velocities. `look` is called after every `AT_ONCE` particles or
        `LEAST_AT_ONCE` blocks but the last, and may raise."""
        k = 2 * math.pi / self.length
        sums, blocks = (self._modes, self._bins, self._outside), len(self._outside)

        def add(some: slice) -> None:
            _accumulate(x, v, k, self._low, 1 / self.dv, self.middle, *sums, first + some.start, first + some.stop)

        at_once = max(LEAST_AT_ONCE, AT_ONCE * blocks // x.size)
        for first in range(0, blocks, at_once):
            if first > 0:
                look()
            rows = min(at_once, blocks - first)
            over_particles(add, x.size * rows // blocks, rows)
        scale = self.weight / self.length
        modes, bins = scale * _complex(self._modes.sum(axis=0)), scale / self.dv * _complex(self._bins.sum(axis=0))
        return Sample(modes, np.ascontiguousarray(bins.T), int(self._outside.sum()), self.middle)


def _blocks(waves: int, nv: int) -> int:
    return max(1, min(BLOCKS, int(ACCUMULATORS / (8 * waves * (nv + 4)))))


def memory_of_samples(nx: int, nv: int, replicas: int) -> int:
    """Bytes of a sampler and of the samples of all replicas."""
    waves = 2 * ((nx - 1) // 2 + 1)
    return 8 * waves * (nv + 4) * (_blocks(waves, nv) + 3 * replicas)


def _complex(sums: Array) -> Complex:
    """Σ exp(-ikx) from rows of Σ cos kx, then Σ sin kx."""
    half = sums.shape[1] // 2
    return sums[:, :half] - 1j * sums[:, half:]


@numba.njit(nogil=True, cache=True)
def _accumulate(x, v, k, low, per_dv, middle, modes, bins, outside, begin, stop):  # type: ignore[no-untyped-def]
    """Σ (v - middle)^p (cos mkx, sin mkx) of blocks from `begin` up to `stop` into modes (blocks, 4, 2(M + 1)), p = 0 over bins
    into bins (blocks, nv, 2(M + 1))."""
    blocks, nv, waves = bins.shape
    count = waves // 2
    for b in range(begin, stop):
        modes[b] = 0.0
        bins[b] = 0.0
        missed = 0
        wave = np.empty(waves)
        wave[0], wave[count] = 1.0, 0.0
        for i in range(b * x.size // blocks, (b + 1) * x.size // blocks):
            # exp(imkx) for m from `done` on is exp(i done kx), by squaring, times what is there: independent products
            c, s = math.cos(k * x[i]), math.sin(k * x[i])
            done = 1
            while done < count:
                for m in range(min(done, count - done)):
                    wave[done + m] = c * wave[m] - s * wave[count + m]
                    wave[count + done + m] = s * wave[m] + c * wave[count + m]
                c, s = (c - s) * (c + s), 2 * c * s
                done *= 2
            u = v[i] - middle
            _add(modes[b, 0], 1.0, wave)
            _add(modes[b, 1], u, wave)
            _add(modes[b, 2], u * u, wave)
            _add(modes[b, 3], u * u * u, wave)
            place = (v[i] - low) * per_dv
            if 0.0 <= place < nv:
                _add(bins[b, np.int64(place)], 1.0, wave)
            else:
                missed += 1
        outside[b] = missed


@numba.njit(inline="always")
def _add(row, factor, wave):  # type: ignore[no-untyped-def]
    for m in range(wave.size):
        row[m] += factor * wave[m]


def fields(samples: list[Sample], length: float, nx: int, v: Array) -> dict[str, Array]:
    """Means over replicas as point values at x_i = i L/nx and v (nv,), the variables of docs/output.md, and their errors.

    f (nx, nv); density, mean_velocity, temperature, heat_flux (nx,); velocity_distribution (nv,); mass, momentum, energy; of all
    but the heat flux `<name>_stderr` too, the standard error of the mean over replicas: NaN where there is one; of all but f and
    the heat flux `<name>_replica` (replica, …), whose mean and standard error these are. Those of u and θ are linear in the
    replica's moments: u + (j - uρ)/ρ̄ and θ + (e - 2uj + (u² - θ)ρ)/ρ̄, with e = ∫v² f dv, velocities about c, and u, θ, ρ̄ of all
    replicas (the delta method, right to relative O(1/n): test_standard_errors). Where ρ, cut off after M waves, is not positive,
    u, θ and q are NaN: n is too small there. The error of f is 0 in bins where no replica has a particle, too few for an error.
    An even nx has its Nyquist mode set to zero.
    """
    modes = np.array([sample.modes for sample in samples])
    rho, j, e, third = np.moveaxis(_points(modes, nx, axis=2), 1, 0)
    f_modes = np.array([sample.f_modes for sample in samples])
    f, w = _from_averages(_points(f_modes, nx, axis=1)), _from_averages(length * f_modes[:, 0].real)
    total = length * modes[:, :, 0].real

    c = samples[0].middle
    density, flux = rho.mean(axis=0), j.mean(axis=0)
    divisor = np.where(density > 0, density, np.nan)
    u = flux / divisor
    theta = e.mean(axis=0) / divisor - u**2
    q = third.mean(axis=0) - 3 * u * e.mean(axis=0) + 2 * density * u**3
    result = {"mean_velocity": c + u, "temperature": theta, "heat_flux": q, "f": f.mean(axis=0), "f_stderr": _stderr(f)}
    replicas = {
        "density": rho,
        "mean_velocity": c + u + (j - u * rho) / divisor,
        "temperature": theta + (e - 2 * u * j + (u**2 - theta) * rho) / divisor,
        "velocity_distribution": w,
        "mass": total[:, 0],
        "momentum": total[:, 1] + c * total[:, 0],
        "energy": total[:, 2] / 2 + c * total[:, 1] + c**2 / 2 * total[:, 0],
    }
    for name, values in replicas.items():
        result.setdefault(name, values.mean(axis=0))
        result[f"{name}_replica"], result[f"{name}_stderr"] = values, _stderr(values)
    return result


def _points(modes: Complex, nx: int, axis: int) -> Array:
    """Σ_m modes exp(ik_m x_i), m = -M … M, at the nx points."""
    return np.fft.irfft(modes, n=nx, axis=axis, norm="forward")


def _from_averages(averages: Array) -> Array:
    """Point values at the centres of bins from averages over them, along the last axis; the two ends as they are."""
    points = averages.copy()
    points[..., 1:-1] -= np.diff(averages, n=2, axis=-1) / 24
    return points


def _stderr(values: Array) -> Array:
    """Standard error of the mean along axis 0 of independent values; NaN where there is one."""
    count = values.shape[0]
    if count < 2:
        return np.full(values.shape[1:], np.nan)
    return np.asarray(values.std(axis=0, ddof=1) / math.sqrt(count))


def density_modes(sample: Sample) -> Complex:
    """c_m = ρ_m/ρ_0 = (1/N) Σ exp(-ik_m x) for m = 1 … 8, or up to M where that is less."""
    rho = sample.modes[0]
    return rho[1 : MODES + 1] / rho[0]


def structure_factor(c: Complex, count: int) -> tuple[Array, Array]:
    """S(k) = N⟨|c|²⟩ of stationary amplitudes c (time, replica, mode), N = `count` to a replica, and its error; each (mode,).

    1 for independent particles. The mean over times and replicas; the standard error is that of the replicas, or for a single
    one that of the means of 20 spans of its time: right where a span is many correlation times (test_structure_factor).
    """
    power = count * np.abs(np.asarray(c)) ** 2
    replicas = power.mean(axis=0)
    if replicas.shape[0] > 1:
        return replicas.mean(axis=0), _stderr(replicas)
    spans = np.array_split(power[:, 0], min(SPANS, c.shape[0]))
    return replicas[0], _stderr(np.array([span.mean(axis=0) for span in spans]))


def frequency_spectrum(c: Complex, count: int, dt: float) -> tuple[Array, Array, Array]:
    """ω ascending (omega,), S(k, ω) = N∫⟨c(t + τ) c*(t)⟩ exp(iωτ) dτ (omega, mode), its error; c (time, replica, mode) every dt.

    ∫S(k, ω) dω/2π = S(k), and a wave that travels at u > 0 has its peak at ω = ku > 0. By P. D. Welch's method (1967) with
    Hann windows an eighth of the run long, overlapping by half: S(k, ω) is smoothed over ω by 1.5 · 2π · 8/duration and folded
    at ±π/dt, so lines must be wider than the one and within the other. The standard error is that of the replicas, or for a
    single one Welch's, for Gaussian amplitudes: relative √((1 + (1 - 1/K)/18)/K) with K segments (test_frequency_spectrum).
    """
    c = np.asarray(c)
    segment = max(1, c.shape[0] // SEGMENTS)
    frequency, power = signal.welch(
        np.conj(c), 1 / dt, "hann", segment, segment // 2, detrend=False, return_onesided=False, scaling="density", axis=0
    )
    order = np.argsort(frequency)
    omega, power = 2 * np.pi * frequency[order], count * power[order]
    spectrum = power.mean(axis=1)
    if power.shape[1] > 1:
        return omega, spectrum, _stderr(np.moveaxis(power, 1, 0))
    segments = (c.shape[0] - segment // 2) // (segment - segment // 2)
    return omega, spectrum, spectrum * math.sqrt((1 + (1 - 1 / segments) / 18) / segments)


def pair_correlation(structure: Array, count: int, length: float, r: Array) -> Array:
    """g(r) - 1 from S(k_m) (mode,), m = 1, 2, …, of N = `count` particles on the period `length`; the shape of r.

    The density of ordered pairs at distance r is (1/L) Σ_m (N S_m - N) exp(ik_m r) over all m, S_0 = N. Over that of independent
    particles, N(N - 1)/L, it is g(r) = 1 + (2/(N - 1)) Σ_{m>0} (S_m - 1) cos k_m r: 1 for them, and ∫(g - 1) dr = 0.
    With modes up to m it is seen through a resolution of L/2m (test_pair_correlation: exact against the sum over pairs).
    """
    structure = np.asarray(structure)
    k = 2 * np.pi / length * np.arange(1, structure.size + 1)
    return np.asarray(2 / (count - 1) * np.cos(np.multiply.outer(r, k)) @ (structure - 1))
