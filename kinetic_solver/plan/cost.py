"""How long a run will take on one core of this machine: operations counted from its plan, times what the machine takes for one.

Counted are the products with kernels, the transforms along x, collision pairs, tables of step lengths, what is looked at after
steps, and frames. Not counted: Python's own start and compilation, and what a run does beyond its plan (a grid that it must
enlarge, steps that error control makes shorter). Within a factor of three of what was measured: docs/performance.md, test:
tests/convergence/test_costs.py.
"""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass

import numpy as np

from kinetic_solver.plan import choices, homogeneous, relaxing
from kinetic_solver.plan.plan import Plan

PRODUCT = 2.2e-11
"""Seconds a multiplication and addition of a matrix product takes where the machine's `pace` is 1. Constants of this file were
measured on one core of an AMD EPYC, by `python -m benchmarks.random_kinds`."""
TRANSFORM = 8e-9
"""Seconds a point, of one real transform along x, and of what is done with its result."""
ELEMENT = 1.5e-8
"""Seconds for an element of a table: an exponential, and what is done with it."""
IN_CACHE, BEYOND = 1e6, 4.0
"""Elements of a kernel beyond which making it waits for memory, and how many times as long an element takes then."""
PAIR = {"linear": 0.7e-9, "cubic": 0.9e-9, "quintic": 1.2e-9}
"""Seconds for a pair of velocity points (python -m benchmarks.collision_operator)."""
LOOK = 1e-7
"""Seconds a point, to make an observation of a state and to judge it: moments, waves, edges."""
CALLS = {"exact": 1e-3, "strang": 1e-3, "extrapolated": 2.5e-3, "embedded": 7e-4}
"""Seconds of a step that do not depend on its size: tens of calls of NumPy, hundreds where steps are extrapolated."""
PLANNING = 1e-2
"""Seconds of planning and of making the dataset."""
FRAME, WRITTEN = 5e-4, 1e-8
"""Seconds of a frame, and of a value of f in it: interpolated and written."""
EVALUATIONS = 12
"""Rates, and linear half steps, in a step of Lawson's method with 1 and 2 steps."""
EMBEDDED_EVALUATIONS = 4.5
"""Likewise in one with an embedded estimate: four rates, five linear half steps."""
STRANG_SUBSTEPS = 10
"""Of an extrapolated Strang step, 1 + 2 + 3 + 4."""
LENGTHS = 4
"""Step lengths, each with tables of its own, that error control goes through. Chosen."""


@dataclass(frozen=True)
class Cost:
    """Of one run."""

    seconds: float
    """On one core of this machine, as it is now."""
    operations: float
    """Multiplications and additions in products of matrices and in pairs: the part that a faster machine shortens."""

    def __str__(self) -> str:
        return f"about {in_words(self.seconds)}"


def cost(plan: Plan) -> Cost:
    """What `solve` takes for this plan, its frames included."""
    seconds = PLANNING + _stepping(plan) + _frames(plan)
    return Cost(pace() * seconds, _operations(plan))


def in_words(seconds: float) -> str:
    """In the unit that a clock would use."""
    for unit, length in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.2g} {unit}"
    return f"{seconds:.2g} s"


@functools.cache
def pace() -> float:
    """Seconds that this machine takes now for what takes the one of the constants a second: measured in a few milliseconds."""
    a = np.random.default_rng(1).random((160, 160))
    product = _least(lambda: a @ a) / (a.size * len(a) * PRODUCT)
    exponential = _least(lambda: np.exp(a)) / (a.size * EXPONENTIAL)
    return math.sqrt(product * exponential)


EXPONENTIAL = 4e-9
"""Seconds for an exponential, on the machine of the constants."""


def _least(work: object, times: int = 5) -> float:
    assert callable(work)
    found = math.inf
    for _ in range(times):
        began = time.perf_counter()
        work()
        found = min(found, time.perf_counter() - began)
    return found


