"""What a run did, laid beside what theory predicts for its scene."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.analysis.frames import refuse_sweep
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import refuse_law, scene_of
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability import closure_rates, growth_rates, kinetic_rates, structure_factor
from kinetic_solver.stability.units import Complex, mode_numbers

if TYPE_CHECKING:
    import xarray as xr

ROUNDING = 1e-15
"""Noise of a density mode of a deterministic run, relative to the mean density, before the flow amplifies it."""
RELATIVE = 1e-9
"""Error of a run's density modes relative to the modes themselves. It weighs the frames of a fit where noise is less."""


@dataclass(frozen=True)
class _Fit:
    s: complex
    uncertainty: float
    first: float
    last: float
    frames: int


def measured_rates(dataset: xr.Dataset, modes: int | Iterable[int] | None = None) -> xr.Dataset:
    """s(k) of a run's density modes, ∝ exp(ikx + st), with what the closure and the kinetic equation predict; dims (mode,).

    Any dataset with `density(time, x)` and a scene will do: grid, particles, hydrodynamics. The leading branch of theory, or
    conjugate pair, is fitted to each mode's complex amplitude c_n(t); theory's value is the first guess, and sets the window:
    that whose predicted error is least, [exp(-gap·first) + disturbance]/length. The first term is what is left of faster
    branches; the second, relative to |c_n|, the largest of: noise (rounding, or the ideal √(1/N) of particles) as the flow
    amplifies it, √S(k); what the other modes drive nonlinearly, (1 + R*)Σ|c_m c_{n-m}|; and `RELATIVE`.

    `uncertainty` of |s|: the fit's standard error (for particles with frames counted once per correlation time 1/|Re s|), plus
    the change when the window's first half is left out, plus the predicted error. NaN where a mode is at the noise, has too few
    frames, or is beyond the grid. Test: tests/linear_theory/test_measured_rates.py.
    Raises SceneError where the dataset lacks the density or has one point in x, and for a sweep.
    """
    refuse_sweep(dataset)
    refuse_law(dataset)
    scene = scene_of(dataset)
    if "density" not in dataset or dataset.sizes["x"] < 3:
        raise SceneError("the dataset has no density over x to measure growth rates from; set output.moments = true, nx > 2")
    highest = (dataset.sizes["x"] - 1) // 2
    numbers = mode_numbers(range(1, min(8, highest) + 1) if modes is None else modes)
    began = scene.initial.time
    t = dataset[str(dataset["density"].dims[0])].values - began  # since the start
    amplitudes = mode_amplitudes(dataset)
    fits = [_measure(dataset, scene, t, amplitudes, n) if n <= highest else None for n in numbers]
    result = growth_rates(scene, numbers)
    for place, n in enumerate(numbers):
        if (branch := _started(scene, n)) > 0:
            s = kinetic_rates(scene, n, branch + 1)[0][branch]
            result["kinetic_growth_rate"].values[place], result["kinetic_frequency"].values[place] = s.real, s.imag
    branches = np.array([max(0, _started(scene, n)) for n in numbers])
    result["branch"] = ("mode", branches, {"long_name": "branch of the kinetic s", "units": "1"})

    def add(name: str, values: list[float], long_name: str, units: str = "time-1") -> None:
        result[name] = ("mode", np.array(values, dtype=float), {"long_name": long_name, "units": units})

    add("growth_rate", [fit.s.real if fit else math.nan for fit in fits], "measured growth rate Re s")
    add("frequency", [fit.s.imag if fit else math.nan for fit in fits], "measured Im s")
    add("uncertainty", [fit.uncertainty if fit else math.nan for fit in fits], "uncertainty of the measured s")
    add("first_time", [began + fit.first if fit else math.nan for fit in fits], "first frame of the fit", "time")
    add("last_time", [began + fit.last if fit else math.nan for fit in fits], "last frame of the fit", "time")
    add("frames", [fit.frames if fit else 0 for fit in fits], "frames of the fit", "1")
    return result


def measured_lines(measured: xr.Dataset) -> list[str]:
    """`measured_rates` as a table, one line a mode."""
    lines = [
        f"mode  {'Re s, measured':>16}  {'± of s':>9}  {'Re s, kinetic':>16}  {'Re s, closure':>14}  "
        f"{'|Δs|, kinetic':>14}  window"
    ]
    for n in measured["mode"].values:
        row = {name: float(values) for name, values in measured.sel(mode=n).data_vars.items()}
        if math.isnan(row["growth_rate"]):
            lines.append(f"{n:>4}  {'not measurable':>16}  {'':>9}  {row['kinetic_growth_rate']:>16.9g}")
            continue
        difference = math.hypot(row["growth_rate"] - row["kinetic_growth_rate"], row["frequency"] - row["kinetic_frequency"])
        lines.append(
            f"{n:>4}  {row['growth_rate']:>16.9g}  {row['uncertainty']:>9.1e}  {row['kinetic_growth_rate']:>16.9g}"
            f"  {row['closure_growth_rate']:>14.6g}  {difference:>14.1e}  t = {row['first_time']:.4g} to {row['last_time']:.4g}"
        )
    return lines


