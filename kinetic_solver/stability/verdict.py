"""Linear theory of a scene as one dataset, and as a verdict in words: which number answers which question."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Scene
from kinetic_solver.stability.amplification import (
    apparent_critical_density,
    growth_times,
    largest_density_gain,
    structure_factor,
    transient_growth,
)
from kinetic_solver.stability.closure import SHORTEST, critical_density, marginal_wavenumber
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.spectrum import FIRST_MODES, growth_rates
from kinetic_solver.stability.units import mode_numbers

if TYPE_CHECKING:
    import xarray as xr

Section = tuple[str, list[str]]
"""(question, lines of the answer)."""
LARGEST_CONTRAST = 0.5
"""Root mean square of the density about its mean, relative to it, up to which linear theory predicts one: a Gaussian of that
width would hardly ever be negative. Particles have 0.35 where it expects 0.39, and 0.44 where it would expect 0.79
(docs/clusters_measured.md)."""
HIGHEST_MATRIX, SHORTEST_MATRIX = 6.0, 5.0
"""The largest R* and k* at which the growth of the norm is told: its matrix exponentials take a second or less up to there. That
of the density has a closed form at any."""


def linear_theory(scene: Scene, modes: Iterable[int] = FIRST_MODES) -> xr.Dataset:
    """`growth_rates`, the structure factor and the largest transient growth of a density wave; dims (mode,).

    `wave_amplitude` is the root mean square of A in ρ(1 + A cos(kx + phase)) by the noise of N = `particles.count`: 2√(S(k)/N).
    Raises SceneError without friction and noise.
    """
    numbers = mode_numbers(modes)
    dataset = growth_rates(scene, numbers)
    dataset["structure_factor"] = structure_factor(scene, numbers)
    largest, when = [], []
    for mode in numbers:
        gain, time = largest_density_gain(scene, mode)
        largest.append(math.sqrt(gain))
        when.append(time)
    noise = 2 * np.sqrt(dataset["structure_factor"].values / scene.particles.count)
    for name, values, long_name, units in (
        ("largest_growth", largest, "largest transient growth of a density wave, √max G_ρ", "1"),
        ("time_of_largest_growth", when, "time of the largest transient growth", "time"),
        ("wave_amplitude", noise, "rms relative amplitude of a density wave by particle noise", "1"),
    ):
        dataset[name] = ("mode", np.array(values), {"long_name": long_name, "units": units})
    dataset.attrs["particles"] = scene.particles.count
    return dataset


def verdict(scene: Scene, theory: xr.Dataset) -> list[Section]:
    """Sections (question, lines of the answer), from `linear_theory`."""
    return [
        ("Homogeneous flow", _flow(scene)),
        ("Mode by mode", _table(scene, theory)),
        ("1. Is the paper's three-moment closure, (3)-(5), unstable?", _closure(scene, theory)),
        ("2. Is the kinetic equation (2) unstable?", _kinetic(scene, theory)),
        ("3. How much can a small disturbance grow before it decays?", _growth(scene, theory)),
        ("4. What do the fluctuations of N particles look like?", _noise(scene, theory)),
    ]


def _flow(scene: Scene) -> list[str]:
    flow, units = flow_of(scene)
    kind = "follow-the-leader collisions (6)" if scene.operator == FOLLOW_LEADER else "inelastic collisions (12)"
    if scene.operator is None:
        kind = "no collisions"
    elif scene.operator != FOLLOW_LEADER:
        kind += f", ε = {scene.restitution:g}"
    groups = scene.groups
    return [
        f"{kind};  R* = S ρ √σ/γ = {groups.collision_number if scene.operator else 0:.6g};  k* = {groups.wavenumber:.6g} n",
        f"u_h = {units.mean_velocity:.8g}, θ_h = {flow.temperature * units.sigma:.8g}",
    ]


def _table(scene: Scene, theory: xr.Dataset) -> list[str]:
    rho = scene.initial.density
    columns = [
        ("mode", ""),
        ("wave-", "length"),
        ("closure's", "ρ_c"),
        ("the scene's", f"ρ = {rho:.4g} is"),
        ("Re s, closure", "(3)-(5)"),
        ("Re s, kinetic", "(2)"),
        ("largest", "growth"),
        ("structure", "factor S"),
        ("rms amplitude", f"N = {scene.particles.count:.3g}"),
    ]
    rows = []
    for n in theory["mode"].values:
        row = {name: float(value) for name, value in theory.sel(mode=n).data_vars.items()}
        none = math.isinf(row["critical_density"])
        rows.append(
            [
                f"{n}",
                f"{scene.pipe.length / n:.4g}",
                "none" if none else f"{row['critical_density']:.6g}",
                "" if none else "above" if rho > row["critical_density"] else "below",
                f"{row['closure_growth_rate']:.5g}",
                "not computed" if math.isnan(row["kinetic_growth_rate"]) else f"{row['kinetic_growth_rate']:.5g}",
                f"{row['largest_growth']:.4g}",
                f"{row['structure_factor']:.5g}",
                _percent(row["wave_amplitude"]),
            ]
        )
    lines = [list(part) for part in zip(*columns, strict=True)] + rows
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    return ["  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)) for line in lines]


def _closure(scene: Scene, theory: xr.Dataset) -> list[str]:
    if scene.operator != FOLLOW_LEADER:
        return ["No, at no density: every root of its cubic decays."]
    return [
        *closure_in_words(scene),
        "A property of the closure, not of equation (2): with more moments ρ_c moves up without bound (docs/stability.md).",
    ]


def closure_in_words(scene: Scene) -> list[str]:
    """Whether the paper's closure of follow-the-leader collisions is unstable, and which waves of the pipe grow.

    Each wave has a critical density of its own, the lower the shorter it is; "the" critical density is the lowest of them.
    """
    number, rho = scene.groups.collision_number, scene.initial.density
    lowest = SHORTEST * rho / number
    where = f"the lowest critical density, ρ_c = {lowest:.6g}, which is that of the shortest waves"
    if number <= SHORTEST:
        return [f"No: the scene's ρ = {rho:g} is below {where}."]
    first = math.floor(min(marginal_wavenumber(number) / scene.groups.wavenumber, 1e15)) + 1
    if first == 1:
        grow = "Every wave of the pipe grows."
    else:
        own = critical_density(scene, first - 1)
        longer = "mode 1, a longer wave" if first == 2 else f"modes 1-{first - 1}, longer waves"
        grow = f"Waves from mode {first} on grow; {longer}, decay{'s' * (first == 2)}: ρ_c of mode {first - 1} is {own:.6g}."
    return [f"Yes: the scene's ρ = {rho:g} is above {where}.", grow]


def _kinetic(scene: Scene, theory: xr.Dataset) -> list[str]:
    rates = theory["kinetic_growth_rate"].values
    uncertainty = theory["kinetic_uncertainty"].values
    if np.isnan(rates).all():
        return ["Not computed: waves so short are beyond the numerical spectrum of inelastic collisions."]
    slowest = int(np.nanargmax(rates))
    mode = int(theory["mode"][slowest])
    how = "exactly" if not uncertainty.any() else f"to {uncertainty[slowest]:.1e}"
    if rates[slowest] > uncertainty[slowest]:
        return [f"Yes: mode {mode} grows as exp({rates[slowest]:.5g} t), known {how}."]
    if not (rates + uncertainty < 0)[~np.isnan(rates)].all():
        return [f"Not known: Re s of mode {mode} is {rates[slowest]:.2g}, uncertain by {uncertainty[slowest]:.1e}."]
    known = theory["mode"].values[~np.isnan(rates)]
    if known.size < rates.size:
        lines = [
            f"No growing wave in modes {_ranges(known)}; short waves of the others are beyond the numerical spectrum.",
            f"The slowest, mode {mode}, decays as exp({rates[slowest]:.6g} t), known {how}.",
        ]
    else:
        lines = [f"No: every wave decays in the end. The slowest, mode {mode}, as exp({rates[slowest]:.6g} t), known {how}."]
    if scene.operator == INELASTIC:
        lines.append("With inelastic collisions this is a numerical finding: no growing wave was found up to R* = 300.")
    elif scene.operator == FOLLOW_LEADER:
        lines.append("With follow-the-leader collisions it is so at every density: Re s = -nγ - σk²/γ, n = 0, 1, 2, …")
    return lines


def _growth(scene: Scene, theory: xr.Dataset) -> list[str]:
    growth = theory["largest_growth"].values
    best = int(np.argmax(growth))
    lines = ["A density wave not at all, against a plain one of the same norm (∫|δf|²/M dv)^(1/2), M the Maxwellian."]
    if growth[best] > 1 + 1e-6:
        mode, when = int(theory["mode"][best]), float(theory["time_of_largest_growth"][best])
        lines = [
            f"A density wave to {growth[best]:.4g} times a plain one of the same norm (∫|δf|²/M dv)^(1/2), M the Maxwellian:",
            f"mode {mode}, at t = {when:.3g}, from a wave of slow particles.",
        ]
    if scene.groups.collision_number <= HIGHEST_MATRIX and scene.groups.wavenumber <= SHORTEST_MATRIX:
        grown = transient_growth(scene, 1, growth_times(scene, 1, 40))
        gain, times = grown["gain"].values, grown["time"].values
        largest, when = math.sqrt(gain.max()), times[gain.argmax()]
        lines.append(f"The norm of δf itself to {largest:.4g} times its initial value in mode 1, at t = {when:.3g}.")
    return lines


def _noise(scene: Scene, theory: xr.Dataset) -> list[str]:
    count = scene.particles.count
    factors = theory["structure_factor"].values
    contrast, ideal = math.sqrt(2 * factors.sum() / count), math.sqrt(2 * factors.size / count)
    if contrast <= LARGEST_CONTRAST:
        lines = [
            f"With N = {count} (particles.count) the density, modes 1 to 8 together, deviates by {_percent(contrast)} rms;",
            f"that of an ideal gas by {_percent(ideal)}. A mode's amplitude is 2√(S/N) rms.",
        ]
    else:
        lines = [
            f"With N = {count} (particles.count) linear theory has left its range: waves are no longer small, and it says",
            f"nothing of how large. Those of an ideal gas are {_percent(ideal)} rms. Expect large ones of particles where (2)",
            "has none.",
        ]
    apparent = apparent_critical_density(scene, count)
    if math.isfinite(apparent):
        number = apparent * scene.groups.collision_number / scene.initial.density
        lines.append(f"Mode 1 has S = N, waves of order one, at ρ = {apparent:.5g}, R* = {number:.4g}:")
        lines.append("an apparent critical density, which grows with N.")
    return lines


def _percent(value: float) -> str:
    """No number where linear theory has left its range."""
    return f"{100 * value:.3g} %" if value <= LARGEST_CONTRAST else "out of range"


def _ranges(numbers: np.ndarray) -> str:
    """1, 2, 3, 7 → "1-3, 7"."""
    parts: list[list[int]] = []
    for n in map(int, numbers):
        if parts and n == parts[-1][1] + 1:
            parts[-1][1] = n
        else:
            parts.append([n, n])
    return ", ".join(f"{a}-{b}" if b > a else f"{a}" for a, b in parts)
