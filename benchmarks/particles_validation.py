"""Particles against the grid solver, the closed form and linear theory; convergence in step, cell width and number.

    python -m benchmarks.particles_validation

Prints the tables of docs/particles.md and asserts what they say.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import numpy as np

from kinetic_solver import Scene, exact, solve
from kinetic_solver.stability import structure_factor as theory
from particles import simulate
from particles.estimators import frequency_spectrum, structure_factor
from particles.simulation import Simulation, make_plan

GAMMA, SIGMA, RHO, LENGTH = 0.7, 0.5, 0.8, 9.0
FIELDS = ("density", "mean_velocity", "temperature")
SEEDS = 10
NX = 17


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
        name = "(6)" if restitution is None else f"(12), ε = {restitution:g}"
        worst = int(np.abs(bias).argmax())
        print(
            f"| {name} | {number:g} | {8 * count * seeds:.3g} | {mean:.2f} | {spread:.2f} |"
            f" {bias[worst]:+.4f} | {sampling[worst]:.4f} |",
            flush=True,
        )
        if number <= 1:
            assert abs(mean - 1.4) < 4 * spread + 0.1, mean


def convergence() -> None:
    """The density at R* = 1 with longer steps, wider cells, fewer particles."""
    expected = truth(1.0, None)["density"] / RHO
    print("\n(6) at R* = 1: rms error of ρ/ρ̄ over the pipe, and what sampling alone makes of it\n")
    print("| particles | cells | Δx/(mean free path) | γ·step | rms error | sampling |\n|---|---|---|---|---|---|")
    for count, cells, step in (
        (400_000, 51, None),
        (400_000, 51, 0.3),
        (400_000, 51, 0.75),
        (400_000, 51, 1.5),
        (400_000, 12, None),
        (400_000, 6, None),
        (400_000, 3, None),
        (40_000, 51, None),
        (4_000, 51, None),
        (400, 20, None),
    ):
        particles = {"count": count, "replicas": 8, "seed": 5, "cells": cells, **({"time_step": step} if step else {})}
        plan = make_plan(scene(1.0, None, grid={"nx": NX, "nv": 32}, particles=particles))
        run = simulate(plan.scene)
        error = float(np.sqrt(np.mean((run["density"].values[-1] / RHO - expected) ** 2)))
        sampling = float(np.sqrt(np.mean((run["density_stderr"].values[-1] / RHO) ** 2)))
        print(
            f"| 8 × {count} | {cells} | {plan.cell_width / plan.mean_free_path:.3g} | {GAMMA * plan.time_step:.3g} |"
            f" {error:.2e} | {sampling:.1e} |",
            flush=True,
        )


def fluctuations() -> None:
    """S(k) of stationary homogeneous gases, and the frequency spectrum of the density."""
    print("\nS(k) of N = 20000 particles, 8 replicas, over a time of 150/γ\n")
    print("| operator | R* | mode | measured | ± | theory | z |\n|---|---|---|---|---|---|---|")
    length = 8 * math.pi * math.sqrt(SIGMA) / GAMMA
    for number, restitution in ((0.5, None), (1.0, None), (1.347, None), (1.0, 0.5)):
        changes = {
            "pipe": {"length": length},
            "initial": {"modes": [], "mean_velocity": None, "temperature": None},
            "run": {"end_time": 190.0 / GAMMA},
            "particles": {"count": 20_000, "replicas": 8, "seed": 11, "cells": 200, "time_step": 0.1},
        }
        plan = make_plan(scene(number, restitution, **changes))
        simulation = Simulation(plan)
        simulation.advance_to(40 / GAMMA)
        every, modes = 0.5 / GAMMA, np.arange(1, 9)
        waves = -2j * np.pi * modes / length
        c = np.empty((300, 8, modes.size), dtype=complex)
        for n in range(len(c)):
            simulation.advance_to(40 / GAMMA + (n + 1) * every)
            for r, ensemble in enumerate(simulation.ensembles):
                first = np.exp(waves[0] * ensemble.x)
                power = first.copy()
                for m in range(modes.size):
                    c[n, r, m] = power.mean()
                    power *= first
        measured, error = structure_factor(c, 20_000)
        expected = theory(plan.scene, modes).values
        name = "(6)" if restitution is None else f"(12), ε = {restitution:g}"
        for m in (0, 1, 2, 4, 7):
            z = (measured[m] - expected[m]) / error[m]
            print(
                f"| {name} | {number:g} | {m + 1} | {measured[m]:.3f} | {error[m]:.3f} | {expected[m]:.3f} | {z:+.1f} |",
                flush=True,
            )
        assert np.mean(((measured - expected) / error) ** 2) < 4
        if number == 1.0 and restitution is None:
            omega, spectrum, _ = frequency_spectrum(c, 20_000, every)
            from kinetic_solver.stability import kinetic_rates

            s = kinetic_rates(plan.scene, 1)[0][0]
            peak = omega[int(spectrum[:, 0].argmax())]
            far = np.abs(np.abs(omega + s.imag) / abs(s.real))
            slope = np.polyfit(np.log(far[(far > 3) & (far < 20)]), np.log(spectrum[(far > 3) & (far < 20), 0]), 1)[0]
            print(f"\nspectrum of mode 1: peak at ω = {peak:.3f} (theory {-s.imag:.3f});")
            print(f"falls as |ω - ω_0|^{slope:.2f} from 3 to 20 widths")


def homogeneous() -> None:
    """(12) at ε = 0.5, R* = 1: θ and the kurtosis of 10^6 particles."""
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
        print(f"\n(12), ε = 0.5, R* = 1, 10^6 particles: {name} = {mean:.5f} ± {error:.5f} (exact {expected:.5f})")
        assert abs(mean - expected) < 3 * error


def main() -> int:
    began = time.perf_counter()
    for part in (homogeneous, against_the_grid, convergence, fluctuations):
        part()
        print(f"\n[{time.perf_counter() - began:.0f} s]", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
