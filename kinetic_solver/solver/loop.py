"""The time loop: from frame to frame, on a grid that follows the solution.

Each step makes one Observation, which goes to the monitor, the budgets, the estimate, and at frames to the writer. Where the
monitor finds that the grid no longer holds f, adaptation.py says how to go on, and the loop goes back to a state that was good;
exact steps start again from time 0, since what (6) amplifies must have been right from the start. The output's grid stays.
Tests: tests/convergence/test_adaptation.py.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinetic_solver.dataset import Recorder
from kinetic_solver.errors import LostAccuracy, SceneError, SolverStopped, StepTooSmall
from kinetic_solver.plan import Plan
from kinetic_solver.progress import Progress
from kinetic_solver.solver import adaptation
from kinetic_solver.solver.adaptation import Change, History, Stop
from kinetic_solver.solver.budgets import Ledger, Mark
from kinetic_solver.solver.estimate import ErrorEstimate
from kinetic_solver.solver.monitor import Monitor, Problem, folds, free
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.report import Report, last_words
from kinetic_solver.solver.scheme import assemble
from kinetic_solver.solver.writer import Writer, start_shown
from kinetic_solver.stepping import ExactSteps, Stalled, Step

AfterStep = Callable[["March"], None]

CHECK_EVERY = 10
"""Steps of the quadrature path between two judgements of the monitor, and exact steps between two looks at whether a smaller grid
would do; NaN is looked for in every step. Chosen: a judgement costs about as much as a step."""
FIRST_PIECES = 4
"""Parts of the first interval, which give the budgets' spline a few points to begin with."""


@dataclass(frozen=True)
class Good:
    """A state that was judged good, and where the books stood: to go back to."""

    seen: Observation
    mark: Mark | None


