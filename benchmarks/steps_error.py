"""Errors in time of runs with operator (12), on the scenes of random_scenes.py: what their steps make of what rtol allows.

The grid is the plan's, and stays; the truth is the same grid at steps so short that they have no error. For Lawson's method and
the exponential one: seconds, the largest error of f and of θ over rtol times their maxima at four times, and the error of f over
what the steps tell of it. The error should be below 1, for the grid errs too, and above 0.05, or steps are wasted; over what is
told it should be from 0.02 to 1. Prints a table and how many lie between, of the method that the plan chooses as well, and fails
where an error exceeds 1.
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
from typing import NamedTuple

import numpy as np

from benchmarks.random_scenes import random_scene
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.operators.moments import moments
from kinetic_solver.plan import Plan, make_plan
from kinetic_solver.scene import INELASTIC, SteppingScheme
from kinetic_solver.solver.estimate import added_up
from kinetic_solver.solver.scheme import assemble
from kinetic_solver.stepping import Extrapolated, Fixed, Stalled, Stepper, lawson
from kinetic_solver.threads import one_blas_thread

TIMES = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Of the run."""
SHORT = (0.15, 0.7)
"""Of the first step, and over the collision frequency at the window's edge: steps of the truth, of order 5."""
METHODS: tuple[SteppingScheme, ...] = ("extrapolated", "exponential")
WANTED, TOLD = (0.05, 1.0), (0.02, 1.0)
"""What error/rtol, and the error over what is told of it, should lie between."""


def states(plan: Plan, stepper: Stepper, f: Array) -> tuple[list[Array], float]:
    """(f at the times, from one to the next as a run goes on over its frames; the most that is told of its error there)."""
    end, found, told = plan.scales.end, [], [0.0]
    memory, so_far = stepper.begin(f, 0.0), 0.0
    for before, after in itertools.pairwise(TIMES):
        elapsed, interval = 0.0, (after - before) * end
        while elapsed < interval:
            step = stepper.step(f, memory, before * end, interval)
            if isinstance(step, Stalled):
                memory = step.accepting
                continue
            f, memory, elapsed = step.state, step.memory, step.elapsed
            so_far = added_up(plan, so_far, step.length, step.error / float(np.abs(f).max()))
        found.append(f)
        told.append(so_far)
    return found, max(told)


def truth(plan: Plan, f: Array) -> list[Array]:
    scheme = assemble(dataclasses.replace(plan, stepping="extrapolated"))
    assert scheme.operator is not None
    longest = min(SHORT[0] * plan.first_step, SHORT[1] / (plan.scales.collision_rate * plan.scales.tail))
    method = Extrapolated(lawson(scheme.operator.rate, scheme.representation.linear), (1, 2))
    return states(plan, Fixed(method, longest), f)[0]


def of_f(f: Array, right: Array) -> float:
    """The largest error over the maximum."""
    return float(np.abs(f - right).max() / right.max())


def distance(plan: Plan, f: Array, right: Array) -> float:
    """Of f or of θ, over their maxima."""
    theta, expected = (moments(plan.grid, values).temperature for values in (f, right))
    return max(of_f(f, right), float(np.abs(theta - expected).max() / expected.max()))


class Judged(NamedTuple):
    """A method on a plan's grid."""

    error: float
    """Of f or of θ, over rtol."""
    over_told: float
    """The error of f over what is told of it."""
    seconds: float


def judged(plan: Plan, right: list[Array]) -> Judged:
    start = assemble(plan).representation.start()
    began = time.process_time()
    found, told = states(plan, assemble(plan).stepper, start)
    seconds = time.process_time() - began
    pairs = list(zip(found, right, strict=True))
    error = max(distance(plan, a, b) for a, b in pairs) / plan.inner.accuracy.rtol
    return Judged(error, max(of_f(a, b) for a, b in pairs) / told, seconds)


def main() -> int:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    results: dict[str, list[Judged]] = {name: [] for name in (*METHODS, "chosen")}
    print("| seed | rtol | nx × nv | chosen | Lawson: error/rtol, error/told, s | exponential |")
    print("|---|---|---|---|---|---|")
    for seed, rtol in itertools.product(range(22), (1e-3, 1e-4)):
        try:
            plan = make_plan(random_scene(seed, rtol, INELASTIC))
        except SceneError:
            continue
        if plan.velocity != "points":
            continue
        right, cells = truth(plan, assemble(plan).representation.start()), []
        for name in METHODS:
            one = judged(dataclasses.replace(plan, stepping=name), right)
            results[name].append(one)
            if name == plan.stepping:
                results["chosen"].append(one)
            cells.append(", ".join(f"{value:.2g}" for value in one))
        print(f"| {seed} | {rtol:g} | {plan.grid.nx} × {plan.grid.nv} | {plan.stepping} | {cells[0]} | {cells[1]} |", flush=True)
    for name, all_of in results.items():
        for what, values, wanted in (
            ("error/rtol", [one.error for one in all_of], WANTED),
            ("error/told", [one.over_told for one in all_of], TOLD),
        ):
            found = np.array(values)
            inside = float(np.mean((found > wanted[0]) & (found < wanted[1])))
            quartiles = ", ".join(f"{value:.2g}" for value in np.quantile(found, (0.25, 0.5, 0.75)))
            most, (low, high) = found.max(), wanted
            print(f"\n{name}, {what}: at most {most:.2g}; quartiles {quartiles}; {inside:.0%} from {low} to {high}")
    return int(max(one.error for all_of in results.values() for one in all_of) > 1)


if __name__ == "__main__":
    with one_blas_thread():
        sys.exit(main())