def _stepping(plan: Plan) -> float:
    nx, nv = plan.grid.nx, plan.grid.nv
    points, steps = nx * nv, plan.expected_steps
    if plan.stepping == "homogeneous":
        return homogeneous.seconds(plan.scales)
    if plan.stepping == "exponential":
        seconds = relaxing.exponential_seconds(plan.scales, plan.waves, plan.grid, shared=1.0)
        return seconds + steps * (CALLS["embedded"] + points * LOOK)
    product, transform = points * nv * PRODUCT, points * TRANSFORM * max(1.0, math.log2(max(nx, 2)) / 6)
    kernel = nv**2 * ELEMENT * (1 if nv**2 < IN_CACHE else BEYOND)
    tables = kernel + points * ELEMENT + (_squarings(plan) * nv**3 * PRODUCT if plan.drift_diffusion != "kernel" else 0.0)
    embedded = plan.controlled and plan.scales.of_pairs
    look = CALLS["embedded" if embedded else plan.stepping] + points * LOOK
    if plan.velocity == "hermite":
        # A propagator for every wave, applied as complex products; C_n is a quarter of count³ multiplications a place.
        linear = 4 * (nx // 2 + 1) * nv**2 * PRODUCT + 2 * transform
        rate = nx * nv**3 / 4 * PRODUCT + points * nv * ELEMENT / 4
        tables = (nx // 2 + 1) * nv**2 * 4 * ELEMENT
    else:
        linear = product + 2 * transform
        rate = points * nv / 2 * PAIR.get(plan.deposit or "", 0.0)
    if plan.stepping == "exact":
        return _exact(plan, steps, linear, transform, product, tables) + steps * look
    if plan.symmetric:  # Strang's: transport and kernel, and exp(-Sρhv) renormalised
        substeps = 1 if plan.stepping == "strang" else STRANG_SUBSTEPS
        each = linear + points * ELEMENT
        return steps * (substeps * each + look) + LENGTHS * tables
    evaluations = 2 if plan.stepping == "strang" else EMBEDDED_EVALUATIONS if embedded else EVALUATIONS
    each = (linear + rate + points * TRANSFORM) * evaluations
    # The estimate of what dv makes of the rate compares it with that on twice the points.
    return steps * (each + look) + LENGTHS * tables + (4 * rate + look) * (steps / 10 + len(plan.times))


def _exact(plan: Plan, steps: int, linear: float, transform: float, product: float, tables: float) -> float:
    nx, nv = plan.grid.nx, plan.grid.nv
    lengths = float(min(steps, 2 + len(plan.times)))  # one for the links of the chain, and one for each frame between
    if plan.shortest_step > 0:  # frames before that are stepped on denser points
        lengths += float((plan.times[1:] < plan.shortest_step).sum()) * (choices.FINER_WHEN_EARLY**2 - 1)
    if plan.law is None or plan.velocity == "hermite":
        return steps * linear + lengths * tables
    if not plan.waves.local_gauge:
        moments = 8 * nx * nv * 4 * TRANSFORM / 2 if plan.scene.output.budgets is not False else 0.0
        return steps * (linear + 3 * transform + moments) + lengths * tables
    each = 2 * product + 9 * transform + 3 * nx * nv * ELEMENT
    # Budgets ask for the states at eight nodes between links: each a step, with tables of its own.
    nodes = 8 if plan.scene.output.budgets is not False else 0
    return steps * (1 + nodes) * each + (lengths + nodes) * 2 * tables


def _squarings(plan: Plan) -> float:
    """Products of matrices in which the finite volumes' exponential of one step is made."""
    model, dv, h = plan.inner.model, plan.grid.dv, plan.time_step or plan.inner.run.end_time
    return 2 + max(0.0, math.log2(max(1.0, 4 * model.friction * model.noise / dv**2 * h)))


def _frames(plan: Plan) -> float:
    output = plan.output
    size = output.nx * output.nv
    # Where the output has other velocities f is interpolated, by cosines and sines of each wave and velocity.
    moved = output.nv * plan.grid.nv * (output.nx * PRODUCT + 2 * ELEMENT)
    same = (output.nv, output.low, output.high) == (plan.grid.nv, plan.grid.low, plan.grid.high)
    interpolated = 0.0 if same and not plan.reference_frame.moving else moved
    return len(plan.times) * (FRAME + size * WRITTEN + interpolated)


def _operations(plan: Plan) -> float:
    nx, nv = plan.grid.nx, plan.grid.nv
    evaluations = 1 if plan.stepping == "exact" else STRANG_SUBSTEPS if plan.symmetric else EVALUATIONS
    pairs = nx * nv**2 / 2 if plan.law is not None and not plan.law.linearises else 0.0
    return float(plan.expected_steps * evaluations * (nx * nv**2 + pairs))
