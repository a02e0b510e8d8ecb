"""Errors in time of runs with operator (12), on the scenes of random_scenes.py: what their steps make of what rtol allows.

The grid is the plan's, and stays; the truth is the same grid at steps so short that they have no error. For Lawson's method and
the exponential one: seconds, and the largest error of f and of θ over rtol times their maxima at four times. It should be below
1, for the grid errs too, and above 0.05, or steps are wasted. Prints a table and how many lie between, of the method that the
plan chooses as well, and fails where an error exceeds 1.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import dataclasses
import itertools
import sys
import time
import warnings

import numpy as np

from benchmarks.random_scenes import random_scene
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.operators.moments import moments
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.scene import INELASTIC, SteppingScheme
from kinetic_solver.solver.scheme import assemble
from kinetic_solver.stepping import Extrapolated, Fixed, Stalled, Stepper, lawson
from kinetic_solver.threads import one_blas_thread

TIMES = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Of the run."""
SHORT = (0.15, 0.7)
"""Of the first step, and over the collision frequency at the window's edge: steps of the truth, of order 5."""
METHODS: tuple[SteppingScheme, ...] = ("extrapolated", "exponential")
WANTED = (0.05, 1.0)


def states(stepper: Stepper, f: Array, end: float) -> list[Array]:
    """At the times, from one to the next as a run goes on over its frames."""
    found, memory = [], stepper.begin(f, 0.0)
    for before, after in itertools.pairwise(TIMES):
        elapsed, interval = 0.0, (after - before) * end
        while elapsed < interval:
            step = stepper.step(f, memory, before * end, interval)
            if isinstance(step, Stalled):
                memory = step.accepting
                continue
            f, memory, elapsed = step.state, step.memory, step.elapsed
        found.append(f)
    return found


def truth(plan: Plan, f: Array) -> list[Array]:
    scheme = assemble(dataclasses.replace(plan, stepping="extrapolated"))
    assert scheme.operator is not None
    longest = min(SHORT[0] * plan.first_step, SHORT[1] / (plan.scales.collision_rate * plan.scales.tail))
    method = Extrapolated(lawson(scheme.operator.rate, scheme.representation.linear), (1, 2))
    return states(Fixed(method, longest), f, plan.scales.end)


def distance(plan: Plan, f: Array, right: Array) -> float:
    """Of f or of θ, over their maxima."""
    theta, expected = (moments(plan.grid, values).temperature for values in (f, right))
    return max(float(np.abs(f - right).max() / right.max()), float(np.abs(theta - expected).max() / expected.max()))


def main() -> int:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    errors: dict[str, list[float]] = {name: [] for name in (*METHODS, "chosen")}
    print("| seed | rtol | nx × nv | chosen | Lawson: error/rtol, s | exponential: error/rtol, s |\n|---|---|---|---|---|---|")
    for seed, rtol in itertools.product(range(22), (1e-3, 1e-4)):
        try:
            plan = make_plan(random_scene(seed, rtol, INELASTIC))
        except SceneError:
            continue
        if plan.velocity != "points":
            continue
        start = assemble(plan).representation.start()
        right, cells = truth(plan, start), []
        for name in METHODS:
            began = time.process_time()
            found = states(assemble(dataclasses.replace(plan, stepping=name)).stepper, start, plan.scales.end)
            seconds = time.process_time() - began
            error = max(distance(plan, a, b) for a, b in zip(found, right, strict=True)) / rtol
            errors[name].append(error)
            if name == plan.stepping:
                errors["chosen"].append(error)
            cells.append(f"{error:.2g}, {seconds:.2g}")
        print(f"| {seed} | {rtol:g} | {plan.grid.nx} × {plan.grid.nv} | {plan.stepping} | {cells[0]} | {cells[1]} |", flush=True)
    for name, all_of in errors.items():
        found = np.array(all_of)
        inside = float(np.mean((found > WANTED[0]) & (found < WANTED[1])))
        quartiles = ", ".join(f"{value:.2g}" for value in np.quantile(found, (0.25, 0.5, 0.75)))
        print(f"\n{name}: at most {found.max():.2g}; quartiles {quartiles}; {inside:.0%} from {WANTED[0]} to {WANTED[1]}")
    return int(max(max(found) for found in errors.values()) > 1)


if __name__ == "__main__":
    with one_blas_thread():
        sys.exit(main())
