"""Particles against the grid solver, the closed form and linear theory; convergence in step, cell width and number.

    python -m benchmarks.particles_validation [homogeneous against_the_grid step_errors cell_errors few_particles fluctuations]

Prints the tables of docs/particles_measured.md and asserts what they say.
"""

from __future__ import annotations

import functools
import math
import sys
import time
from typing import Any

import numpy as np

from kinetic_solver import Scene, exact, solve
from kinetic_solver.stability import kinetic_rates
from kinetic_solver.stability import structure_factor as theory
from particles import simulate
from particles.estimators import frequency_spectrum, structure_factor
from particles.simulation import Simulation, make_plan

GAMMA, SIGMA, RHO, LENGTH = 0.7, 0.5, 0.8, 9.0
FIELDS = ("density", "mean_velocity", "temperature")
SEEDS = 10
NX = 17
LOW = 4
SMALL = 2.5
Cases = tuple[tuple[float, float | None], ...]
CASES: Cases = ((0.3, None), (1.0, None), (1.0, 0.5), (1.0, 0.0))
STEP_ERROR, CELL_ERROR = 0.1, 0.025
"""Bounds of a field's systematic error over its scale, over q² and c²: q the step times the fastest rate, c the cells' width over
the shortest length of `make_plan`. About twice what is measured here at R* = 0.3 and 1 and with (12)."""


def collisions(number: float, restitution: float | None) -> dict[str, Any]:
    table: dict[str, Any] = {"operator": "follow-the-leader", "cross_section": number * GAMMA / math.sqrt(SIGMA) / RHO}
    return table if restitution is None else {**table, "operator": "inelastic", "restitution": restitution}


def scene(number: float, restitution: float | None, **changes: Any) -> Scene:
    data: dict[str, Any] = {
        "model": {"gravity": 1.3, "friction": GAMMA, "noise": SIGMA},
        "collisions": collisions(number, restitution),
        "pipe": {"length": LENGTH},
        "initial": {
            "density": RHO,
            "mean_velocity": 0.9,
            "temperature": 0.4,
            "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}],
        },
        "run": {"end_time": 1.5},
        "output": {"budgets": False},
    }
    for key, value in changes.items():
        data[key] = {**data.get(key, {}), **value}
    return Scene.model_validate(data)


