"""How often `compare` calls right scenes different, and whether it finds errors of 1 %.

    python -m benchmarks.comparison ["follow-the-leader" | "inelastic"]

Particles, 20 replicas of 50000, against the closed form of (6) until t = 7/γ, and the grid solver's answer for (12) until 28/γ,
where 1 % of S_C changes the variance by a quarter of a percent. Prints the table of docs/compare_measured.md and asserts what it
says.
"""

from __future__ import annotations

import functools
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import xarray as xr

from kinetic_solver import Scene, exact, solve
from kinetic_solver.compare import compare
from particles import simulate

SEEDS = 20
WRONG_SEEDS = 3
LEVEL = 0.01
GRAVITY, NOISE = 1.3, 0.5
END = {"follow-the-leader": 10.0, "inelastic": 40.0}
OPERATORS: dict[str, dict[str, Any]] = {
    "follow-the-leader": {"operator": "follow-the-leader", "cross_section": 1.2},
    "inelastic": {"operator": "inelastic", "cross_section": 1.2, "restitution": 0.5},
}


def scene(name: str, seed: int, **planted: float) -> Scene:
    """`planted` are factors on what the particles are told; seed 0 is the truth's scene."""
    collisions = OPERATORS[name]
    return Scene.model_validate(
        {
            "model": {
                "gravity": GRAVITY * planted.get("gravity", 1.0),
                "friction": 0.7,
                "noise": NOISE * planted.get("noise", 1.0),
            },
            "collisions": {**collisions, "cross_section": collisions["cross_section"] * planted.get("cross_section", 1.0)},
            "pipe": {"length": 9.0},
            "initial": {
                "density": 0.8,
                "mean_velocity": 0.9,
                "temperature": 0.4,
                "modes": [{"mode": 1, "cos": 0.4}, {"mode": 2, "sin": 0.2}],
            },
            "run": {"end_time": END[name], "output_every": 0.5},
            "output": {"f": END[name], "budgets": False},
            "accuracy": {"rtol": 1e-6},
            "grid": {"nx": 17, "nv": 48} if seed else {},
            "particles": {"count": 50_000, "replicas": 20, "seed": seed, "cells": 300, "time_step": 0.025},
        }
    )


@functools.cache
def truth(name: str) -> xr.Dataset:
    right = scene(name, seed=0)
    return exact.solve(right) if name == "follow-the-leader" else solve(right)


def verdict(name: str, planted: tuple[tuple[str, float], ...], seed: int) -> tuple[float, bool]:
    """(p, whether they differ)."""
    found = compare(truth(name), simulate(scene(name, seed, **dict(planted))), LEVEL)
    return found.p, found.differ


def main() -> None:
    print(
        "| operator | particles are told | seeds | said to differ | least p | largest p |\n|---|---|---|---|---|---|", flush=True
    )
    cases: list[tuple[str, tuple[tuple[str, float], ...]]] = [
        ("the scene", ()),
        ("S_C 1 % larger", (("cross_section", 1.01),)),
        ("σ 1 % larger", (("noise", 1.01),)),
        ("−g", (("gravity", -1.0),)),
    ]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for name in sys.argv[1:] or OPERATORS:
            for what, planted in cases:
                seeds = WRONG_SEEDS if planted else SEEDS
                found = list(pool.map(functools.partial(verdict, name, planted), range(1, seeds + 1)))
                p, differ = [p for p, _ in found], sum(d for _, d in found)
                print(f"| {name} | {what} | {seeds} | {differ} | {min(p):.2g} | {max(p):.2g} |", flush=True)
                if planted:
                    assert differ == seeds, what
                else:
                    assert differ <= 1  # of 20 at the rate of 1 %: two or more have a probability of 0.017


if __name__ == "__main__":
    main()