def mode_amplitudes(dataset: xr.Dataset) -> Complex:
    """c_n(t) = (1/L)∫ρ exp(-ikx) dx over the mean density, n = 0 … (nx - 1)//2, shape (time, modes)."""
    x, density = dataset["x"].values, dataset["density"].values
    n = np.arange((x.size - 1) // 2 + 1)
    start = np.exp(-2j * np.pi * n * x[0] / scene_of(dataset).pipe.length)
    return np.fft.rfft(density, axis=1)[:, : n.size] * start / density.sum(axis=1)[:, None]


def _measure(dataset: xr.Dataset, scene: Scene, t: Array, amplitudes: Complex, mode: int) -> _Fit | None:
    predicted, gap = _branches(dataset, scene, mode)
    branch, slowest = _started(scene, mode), predicted[0]
    if branch >= 0:
        predicted, gap = kinetic_rates(scene, mode, branch + 1)[0][-1:], math.inf
    noise, stochastic = _noise(dataset, scene, mode)
    c = amplitudes[:, mode]
    number = scene.groups.collision_number
    disturbance = np.maximum(noise, (1 + number) * _driven(amplitudes, mode))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.maximum(disturbance / np.abs(c), RELATIVE)
    if branch > 0:
        # The slowest branch, fed by rounding and nonlinearity, takes over in the end.
        relative = np.maximum(relative, RELATIVE * np.exp((slowest.real - predicted[0].real) * t))
    window = _window(t, relative, gap, 2 * len(predicted) + 2)
    if window is None:
        return None
    first, last, error = window
    weight = 1 / np.maximum(disturbance, RELATIVE * np.abs(c))
    whole = slice(first, last + 1)
    s, spread = _fit(t[whole], c[whole], weight[whole], predicted)
    if stochastic:
        length = t[last] - t[first]
        spread *= math.sqrt(max(1.0, (last + 1 - first) / (1 + length * abs(s.real))))
    later = slice(min((first + last) // 2, last - 2 * len(predicted) - 1), last + 1)
    again, _ = _fit(t[later], c[later], weight[later], predicted)
    return _Fit(s, spread + abs(again - s) + error, float(t[first]), float(t[last]), last + 1 - first)


def _started(scene: Scene, mode: int) -> int:
    """The slowest branch in which the scene starts this mode; -1 where it does not start from its eigenmodes."""
    return min((wave.branch for wave in scene.initial.eigenmodes if wave.mode == mode), default=-1)


def _driven(amplitudes: Complex, mode: int) -> Array:
    """Σ_m |c_m c_{n-m}| over all m but 0 and n, shape (time,)."""
    size = np.abs(amplitudes)
    both = np.concatenate([size[:, :0:-1], np.zeros((len(size), 1)), size[:, 1:]], axis=1)  # c_-M … c_M, without c_0
    reach = amplitudes.shape[1] - 1
    m = np.arange(max(-reach, mode - reach), min(reach, mode + reach) + 1)
    return np.einsum("tm,tm->t", both[:, m + reach], both[:, mode - m + reach])


def _window(t: Array, disturbance: Array, gap: float, least: int) -> tuple[int, int, float] | None:
    """(first, last, predicted error) of the best window of `least` frames or more; None where noise leaves none."""
    # A window ends before the next frame in which the mode is lost; it may be so at first, where a density has yet to form.
    lost = np.append(np.flatnonzero(~(disturbance < 1 / 3)), t.size)
    candidates = np.unique(np.linspace(0, t.size - 1, min(t.size, 200)).astype(int))
    best = None
    for first in candidates:
        end = lost[np.searchsorted(lost, first)]
        lasts = candidates[(candidates >= first + least - 1) & (candidates < end)]
        if not lasts.size:
            continue
        worst = np.maximum.accumulate(disturbance[first:end])[lasts - first]
        faster = 0.0 if math.isinf(gap) else math.exp(-gap * t[first])
        error = (faster + worst) / (t[lasts] - t[first])
        n = int(np.argmin(error))
        if best is None or error[n] < best[2]:
            best = int(first), int(lasts[n]), float(error[n])
    return best


def _branches(dataset: xr.Dataset, scene: Scene, mode: int) -> tuple[Complex, float]:
    """(s of the slowest branch or conjugate pair, by how much the next one decays faster)."""
    closed = dataset.attrs.get("method") == "hydrodynamics"
    s = closure_rates(scene, mode) if closed else kinetic_rates(scene, mode, 4)[0]
    paired = abs(s[0].real - s[1].real) < 1e-6 * (abs(s[0].real) + scene.model.friction)
    count = 2 if paired else 1
    return s[:count], float(s[0].real - s[count].real)


def _noise(dataset: xr.Dataset, scene: Scene, mode: int) -> tuple[float, bool]:
    """(standard deviation of the relative amplitude by noise alone, whether it is that of particles)."""
    amplified = math.sqrt(float(structure_factor(scene, mode)[0]))
    if dataset.attrs.get("method") == "particles":
        return amplified / math.sqrt(scene.particles.count * scene.particles.replicas), True
    return ROUNDING * amplified, False


def _fit(t: Array, c: Complex, weight: Array, guess: Complex) -> tuple[complex, float]:
    """(s of the first branch, standard error of |s|): least squares of Σ a_j exp(s_j t), the a_j eliminated."""
    from scipy.optimize import least_squares

    t = t - t[0]
    scale = max(float(np.abs(guess).max()), 1 / t[-1])

    def residual(parameters: Array) -> Array:
        s = guess + scale * (parameters[::2] + 1j * parameters[1::2])
        basis = weight[:, None] * np.exp(np.outer(t, s))
        norms = np.linalg.norm(basis, axis=0)
        amplitudes = np.linalg.lstsq(basis / norms, weight * c, rcond=None)[0]
        left = (basis / norms) @ amplitudes - weight * c
        return np.concatenate([left.real, left.imag])

    found = least_squares(residual, np.zeros(2 * guess.size), method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    s = guess[0] + scale * complex(found.x[0], found.x[1])
    freedom = max(1, 2 * t.size - 4 * guess.size)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * (2 * found.cost / freedom)
    return s, scale * math.sqrt(float(covariance[0, 0] + covariance[1, 1]))