@functools.cache
def truth(number: float, restitution: float | None) -> dict[str, np.ndarray]:
    """The fields at the end on NX points: by the closed form for (6), by the grid solver at rtol = 1e-6 for (12)."""
    if restitution is None:
        run = exact.solve(scene(number, restitution, grid={"nx": 65}))
    else:
        run = solve(scene(number, restitution, accuracy={"rtol": 1e-6}))
    found = {}
    for name in FIELDS:
        values = run[name].values[-1]
        waves = np.fft.rfft(values) / values.size
        found[name] = np.fft.irfft(waves[: NX // 2 + 1] * NX, n=NX)
    return found


def against_the_grid() -> None:
    print(
        f"\nmean z² over {NX} points, three fields and {SEEDS} seeds of 8 replicas (7/5 expected), largest bias of the density\n"
    )
    print("| operator | R* | particles in all | mean z² | ± | largest bias of ρ/ρ̄ | ± |\n|---|---|---|---|---|---|---|")
    for number, restitution, count in (
        (0.3, None, 20_000),
        (1.0, None, 20_000),
        (2.0, None, 20_000),
        (3.0, None, 20_000),
        (3.0, None, 500_000),
        (1.0, 0.0, 20_000),
        (1.0, 0.5, 20_000),
        (1.0, 0.9, 20_000),
    ):
        expected = truth(number, restitution)
        seeds = SEEDS if count < 100_000 else 2
        squares, errors = [], []
        for seed in range(1, seeds + 1):
            run = simulate(
                scene(number, restitution, grid={"nx": NX, "nv": 32}, particles={"count": count, "replicas": 8, "seed": seed})
            )
            z = [((run[name].values[-1] - expected[name]) / run[f"{name}_stderr"].values[-1]) ** 2 for name in FIELDS]
            squares.append(np.mean(z))
            errors.append((run["density"].values[-1] - expected["density"]) / RHO)
        mean, spread = np.mean(squares), np.std(squares, ddof=1) / math.sqrt(seeds)
        bias, sampling = np.mean(errors, axis=0), np.std(errors, axis=0, ddof=1) / math.sqrt(seeds)
        name = "follow-the-leader" if restitution is None else f"inelastic, ε = {restitution:g}"
        worst = int(np.abs(bias).argmax())
        print(
            f"| {name} | {number:g} | {8 * count * seeds:.3g} | {mean:.2f} | {spread:.2f} |"
            f" {bias[worst]:+.4f} | {sampling[worst]:.4f} |",
            flush=True,
        )
        if number <= 1:
            assert abs(mean - 1.4) < 4 * spread + 0.1, mean


def deviations(number: float, restitution: float | None, particles: dict[str, Any], seeds: int) -> dict[str, np.ndarray]:
    """Fields at the end less the truth, over their scales, (seed, NX) each; scales: ρ̄, the largest of |u| and √θ, mean θ.

    Only waves up to `LOW` are kept: they hold what step, cells and N do, and a quarter to a half of what sampling does.
    """
    expected = truth(number, restitution)
    theta = expected["temperature"]
    scales = (RHO, max(np.abs(expected["mean_velocity"]).max(), math.sqrt(theta.max())), theta.mean())
    found: dict[str, list[np.ndarray]] = {name: [] for name in FIELDS}
    for seed in range(1, seeds + 1):
        ensemble = {"replicas": 8, **particles, "seed": seed}
        run = simulate(scene(number, restitution, grid={"nx": NX, "nv": 32}, particles=ensemble))
        for name, scale in zip(FIELDS, scales, strict=True):
            waves = np.fft.rfft((run[name].values[-1] - expected[name]) / scale)
            waves[LOW + 1 :] = 0
            found[name].append(np.fft.irfft(waves, n=NX))
    return {name: np.array(values) for name, values in found.items()}


def systematic(d: np.ndarray) -> tuple[float, float]:
    """√(rms² - sampling²) of deviations d (seed, NX), negative for the root of a negative square, and its standard error.

    The square is the mean over pairs of different seeds of their product, to which sampling adds nothing on average: the same
    as the mean seed's rms² less its sampling² from the seeds' scatter. Error by the jackknife over seeds.
    """
    products = d @ d.T / d.shape[1]

    def square(kept: np.ndarray) -> float:
        p = products[np.ix_(kept, kept)]
        return float((p.sum() - np.trace(p)) / (len(kept) * (len(kept) - 1)))

    seeds = np.arange(len(d))
    value = square(seeds)
    without = np.array([square(np.delete(seeds, n)) for n in seeds])
    error = math.sqrt((len(d) - 1) * np.mean((without - without.mean()) ** 2))
    root = math.copysign(math.sqrt(abs(value)), value)
    return root, min(error / (2 * abs(root)), math.sqrt(error))


def step_errors(cases: Cases = CASES) -> None:
    """The step alone, on 200 cells, against STEP_ERROR q²."""
    convergence("q", STEP_ERROR, [{"cells": 200, "time_step": 1.5 / n} for n in (1, 2, 3, 4, 6)], cases)


def cell_errors(cases: Cases = CASES) -> None:
    """The cells' width alone, at steps of 0.1, against CELL_ERROR c²."""
    convergence("c", CELL_ERROR, [{"cells": n, "time_step": 0.1} for n in (6, 8, 12)], cases)


def convergence(what: str, bound: float, runs: list[dict[str, Any]], cases: Cases) -> None:
    """Systematic errors of each run, by its step or cell width; the order that the fields show; asserts once all is printed.

    Sizes are those of the plan: `relative_step` and `relative_width`. Orders are of sizes below `SMALL`.
    """
    print("\nsystematic error: density, mean velocity, temperature over their scales; 4 seeds of 8 replicas of 200000\n")
    print(f"| operator | R* | {what} | density | ± | mean velocity | ± | temperature | ± | largest/{what}² | ± |")
    print("|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    beyond, orders = [], []
    for number, restitution in cases:
        name = "follow-the-leader" if restitution is None else f"inelastic, ε = {restitution:g}"
        sizes, roots, doubts = [], [], []
        for particles in runs:
            plan = make_plan(scene(number, restitution, particles=particles))
            size = plan.relative_step if what == "q" else plan.relative_width
            d = deviations(number, restitution, {"count": 200_000, **particles}, 4)
            parts = [systematic(d[field]) for field in FIELDS]
            means = np.array([d[field].mean(axis=0) for field in FIELDS])
            sampling = np.array([d[field].std(axis=0, ddof=1) / 2 for field in FIELDS])
            worst = np.unravel_index(np.abs(means).argmax(), means.shape)
            largest, doubt = abs(means[worst]) / size**2, sampling[worst] / size**2
            values = " | ".join(f"{root:.5f} | {error:.5f}" for root, error in parts)
            print(f"| {name} | {number:g} | {size:.2f} | {values} | {largest:.4f} | {doubt:.4f} |", flush=True)
            if largest > bound + 3 * doubt:
                beyond.append((name, number, size, largest))
            sizes.append(size)
            roots.append([root for root, _ in parts])
            doubts.append([error for _, error in parts])
        for n, field in enumerate(FIELDS):
            root, doubts_of = np.array(roots)[:, n], np.array(doubts)[:, n]
            seen = (root > 3 * doubts_of) & (np.array(sizes) < SMALL)
            if seen.sum() < 3:
                continue
            x, weights = np.log(np.array(sizes)[seen]), root[seen] / doubts_of[seen]
            order = float(np.polyfit(x, np.log(root[seen]), 1, w=weights)[0])
            spread = 1 / math.sqrt(np.sum(weights**2 * (x - np.average(x, weights=weights**2)) ** 2))
            print(f"order of the {field.replace('_', ' ')}: {order:.2f} ± {spread:.2f}, from {seen.sum()} sizes", flush=True)
            # A less certain order does not tell the second from the first or third
            if spread < 0.25:
                orders.append(order)
    assert not beyond, beyond
    assert orders
    assert all(1.5 < order < 2.6 for order in orders), orders


def few_particles() -> None:
    """The bias of few particles, 1/N: u and θ of the homogeneous gas, stationary, and the fields of the scene at its end."""
    print("\nfollow-the-leader, R* = 1, L* = 8π, stationary: relative bias of S ρσ/γ in u, and of θ; 40 replicas\n")
    print("| N | b_N | drag | ± | drag/b_N | temperature | ± | temperature/b_N |\n|---|---|---|---|---|---|---|---|", flush=True)
    length = 8 * math.pi * math.sqrt(SIGMA) / GAMMA
    biases = []
    for count, duration in ((300, 200), (1000, 200), (3000, 300)):
        changes = {
            "pipe": {"length": length},
            "initial": {"modes": [], "mean_velocity": None, "temperature": None},
            "run": {"end_time": (30 + duration) / GAMMA},
            "particles": {"count": count, "replicas": 40, "seed": 3, "cells": 100, "time_step": 0.03 / GAMMA},
        }
        plan = make_plan(scene(1.0, None, **changes))
        simulation = Simulation(plan)
        u, square = [], []
        for n in range(2 * duration):
            simulation.advance_to((30 + (n + 1) / 2) / GAMMA)
            u.append([e.v.mean() for e in simulation.ensembles])
            square.append([(e.v**2).mean() for e in simulation.ensembles])
        mean = np.mean(u, axis=0)
        drag = (mean - 1.3 / GAMMA) / -math.sqrt(SIGMA) - 1
        theta = (np.mean(square, axis=0) - mean**2) / SIGMA - 1
        b = 2 / count * float((theory(plan.scene, range(1, 101)).values - 1).sum())
        parts = [(values.mean(), values.std(ddof=1) / math.sqrt(40)) for values in (drag, theta)]
        print(
            f"| {count} | {b:.4f} | " + " | ".join(f"{x:+.5f} | {error:.5f} | {x / b:+.3f}" for x, error in parts) + " |",
            flush=True,
        )
        biases.append(parts[1])
        assert all(abs(x) < b for x, _ in parts)
    order = math.log(biases[0][0] / biases[-1][0]) / math.log(10)
    doubt = math.hypot(biases[0][1] / biases[0][0], biases[-1][1] / biases[-1][0]) / math.log(10)
    print(f"θ's bias falls as N^-{order:.2f} ± {doubt:.2f}", flush=True)
    assert 0.7 < order < 1.3

    print("\nthe scene of the tables above, N particles in 51 cells, step 0.05: systematic error of 8 groups of replicas\n")
    print("| R* | N | replicas | b_N | density | ± | mean velocity | ± | temperature | ± |")
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for number, restitution, count, replicas in ((1.0, None, 100, 300), (1.0, None, 300, 200), (1.0, 0.5, 100, 300)):
        particles = {"count": count, "replicas": replicas, "cells": 51, "time_step": 0.05}
        d = deviations(number, restitution, particles, 8)
        b = 2 / count * float((theory(scene(number, restitution), range(1, 52)).values - 1).sum())
        parts = [systematic(d[name]) for name in FIELDS]
        print(
            f"| {number:g}{'' if restitution is None else ', (12)'} | {count} | {8 * replicas} | {b:.3f} | "
            + " | ".join(f"{root:.4f} | {error:.4f}" for root, error in parts)
            + " |",
            flush=True,
        )
        assert all(root < b + 3 * error for root, error in parts)


def amplitudes(
    number: float, restitution: float | None, count: int, duration: float, every: float = 0.5
) -> tuple[Scene, np.ndarray]:
    """Amplitudes (time, replica, mode) of the first eight waves of a stationary homogeneous gas, L* = 8π, every 0.5/γ.

    16 replicas, steps of 1/(20γ), cells of 0.063 √σ/γ.
    """
    length = 8 * math.pi * math.sqrt(SIGMA) / GAMMA
    changes = {
        "pipe": {"length": length},
        "initial": {"modes": [], "mean_velocity": None, "temperature": None},
        "run": {"end_time": (40 + duration) / GAMMA},
        "particles": {"count": count, "replicas": 16, "seed": 11, "cells": 400, "time_step": 1 / (20 * GAMMA)},
    }
    plan = make_plan(scene(number, restitution, **changes))
    simulation = Simulation(plan)
    simulation.advance_to(40 / GAMMA)
    wave = -2j * np.pi / length
    c = np.empty((round(duration / every), 16, 8), dtype=complex)
    for n in range(len(c)):
        simulation.advance_to((40 + (n + 1) * every) / GAMMA)
        for r, ensemble in enumerate(simulation.ensembles):
            first = np.exp(wave * ensemble.x)
            power = first.copy()
            for m in range(8):
                c[n, r, m] = power.mean()
                power *= first
    return plan.scene, c


def fluctuations() -> None:
    """S(k) of stationary homogeneous gases, what few particles do to it, and the frequency spectrum of the density."""
    print("\nS(k), 16 replicas; mean of measured/theory over the eight modes, the n-th with weight n\n")
    print("| operator | R* | N | mode | measured | ± | theory | z |\n|---|---|---|---|---|---|---|---|", flush=True)
    modes = np.arange(1, 9)
    means = []
    for number, restitution, count, duration in (
        (0.5, None, 20_000, 150),
        (1.0, None, 20_000, 150),
        (1.347, None, 20_000, 300),
        (1.347, None, 5_000, 600),
        (1.0, 0.5, 20_000, 150),
    ):
        described, c = amplitudes(number, restitution, count, duration)
        measured, error = structure_factor(c, count)
        expected = theory(described, modes).values
        name = "follow-the-leader" if restitution is None else f"inelastic, ε = {restitution:g}"
        for m in range(8):
            z = (measured[m] - expected[m]) / error[m]
            print(
                f"| {name} | {number:g} | {count} | {m + 1} | {measured[m]:.3f} | {error[m]:.3f} | {expected[m]:.3f} | {z:+.1f} |"
            )
        ratio = (count * np.abs(c) ** 2).mean(axis=0) / expected @ (modes / modes.sum())
        means.append((ratio.mean(), ratio.std(ddof=1) / math.sqrt(ratio.size)))
        print(f"mean ratio {means[-1][0]:.4f} ± {means[-1][1]:.4f}", flush=True)
        if number <= 1:
            assert np.mean(((measured - expected) / error) ** 2) < 3
        if number == 1.0 and restitution is None:
            omega, spectrum, _ = frequency_spectrum(c, count, 0.5 / GAMMA)
            s = kinetic_rates(described, 1)[0][0]
            peak = omega[int(spectrum[:, 0].argmax())]
            far = np.abs(np.abs(omega + s.imag) / abs(s.real))
            slope = np.polyfit(np.log(far[(far > 3) & (far < 20)]), np.log(spectrum[(far > 3) & (far < 20), 0]), 1)[0]
            print(f"spectrum of mode 1: peak at ω = {peak:.3f} (theory {-s.imag:.3f});")
            print(f"falls as |ω - ω_0|^{slope:.2f} from 3 to 20 widths", flush=True)
    # At R* = 1.347 correlations of N particles count, as 1/N: without them, from N and N/4
    (many, doubt), (few, doubt_of_few) = means[2:4]
    limit, spread = (4 * many - few) / 3, math.hypot(4 * doubt, doubt_of_few) / 3
    print(f"R* = 1.347, mean ratio for N → ∞: {limit:.4f} ± {spread:.4f}")
    assert abs(limit - 1) < 3 * spread


def homogeneous() -> None:
    """Inelastic collisions at ε = 0.5, R* = 1: θ and the kurtosis of 10^6 particles."""
    data = {
        "model": {"friction": 1.0, "noise": 1.0},
        "collisions": {"operator": "inelastic", "cross_section": 1.0, "restitution": 0.5},
        "pipe": {"length": 20.0},
        "run": {"end_time": 1.0},
        "particles": {"count": 125_000, "replicas": 8, "cells": 400, "time_step": 0.02, "seed": 2},
    }
    simulation = Simulation(make_plan(Scene.model_validate(data)))
    theta, kurtosis = [], []
    for n in range(40):
        simulation.advance_to(6.0 + n)
        v = np.array([e.v - e.v.mean() for e in simulation.ensembles])
        theta.append((v**2).mean(axis=1))
        kurtosis.append((v**4).mean(axis=1) / theta[-1] ** 2)
    for name, values, expected in (("θ", theta, 0.733296), ("kurtosis", kurtosis, 3.05982)):
        per_replica = np.mean(values, axis=0)
        mean, error = per_replica.mean(), per_replica.std(ddof=1) / math.sqrt(8)
        print(f"\ninelastic, ε = 0.5, R* = 1, 10^6 particles: {name} = {mean:.5f} ± {error:.5f} (exact {expected:.5f})")
        assert abs(mean - expected) < 3 * error


def main() -> int:
    """All parts, or those that are named."""
    began = time.perf_counter()
    parts = (homogeneous, against_the_grid, step_errors, cell_errors, few_particles, fluctuations)
    for part in parts:
        if len(sys.argv) < 2 or part.__name__ in sys.argv[1:]:
            part()
        print(f"\n[{time.perf_counter() - began:.0f} s]", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
