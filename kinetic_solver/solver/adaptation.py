"""Whether a run goes on by another plan, and which: functions of a plan, of what was found, and of what was tried before.

What would stop a run first tries a larger grid; what f no longer needs is given back. What `[grid]` gives is never changed.
Carrying a state to another grid is the representation's affair, and going back to a good one the loop's.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.moments import moments
from kinetic_solver.plan import Plan, check_memory, in_t, in_v, in_x
from kinetic_solver.plan.edges import bounded
from kinetic_solver.plan.mixing import mixing
from kinetic_solver.solver.estimate import enough_velocities, shortest_of
from kinetic_solver.solver.monitor import SHARE, Problem, Quantity, amplified, amplified_waves, folds, free
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.regrid import window_in_cells

FINER, WIDER = 1.5, 0.15
"""By how much nx or nv is raised, and the window widened on one side, at a time. Chosen."""
MOST_GROWTH = 64
"""Times the first plan's points, beyond which a run gives up. Chosen."""
TRIES, WORTH_TRYING = 3, 0.5
"""After so many tries a problem must have become this much smaller, or trying goes on in vain. Chosen."""
WORTH_SHRINKING = 1.5
"""How many times fewer points make a smaller grid worth the change, where at least LEFT steps are left. Chosen."""
LEFT = 6
LOST_WAVES, LOST_EDGE = 100.0, 300.0
"""A smaller grid still holds waves in x down to rtol over the first, and f at its edges down to rtol over the second. Chosen."""
TOUCHES = 0.03
"""Of rtol: where f at an edge of the window exceeds that, the window is to blame for steps that do not meet their tolerance."""
ENDS = 0.1
"""Of rtol: where the shortest waves in v are below that, dv is not to blame for them."""


@dataclass(frozen=True)
class History:
    """What a run has tried so far."""

    first: PhaseSpaceGrid
    tried: tuple[tuple[Quantity, float], ...] = ()
    """Every problem: what was too small, and by how much."""
    settled: bool = False
    """True once no larger grid was to be had: then what loses no more than rtol will do."""

    @property
    def share(self) -> float:
        """Of rtol, that the monitor allows to a loss."""
        return 1.0 if self.settled else SHARE

    def of(self, what: Quantity) -> list[float]:
        return [value for quantity, value in self.tried if quantity == what]


@dataclass(frozen=True)
class Change:
    """Go on from the last good state by this plan."""

    plan: Plan
    history: History


@dataclass(frozen=True)
class Stop:
    """There is no way to go on."""

    reason: str


def enlarged(plan: Plan, problem: Problem, history: History, exact: bool) -> Change | Stop:
    """A larger grid, or for exact steps shorter ones; the same plan where no larger one is to be had but this one will do."""
    before = history.of(problem.what)
    hopeless = len(before) > TRIES and problem.value > WORTH_TRYING * min(before[:-TRIES])
    history = dataclasses.replace(history, tried=(*history.tried, (problem.what, problem.value)))
    larger = _larger(plan, problem.what, exact, first_time=len(before) % 2 == 0)
    grid, first = larger.grid, history.first
    if hopeless or not free(plan, problem.what) or grid.nx * grid.nv > MOST_GROWTH * first.nx * first.nv:
        if problem.value <= plan.inner.accuracy.rtol and not history.settled:
            return Change(plan, dataclasses.replace(history, settled=True))
        if not free(plan, problem.what):
            return Stop(str(problem))
        happened = problem.message.split(";")[0]
        tried = f" (refining the grid {len(before)} times did not help)" if before else ""
        shorter = "" if plan.inner.grid.time_step is None else "shorten grid.time_step, "
        remedy = f"{shorter}raise accuracy.rtol, or end the run before (run.end_time)"
        return Stop(f"{problem.when}: {happened}{tried}; {remedy}")
    try:
        check_memory(larger.memory, grid)
    except SceneError as error:
        return Stop(f"{problem.when}: {error}")
    return Change(larger, history)


