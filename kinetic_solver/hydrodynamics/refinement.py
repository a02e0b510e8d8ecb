"""How a run of the closure chooses its points: refined until two resolutions agree, in the norm that the flow allows.

Where a frame is smooth on both, the finer one's error is taken for 1/7 of their largest difference (order 3, in time; in x it
is 5). Where the steepest difference between neighbours does not halve with dx the frame has a jump; there no scheme converges
in the maximum norm, and the difference in L1, of order 1, stands for the finer one's error."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.closure import ClosurePass, Frame
from kinetic_solver.hydrodynamics.frame_store import FrameStore
from kinetic_solver.hydrodynamics.plan import Plan
from kinetic_solver.hydrodynamics.records import BUDGETS, Values, values

MOST_WORK, SETTLE = 2e8, 2e7
"""Points times steps of the finest run that rtol may ask for: two minutes at the 0.6 μs each that 1024 points take on one core;
and of the run that is taken where that would not be enough."""
LONGEST = 0.4
"""Steps of the coarsest run in units of 1/γ, beyond which order 3 cannot be seen; halved with dx."""
FEWEST = 16
"""Points that are worth being the coarser of two runs, where grid.nx is given."""

MOST_PASSES = 20
"""More than MOST_WORK allows: each has four times the work of the one before."""

STEEPER = 0.7
"""How many times the steepest difference between neighbours of a smooth field may fall at most when dx is halved: 0.5, and the
rest for fields that are just resolved."""


@dataclass(frozen=True)
class Agreement:
    """Of two runs, one with half the other's points: the errors of the finer one."""

    largest: float = 0.0
    """In the maximum norm, over the frames that are smooth: max|Δρ| over max ρ, max|Δθ| over max θ, max|Δu| over max(|u|, √θ)."""
    integral: float = 0.0
    """In L1, over the frames that are not: the same with means in the place of maxima."""
    jumps_from: float = math.inf
    """Time of the first frame with a jump; inf without."""

    @property
    def error(self) -> float:
        return max(self.largest, self.integral)

    def after(self, time: float, coarse: Array, fine: Array, rtol: float) -> Agreement:
        """With one more frame: ρ, u and θ of shapes (3, n) and (3, 2n), or both (3, 1)."""
        rho, u, theta = fine
        scales = np.array([rho.max(), max(np.abs(u).max(), np.sqrt(theta.max())), theta.max()])
        difference = np.abs(fine[:, :: fine.shape[1] // coarse.shape[1]] - coarse) / scales[:, None]
        if difference.max() / 7 > rtol and _jumps(coarse, fine):
            integral = max(self.integral, float(difference.mean(axis=1).max()))
            return Agreement(self.largest, integral, min(self.jumps_from, time))
        return Agreement(max(self.largest, float(difference.max()) / 7), self.integral, self.jumps_from)

    def attributes(self) -> dict[str, str | float]:
        where = "jumps" if np.isfinite(self.jumps_from) else "smooth"
        found: dict[str, str | float] = {"flow": where, "error_maximum_norm": self.largest}
        if where == "jumps":
            found |= {"error_L1": self.integral, "jumps_from": self.jumps_from}
        return found


def _jumps(coarse: Array, fine: Array) -> bool:
    steepest = [np.abs(np.diff(field[0], append=field[0, :1])).max() for field in (coarse, fine)]
    return bool(steepest[1] > STEEPER * steepest[0])


def levels(plan: Plan) -> list[int]:
    """Points of the passes that there may be. A given grid.nx is kept, and half as many points, if that is a whole number, give
    the error."""
    points = plan.points
    if points == 1:
        return [1] * MOST_PASSES
    if plan.scene.grid.nx is None:
        return [points // 2 * 2**n for n in range(MOST_PASSES)]
    coarser = points % (2 * (plan.scene.output.nx or 1)) == 0 and points >= 2 * FEWEST
    return [points // 2, points] if coarser else [points]


class RefinedRun:
    """A run of the closure at the first resolution that meets rtol.

    Where rtol is not met, with grid.nx or for want of points, `report` warns. Of passes that stop the frames that they reach
    count."""

    def __init__(self, plan: Plan, store: FrameStore) -> None:
        self.plan, self._store, self._levels = plan, store, levels(plan)
        self._times: list[float] = plan.schedule.times.tolist()
        self._accepted = False
        self.recorded = 0
        """Frames that were handed on."""
        self._begin(0)

    def _begin(self, place: int) -> None:
        """A pass of levels[place] points."""
        self._place, self._kept = place, 0
        self._found = Agreement() if place > 0 else None
        """Of this pass and the one before, in its frames so far."""
        self._stopped: str | None = None
        self._pass = self._new_pass()
        self._store.begin(3 * self._levels[place] + 3 + len(BUDGETS))

    def _new_pass(self) -> ClosurePass:
        given, place = self.plan.scene.grid, self._place
        gamma = self.plan.scene.model.friction
        bound = (LONGEST / gamma if gamma > 0 else math.inf) / 2**place
        if given.time_step is not None:
            bound = given.time_step * (2 if place < len(self._levels) - 1 and given.nx is not None else 1)
        return ClosurePass(self.plan.scene, self._levels[place], bound, 2.0**place)

    @property
    def time(self) -> float:
        """That the pass in hand has come to, or of the last frame that was handed on."""
        if self._accepted:
            return self._times[self.recorded - 1]
        within = self._pass.steps.within
        return within[1] if within is not None else self._times[max(0, self._kept - 1)]

    def frames(self, after_step: Callable[[RefinedRun], None]) -> Iterator[tuple[int, Values]]:
        """(number, values) of the frames that are not recorded yet. That of time 0 is the start, on the output's points; the
        others are known when the last pass is accepted, and are its own.

        `after_step` is called after every step and every frame but the last, and may raise. Raises SolverStopped, the frames
        before handed on."""
        if self.recorded == 0:
            yield 0, self._values(ClosurePass(self.plan.scene, self.plan.output.nx, math.inf).frame(0.0))
            self.recorded = 1
            after_step(self)
        while not self._accepted:
            self._go_through(after_step)
            if self._enough():
                self._accepted = True
            else:
                self._begin(self._place + 1)
        while self.recorded < self._kept:
            yield self.recorded, self._values(self._frame(self._place, self.recorded))
            self.recorded += 1
            if self.recorded < self._kept:
                after_step(self)
        if self._stopped is not None:
            raise SolverStopped(self._stopped)

    def _go_through(self, after_step: Callable[[RefinedRun], None]) -> None:
        for number in range(self._kept, len(self._times)):
            time = self._times[number]
            if number > 0:
                try:
                    self._pass.advance(self._times[number - 1], time, lambda: after_step(self))
                except SolverStopped as stop:
                    self._stopped = str(stop)
                    return
            frame = self._pass.frame(time)
            self._store.append(np.concatenate([frame.fields.ravel(), frame.totals, [frame.budget[name] for name in BUDGETS]]))
            self._kept = number + 1
            if self._found is not None and number < self._store.rows(self._place - 1):
                coarse = self._frame(self._place - 1, number)
                self._found = self._found.after(time, coarse.fields, frame.fields, self.plan.scene.accuracy.rtol)

    def _enough(self) -> bool:
        """Whether the pass that is over is taken."""
        rtol, work, found = self.plan.scene.accuracy.rtol, self._pass.work, self._found
        if self._place == len(self._levels) - 1:
            return True
        if found is None:
            return False
        # Work grows as nx²; errors fall as 1/nx with jumps, else as 1/nx³
        wanted = work * max(4.0, (found.error / rtol) ** (2.0 if found.integral > rtol else 2 / 3))
        return found.error <= rtol or 4 * work > (MOST_WORK if wanted <= MOST_WORK else SETTLE)

    def _frame(self, place: int, number: int) -> Frame:
        row, nx = self._store.row(place, number), self._levels[place]
        fields, totals, budget = np.split(row, [3 * nx, 3 * nx + 3])
        return Frame(fields.reshape(3, nx), totals, dict(zip(BUDGETS, budget.tolist(), strict=True)))

    def _values(self, frame: Frame) -> Values:
        shown = self.plan.output.nx
        rho, u, theta = frame.fields[:, :: max(1, frame.fields.shape[1] // shown)] * np.ones(shown)
        return values((rho, u, theta, np.zeros(shown)), frame.totals, frame.budget)

    def snapshot(self) -> dict[str, Any] | None:
        """A tree from which a new run of the same plan goes on; None where the next step will find the fields lost."""
        going = None if self._accepted else self._pass.state()
        if going is None and not self._accepted:
            return None
        found = self._found
        return {
            "accepted": self._accepted,
            "recorded": self.recorded,
            "place": self._place,
            "kept": self._kept,
            "agreement": None if found is None else (found.largest, found.integral, found.jumps_from),
            "stopped": self._stopped,
            "pass": going,
            "store": self._store.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from there. Raises SceneError where frames were lost."""
        self._accepted, self.recorded = state["accepted"], state["recorded"]
        self._place, self._kept, self._stopped = state["place"], state["kept"], state["stopped"]
        self._found = None if state["agreement"] is None else Agreement(*state["agreement"])
        self._pass = self._new_pass()
        if not self._accepted:
            self._pass.restore(state["pass"])
        self._store.restore(state["store"])

    def report(self) -> dict[str, Any]:
        """Attributes of the run that is over. Warns where rtol was not met."""
        given, rtol, found = self.plan.scene.grid, self.plan.scene.accuracy.rtol, self._found
        attributes: dict[str, Any] = {"points": str(self._levels[self._place])}
        if found is None:
            return attributes
        if found.error > rtol:
            remedy = "raise accuracy.rtol" if given.nx is None else "raise grid.nx or accuracy.rtol"
            text = f"the error is about {found.largest:.2g} in the maximum norm"
            if math.isfinite(found.jumps_from):
                text += (
                    f" while the flow is smooth, and {found.integral:.2g} in L1 from t = {found.jumps_from:.6g} on, with jumps"
                )
            warnings.warn(f"{text} (accuracy.rtol = {rtol:g}); {remedy}", stacklevel=4)
        return attributes | found.attributes()