class March:
    """A run in progress. What it is at is `now` and the stepper's `memory`; everything else watches, or remembers decisions."""

    now: Observation
    memory: Any
    behind: float
    """How far exact steps that started again from time 0 have to go to where the run was."""
    errors: float
    """The sum of the steps' estimated errors on this grid, and the shortest of these steps."""
    shortest: float
    within: bool
    """Whether a step of that interval has been taken: a run that is resumed then goes on within it."""

    def __init__(
        self, plan: Plan, recorder: Recorder, progress: Progress | None = None, after_step: AfterStep | None = None
    ) -> None:
        """`after_step` is called after every step and every frame but the last, and may raise: solver/checkpoint.py."""
        self._progress, self._after_step = progress, after_step or (lambda march: None)
        self.history = History(plan.grid)
        self.grids = [(0.0, plan.grid)]
        self.monitor = Monitor(plan)
        self.estimate = ErrorEstimate(plan)
        self.scheme = assemble(plan)
        self.first_plan = plan
        self._restart()
        self.ledger = Ledger(self.now) if plan.scene.output.budgets is not False else None
        self.writer = Writer(plan, recorder, self.ledger)
        self.diagnostics: dict[str, float] = {}
        self.good = self._good()
        self.steps = self.looks = 0
        """Steps of error control within intervals, and looks for a smaller grid, so far."""
        self.frame = -1
        """The last that was written."""
        self.began = 0.0
        """The clock when the steppers' interval of the moment began."""
        self.judged = False
        """Whether the monitor has found the state of the moment to be good."""

    def go(self) -> Report:
        """All frames. Raises SceneError where the start itself cannot be held, SolverStopped where a run cannot go on."""
        if self.frame < 0:
            self._settle_the_start()
            plan = self.scheme.plan
            # The start is known on the output's grid. A step in the density is shown as it is, not as the solver can carry it.
            others = dataclasses.replace(plan.whole, nx=plan.grid.nx) != plan.grid
            known = others or plan.reference_frame.moving or plan.scene.initial.step is not None or not plan.start.closed_form
            known_f = known or plan.output != plan.grid
            self._write(0, start_shown(plan) if known_f else None, moments_too=known)
        for frame, (start, end) in enumerate(itertools.pairwise(self.scheme.plan.times.tolist()), 1):
            if frame > self.frame:
                for then in self._stops(start, end):
                    while self.now.clock < then:
                        self._march_to(then)
                self._write(frame)
        last_words(
            self.scheme, self.estimate, self.errors / float(np.abs(self.now.f).max()), self.shortest, bool(self.monitor.warned)
        )
        return self._report()

    # -- one interval

    def _stops(self, start: float, end: float) -> Iterator[float]:
        if start == 0 and self.ledger is not None and self.ledger.splines:
            yield from np.linspace(start, end, FIRST_PIECES + 1)[1:].tolist()
        else:
            yield end

    def _march_to(self, end: float) -> None:
        """To the end of an interval that begins now, or to where the grid changes: then `now` is the good state reached."""
        if not self.within:
            self.good, self.began = self._good(), self.now.clock
        start = self.began
        try:
            if self.behind:
                self._catch_up()
            while self.now.clock < end:
                taken = self.scheme.stepper.step(self.now.state, self.memory, start, end - start)
                found = self._stalled(taken) if isinstance(taken, Stalled) else self._observe(taken, start, end)
                if isinstance(found, Problem):
                    return self._enlarge(found)
                if found is not None:
                    return self._install(found, carried=True)
                self.within = self.now.clock < end
                self._after_step(self)
        except (StepTooSmall, LostAccuracy) as error:
            in_x = self.now.grid.nx > 1
            what = "nx" if isinstance(error, LostAccuracy) and in_x else adaptation.suspect(self.now)
            text = f"{error}; raise accuracy.rtol, or refine {'grid.nx and ' if in_x else ''}grid.nv"
            self._enlarge(Problem(what, 1.0, self._between(start, end), text))

    def _observe(self, taken: Step, start: float, end: float) -> Problem | Change | None:
        """Shows the state after a step to all who watch. Returns what the monitor objects to, if it is time to ask it, or else a
        smaller grid that will do, if it is time to look for one."""
        last = self.now
        clock = end if start + taken.elapsed > end - 1e-12 * (end - start) else start + taken.elapsed
        within = taken.within
        points = self.scheme.representation.points
        f_within = None if within is None else lambda t: points(within(t - start))
        moments = taken.moments
        moments_within = None if moments is None else lambda clocks: moments([t - start for t in clocks])
        stretch = None if taken.stretch is None else (start + taken.stretch[0], start + taken.stretch[1])
        looked_at = (f_within, moments_within, stretch, taken.side, taken.integral)
        self.now = seen = Observation.of(self.scheme, clock, taken.state, last.clock, taken.error, *looked_at)
        self.memory = taken.memory
        self.errors += taken.error
        self.shortest = min(self.shortest, taken.length)
        self.monitor.finite(seen)
        if self.ledger is not None:
            self.ledger.step(seen)
        self.estimate.step(seen)
        if self._progress is not None:
            self._progress(seen.time, seen.plan.scene.run.end_time)
        if clock < end and not self.scheme.exact:
            self.steps += 1
            if self.steps % (1 if folds(seen.plan) else CHECK_EVERY):
                self.judged = False
                return None
        judgement = self.monitor.judge(seen, self.history.share)
        if judgement.problem is not None:
            return judgement.problem
        self.diagnostics, self.judged = judgement.diagnostics, True
        if self.scheme.exact:  # links are the same whatever the frames
            self.diagnostics = {**self.diagnostics, **self.estimate.parts(seen, self.diagnostics)}
        return self._smaller() if clock < end else None

    def _stalled(self, found: Stalled) -> Problem | None:
        """Errors that fall no faster than the step are the grid's: a Problem, or, where it is given, accepted with a warning."""
        what = adaptation.to_blame(self.now)
        if what is None:
            self.memory = found.insisting
        elif free(self.now.plan, what):
            return Problem(what, 1.0, self._between(self.now.clock, self.now.clock), str(found))
        else:
            warnings.warn(str(found), stacklevel=2)
            self.memory = found.accepting
        return None

    def _smaller(self) -> Change | None:
        """Asked within an interval, of a state that was judged good. Exact steps build on their chain, not on what is seen: they
        go back to the interval's start, and are carried over only once the chain has begun."""
        fitting: tuple[Observation, ...]
        if isinstance(self.scheme.stepper, ExactSteps):
            if not self.memory.begun or self.memory.links[1].time == 0:  # the start seldom fits on a smaller grid
                return None
            self.looks += 1
            if self.looks % CHECK_EVERY != 1:
                return None
            # From the link before the last one, too, later times are reached: it must fit on the smaller grid.
            before = self.memory.links[1]
            fitting = (self.now, Observation.of(self.scheme, before.time, self.scheme.stepper.exact.lower(before.lifted)))
        else:
            self.good = self._good()
            fitting = (self.now,)
        smaller = adaptation.shrunk(fitting, self.history)
        if smaller is not None:
            self.good = self._good()
        return smaller

    # -- changes of plan

    def _settle_the_start(self) -> None:
        """Enlarges the grid until it holds the start."""
        try:
            while (judgement := self.monitor.judge(self.now, self.history.share)).problem is not None:
                self.good = self._good()
                self._enlarge(judgement.problem)
        except SolverStopped as stop:
            raise SceneError(str(stop)) from None
        self.diagnostics, self.judged = judgement.diagnostics, True

    def _enlarge(self, problem: Problem) -> None:
        """Go back to the last good state with a larger grid, or stop where there is none to be had."""
        found = adaptation.enlarged(self.scheme.plan, problem, self.history, self.scheme.exact)
        if isinstance(found, Stop):
            raise SolverStopped(found.reason)
        self._install(found, carried=False)

    def _install(self, change: Change, carried: bool) -> None:
        """Go on from the last good state by another plan; exact steps that are not carried over start again from time 0."""
        good, old = self.good.seen, self.scheme
        self.history = change.history
        self.grids.append((good.clock, change.plan.grid))
        self.scheme = assemble(change.plan)
        if self.ledger is not None and self.good.mark is not None:
            self.ledger.rewind(self.good.mark)
        representation, stepper = self.scheme.representation, self.scheme.stepper
        if good.clock == 0:
            self._restart()
            if self.ledger is not None:
                self.ledger.start(self.now)
        elif self.scheme.from_the_start and not carried:
            self._restart()
            self.behind, self.now = good.clock, dataclasses.replace(good, state=self.now.state)
        else:
            state = representation.carried(good.state, old.plan.grid)
            if isinstance(stepper, ExactSteps) and isinstance(old.stepper, ExactSteps):
                memory = old.stepper.carried(self.memory, stepper, lambda f: representation.carried(f, old.plan.grid))
            else:
                memory = stepper.begin(state, good.clock)
            self._begin(Observation.of(self.scheme, good.clock, state), memory)

    def _restart(self) -> None:
        state = self.scheme.representation.start()
        self._begin(Observation.of(self.scheme, 0.0, state), self.scheme.stepper.begin(state, 0.0))

    def _begin(self, seen: Observation, memory: Any) -> None:
        self.now, self.memory = seen, memory
        self.behind, self.errors, self.shortest, self.within = 0.0, 0.0, math.inf, False

    def _catch_up(self) -> None:
        """From time 0 to where the run was; nothing is booked, for it was booked before."""
        end, seen = self.behind, self.now
        self.behind = 0.0
        while True:
            taken = self.scheme.stepper.step(seen.state, self.memory, 0.0, end)
            assert isinstance(taken, Step)
            seen = Observation.of(self.scheme, end if taken.elapsed == end else taken.elapsed, taken.state)
            self.memory = taken.memory
            self.monitor.finite(seen)
            if taken.elapsed == end:
                self.now = seen
                return

    def _good(self) -> Good:
        return Good(self.now, self.ledger.mark() if self.ledger is not None else None)

    # -- what the run says

    def _write(self, frame: int, shown: np.ndarray | None = None, moments_too: bool = True) -> None:
        if frame == 0 or not self.scheme.exact:
            self.diagnostics = {**self.diagnostics, **self.estimate.parts(self.now, self.diagnostics)}
        self.writer.write(frame, self.now, self.diagnostics, shown, moments_too)
        self.frame = frame
        if frame + 1 < len(self.scheme.plan.times):
            self._after_step(self)

    def _between(self, start: float, end: float) -> str:
        place = self.scheme.plan.reference_frame.place
        a, b = place(start).time, place(end).time
        return f"between t = {a:.6g} and {b:.6g}" if b > a else f"t = {a:.6g}"

    def _report(self) -> Report:
        place = self.scheme.plan.reference_frame.place
        grids = [f"t = {place(time).time:.4g}: {g.nx} × {g.nv} on [{g.low:.4g}, {g.high:.4g}]" for time, g in self.grids]
        return Report(self.estimate.total, self.estimate.limited_by(), "; ".join(grids), self.writer.missing)