def shrunk(fitting: tuple[Observation, ...], history: History) -> Change | None:
    """A grid that would still hold f, and what else is to fit on it, where it is worth going over to it. `fitting` is that, the
    present first. What was once too small is not made smaller."""
    seen = fitting[0]
    plan, grid, rtol, f = seen.plan, seen.grid, seen.plan.inner.accuracy.rtol, seen.f
    left = float(plan.times[-1]) - seen.clock
    length = plan.time_step if seen.scheme.exact and plan.time_step is not None else seen.length
    if left / length < LEFT or folds(plan) or plan.scales.cooling or plan.stepping == "homogeneous":
        return None
    tried = {what for what, _ in history.tried}
    new = grid
    if free(plan, "nx") and "nx" not in tried:
        waves = max(int(np.flatnonzero(amplified_waves(each) > rtol / LOST_WAVES)[-1]) for each in fitting)
        nx = in_x.points_from_now_on(plan.scales, plan.waves, waves, f.sum(axis=1) * grid.dv)
        new = dataclasses.replace(new, nx=min(grid.nx, nx))
    if free(plan, "low") and not tried & {"low", "high"}:
        held = np.concatenate([np.flatnonzero(amplified(each) > rtol / LOST_EDGE * each.f.max()) for each in fitting])
        m = moments(grid, f)
        low, high = in_v.window_from_now_on(plan.scales, m.mean_velocity, m.temperature, left)
        needed = np.searchsorted(grid.faces, [low, high])
        first, last = max(0, min(held.min(), needed[0] - 1)), min(grid.nv, max(held.max() + 1, needed[1]))
        low, high = grid.faces[first], grid.faces[last]
        if not seen.scheme.exact or plan.time_step is None or bounded(plan.scales, low, high, plan.time_step):
            new = dataclasses.replace(new, nv=last - first, low=low, high=high)
    if free(plan, "nv") and not seen.scheme.exact and plan.velocity != "hermite" and "nv" not in tried:
        nv = max(enough_velocities(seen), _for_mixing(seen, left))
        new = dataclasses.replace(new, nv=min(new.nv, max(16, math.ceil(new.nv * nv / grid.nv))))
    if WORTH_SHRINKING * new.nx * new.nv > grid.nx * grid.nv:
        return None
    return Change(_on(plan, new), history)


def suspect(seen: Observation) -> Quantity:
    """What to make larger where steps cannot meet their tolerance: the window, if f reaches its edges, else nv."""
    low, high = np.abs(seen.f[:, [0, -1]]).max(axis=0)
    if max(low, high) > TOUCHES * seen.plan.inner.accuracy.rtol * seen.f.max():
        return "low" if low > high else "high"
    return "nv"


def to_blame(seen: Observation) -> Quantity | None:
    """What of the grid makes errors that no shorter step mends; None where none of it does."""
    what = suspect(seen)
    if what == "nv" and shortest_of(seen.waves_in_v) < ENDS * seen.plan.inner.accuracy.rtol:
        return None
    return what


def _larger(plan: Plan, what: Quantity, exact: bool, first_time: bool) -> Plan:
    grid = plan.grid
    if what == "nx" and exact and plan.shortest_step > 0 and free(plan, "nv") and first_time:
        # Within a step are states that friction has not yet acted on, with steeper waves than any that is seen.
        return _with_shorter_steps(plan)
    if what == "nx":
        return _on(plan, dataclasses.replace(grid, nx=in_x.fast_odd(math.ceil(FINER * grid.nx))))
    if what == "nv":
        return _on(plan, dataclasses.replace(grid, nv=math.ceil(FINER * grid.nv)))
    more = WIDER * (grid.high - grid.low)
    low, high = (more, 0.0) if what == "low" else (0.0, more)
    return _on(plan, window_in_cells(grid, grid.low - low, grid.high + high))


def _with_shorter_steps(plan: Plan) -> Plan:
    """Exact steps of two thirds of the length, on points dense enough for their kernel."""
    step, grid = in_t.filling(plan.scales, (plan.time_step or plan.inner.run.end_time) / FINER), plan.grid
    dense = math.ceil((grid.high - grid.low) / in_v.exact_step_spacing(plan.scales, plan.waves, step))
    return _on(dataclasses.replace(plan, time_step=step), dataclasses.replace(grid, nv=max(grid.nv, dense)))


def _on(plan: Plan, grid: PhaseSpaceGrid) -> Plan:
    """The plan on another grid: the shortest exact step follows dv."""
    shortest = plan.shortest_step
    if shortest > 0 and grid.dv != plan.grid.dv:
        shortest = in_t.shortest_exact_step(plan.scales, plan.waves, grid)
    return dataclasses.replace(plan, grid=grid, shortest_step=shortest)


def _for_mixing(seen: Observation, left: float) -> int:
    """nv for the waves in v that f's present waves in x will still be turned into."""
    plan, rtol, grid = seen.plan, seen.plan.inner.accuracy.rtol, seen.grid
    amplitude = amplified_waves(seen)
    alive = np.flatnonzero(amplitude > rtol / 10)
    digits = np.log(10 * amplitude[alive] / rtol)
    q = mixing(plan.inner.model, grid.wavenumbers[alive], digits, plan.scales.theta_min, left)
    return math.ceil((grid.high - grid.low) * q / math.pi)
