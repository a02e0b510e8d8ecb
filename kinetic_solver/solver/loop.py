"""The time loop: from frame to frame, on a grid that follows the solution.

Where the grid was chosen by rtol, it is made finer or wider when the monitor finds that it no longer holds f, and the step is
taken again from a state that was good; it is made smaller where f needs less and enough of the run is left. The output's grid
stays.
Tests: tests/test_grid_control.py.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import Recorder
from kinetic_solver.errors import LostAccuracy, SceneError, SolverStopped, StepTooSmall
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import initial_state
from kinetic_solver.operators.collisions import Inelastic
from kinetic_solver.operators.linearised import GridLinearisedStep
from kinetic_solver.operators.moments import moments
from kinetic_solver.plan import Plan, check_memory
from kinetic_solver.plan.rules import Rules, fast_odd, frame_times
from kinetic_solver.scene import INELASTIC
from kinetic_solver.solver.budgets import Ledger
from kinetic_solver.solver.estimate import ErrorEstimate
from kinetic_solver.solver.monitor import Monitor, Unresolved
from kinetic_solver.solver.regrid import regrid, resize, window_in_cells
from kinetic_solver.solver.representation import collision_operator, make_representation
from kinetic_solver.solver.steppers import make_stepper
from kinetic_solver.solver.writer import Frames
from kinetic_solver.stepping import Controlled, ExactSteps

Progress = Callable[[float, float], None]
"""Called as progress(time, end time)."""

CHECK_EVERY = 10
"""Steps of the quadrature path between two full checks by the monitor; NaN is looked for in every step."""
FINER, WIDER = 1.5, 0.15
"""By how much nx or nv is raised, and the window widened on one side, at a time."""
MOST_GROWTH = 64
"""Times the plan's points, beyond which a run gives up."""
WORTH_SHRINKING = 1.5
"""How many times fewer points make a change of grid worth its cost, where at least as many steps are left as LEFT."""
LEFT = 6


def _with_functions(coefficients: Array, count: int) -> Array:
    """As many Hermite functions, those that are added with coefficient 0."""
    return np.pad(coefficients, ((0, 0), (0, max(0, count - coefficients.shape[1]))))[:, :count]


class _Smaller(Exception):
    """Signals that a run should go on, from a state that is good, on a smaller grid."""

    def __init__(self, grid: PhaseSpaceGrid) -> None:
        super().__init__()
        self.grid = grid


@dataclasses.dataclass(frozen=True)
class Report:
    """What a finished run says of itself, as attributes of its dataset."""

    error: float
    """Estimated, over max f."""
    limited_by: str
    grids: str

    def attributes(self) -> dict[str, str]:
        return {"limited_by": self.limited_by, "grids": self.grids}


class Run:
    """A run in progress: its state, on its grid of the moment, and what watches and records it. Times are the frame's clock."""

    def __init__(self, plan: Plan, recorder: Recorder, progress: Progress | None = None) -> None:
        self._progress = progress
        self._first = plan
        self._monitor = Monitor(plan)
        self._rules = Rules(plan.inner, {}, plan.times)
        self._estimate = ErrorEstimate(plan, self._rules)
        self._ledger: Ledger | None = None
        self._build(plan)
        self._state = self._representation.start()
        self._f = self._representation.points(self._state)
        if plan.scene.output.budgets is not False:
            self._ledger = Ledger(plan.grid, plan.frame, self._operator, self._f, self._representation.totals(self._state))
        self._frames = Frames(plan, recorder, self._ledger)
        self._count, self._looks = itertools.count(1), itertools.count()
        self._now = 0.0
        self._step = math.inf
        self._good: tuple[float, Array, Any] = (0.0, self._state, None)
        self._behind = 0.0
        """Exact steps start again from time 0 on a new grid: how far they have to go to where the run was."""
        self._tried: dict[str, list[float]] = {}
        self._diagnostics: dict[str, float] = {}
        self._grids = [(0.0, plan.grid)]

    def go(self) -> Report:
        """All frames."""
        plan = self.plan
        try:
            while True:
                try:
                    self._diagnostics = self._monitor.check(self._f, 0.0)
                    break
                except Unresolved as problem:
                    self._good = (0.0, self._state, self._ledger.mark() if self._ledger is not None else None)
                    self._enlarge(problem)
        except SolverStopped as stop:
            raise SceneError(str(stop)) from None
        # The start is known on the output's grid. A step in the density is shown as it is, not as the solver can carry it.
        known = plan.grid != plan.output or plan.frame.moving or plan.scene.initial.step is not None
        self._write(0.0, initial_state(plan.scene, plan.output) if known else None)
        times = plan.times.tolist()
        for time, start, end in zip(frame_times(plan.scene)[1:].tolist(), times, times[1:], strict=False):
            pieces = [start, end]
            if start == 0 and self._ledger is not None and self._operator is not None and not self._exact:
                pieces = np.linspace(start, end, 5).tolist()  # the budgets' spline needs a few points from the start
            for now, then in itertools.pairwise(pieces):
                while now < then:
                    now = self._attempt(now, then)
            self._write(time)
        self._last_words()
        return self._report()

    @property
    def _exact(self) -> bool:
        return isinstance(self._stepper, ExactSteps)

    @property
    def _mixing(self) -> bool:
        """Where noise hardly acts, free motion makes ever shorter waves in v, which may pass the shortest that dv holds in a few
        steps."""
        return self.plan.inner.operator == INELASTIC and self._rules.noise_hardly_acts()

    def _build(self, plan: Plan) -> None:
        self.plan = self._monitor.plan = self._estimate.plan = plan
        self._operator = collision_operator(plan)
        self._representation = make_representation(plan)
        self._stepper = make_stepper(plan, self._representation, self._limited_by_the_grid)
        self._error = 0.0
        if self._ledger is not None:
            self._ledger.grid, self._ledger.operator = plan.grid, self._operator

    def _write(self, time: float, shown: Array | None = None) -> None:
        clock = self._now
        parts = self._estimate.parts(self._state, self._f, clock, self._diagnostics, self._operator)
        values = {**self._diagnostics, **parts}
        self._frames.write(
            time,
            self.plan.grid,
            self.plan.frame.place(clock),
            self._f,
            self._representation.totals(self._state),
            self._operator,
            values,
            shown,
        )

    def _attempt(self, start: float, end: float) -> float:
        """Advance to `end`, or to where the grid changes; returns the time of the good state reached."""
        self._good = (start, self._state, self._ledger.mark() if self._ledger is not None else None)
        try:
            if self._behind > 0:
                self._catch_up()
            self._book_exact_steps()
            self._state = self._stepper.advance(
                self._state, end - start, lambda f, elapsed: self._observe(f, start, elapsed, end)
            )
            self._diagnostics = self._checked(end)
            return end
        except _Smaller as smaller:
            self._change(dataclasses.replace(self.plan, grid=smaller.grid), carried=True)
        except Unresolved as problem:
            self._enlarge(problem)
        except (StepTooSmall, LostAccuracy) as error:
            text = f"{self._between(start, end)}: {error}; raise accuracy.rtol, or refine grid.nx and grid.nv"
            self._enlarge(Unresolved(text, "nx" if isinstance(error, LostAccuracy) else self._suspect(), 1.0))
        return self._good[0]

    def _observe(self, state: Array, start: float, elapsed: float, end: float) -> None:
        now = end if start + elapsed > end - 1e-12 * (end - start) else start + elapsed
        self._step, self._now = now - self._now, now
        self._f = self._representation.points(state)
        self._monitor.finite(self._f, now)
        if self._ledger is not None:
            self._ledger.step(now, self._f, self._representation.totals(state))
        if isinstance(self._stepper, Controlled):
            self._estimate.step(self._stepper.error - self._error, self._step, self._f)
            self._error = self._stepper.error
        if self._progress is not None:
            self._progress(self.plan.frame.place(now).time, self.plan.scene.run.end_time)
        every = 1 if self._mixing else CHECK_EVERY
        if now == end or not (self._exact or next(self._count) % every == 0):
            return
        diagnostics = self._checked(now)
        if isinstance(self._stepper, ExactSteps) and not self._stepper.chained:
            return
        good = (now, state, self._ledger.mark() if self._ledger is not None else None)
        if not self._exact:
            self._good = good
        smaller = self._smaller() if next(self._looks) % CHECK_EVERY == 0 or not self._exact else None
        if smaller is not None:
            self._good, self._diagnostics = good, diagnostics
            raise _Smaller(smaller)

    def _book_exact_steps(self) -> None:
        book, representation, mixing = self._ledger, self._representation, self._rules.mixing_times()

        def over(at: Callable[[float], Array], start: float, end: float) -> None:
            assert book is not None
            within = mixing[(mixing > start) & (mixing < end)].tolist()
            for a, b in itertools.pairwise([start, *within, end]):
                book.over(lambda t: representation.points(at(t)), a, b)

        if book is not None and self._operator is not None and isinstance(self._stepper, ExactSteps):
            self._stepper.between = over

    def _catch_up(self) -> None:
        def watch(f: Array, elapsed: float) -> None:
            self._monitor.finite(self._representation.points(f), elapsed)

        self._state = self._stepper.advance(self._state, self._behind, watch)
        self._behind = 0.0

    def _checked(self, now: float) -> dict[str, float]:
        """The monitor's diagnostics; whether the Hermite functions are enough is looked at here."""
        diagnostics = self._monitor.check(self._f, now, self._density_defect())
        rtol, size = self.plan.inner.accuracy.rtol, np.abs(self._state).max(axis=0)
        if self.plan.velocity == "hermite" and self._free("nv") and (tail := size[-2:].max() / size.max()) > rtol / 10:
            when = self._between(now, now)
            text = f"{when}: the last Hermite functions carry {tail:.2g} of f; raise grid.nv (accuracy.rtol = {rtol:g})"
            raise Unresolved(text, "nv", float(tail))
        if self._free("low"):  # an edge that cuts f, as a given window's may, has short waves of its own
            self._check_spacing(now)
        return diagnostics

    def _check_spacing(self, now: float) -> None:
        """Whether dv is fine enough, by estimates that are a few times larger than the errors they stand for."""
        rtol = self.plan.inner.accuracy.rtol
        error = self._estimate.shortest_waves(self._f, 1 / 4 if self._mixing else 0.0) / 3
        if isinstance(self._operator, Inelastic):
            safety = 1.0 if self._mixing else 5
            error = max(error, self._estimate.of_deposits(self._f, now, self._operator) / safety)
        if error > rtol:
            text = (
                f"{self._between(now, now)}: the spacing in v is too coarse by an estimated {error:.2g} of max f; raise grid.nv"
            )
            raise Unresolved(f"{text} (accuracy.rtol = {rtol:g})", "nv", error)

    def _density_defect(self) -> float:
        """Of steps on velocity points; that of the Hermite step is no measure of f's error after a long step."""
        step = self._stepper.step if isinstance(self._stepper, ExactSteps) else None
        return step.density_defect if isinstance(step, GridLinearisedStep) else 0.0

    # -- changes of grid

    def _free(self, what: str) -> bool:
        """Whether this part of the grid is rtol's to choose."""
        given, points = self.plan.inner.grid, self.plan.velocity != "hermite"
        if what == "nx":
            return given.nx is None and self.plan.grid.nx > 1
        if what == "nv":
            return given.nv is None
        return points and given.nv is None and given.velocity_window is None

    def _suspect(self) -> str:
        """What to make larger where steps cannot meet their tolerance: the window, if f reaches its edges, else nv."""
        low, high = np.abs(self._f[:, [0, -1]]).max(axis=0)
        if max(low, high) > 0.03 * self.plan.inner.accuracy.rtol * self._f.max():
            return "low" if low > high else "high"
        return "nv"

    def _limited_by_the_grid(self, step: float) -> bool:
        """Raises where a larger grid may help; True where it was given and is to blame, with a warning."""
        what = self._suspect()
        if what == "nv" and self._estimate.shortest_waves(self._f) < 0.1 * self.plan.inner.accuracy.rtol:
            return False
        text = (
            f"steps shorter than {step:.2g} no longer help: the grid limits the accuracy; widen grid.velocity_window or raise "
            "grid.nv"
        )
        if self._free(what):
            raise Unresolved(f"{self._between(self._now, self._now)}: {text}", what, 1.0)
        warnings.warn(text, stacklevel=5)
        return True

    def _enlarge(self, problem: Unresolved) -> None:
        """Go back to the last good state with a larger grid, or stop where there is none to be had."""
        plan, tried = self.plan, self._tried.setdefault(problem.what, [])
        grid, first = plan.grid, self._first.grid
        hopeless = len(tried) >= 4 and problem.value > 0.5 * min(tried[:-3])
        tried.append(problem.value)
        if problem.what == "nx" and self._exact and plan.shortest_step > 0 and self._free("nv") and len(tried) % 2:
            # Within a step are states that friction has not yet acted on, with steeper waves than any that is seen.
            plan = self._with_shorter_steps()
            grid = plan.grid
        elif problem.what == "nx":
            grid = dataclasses.replace(grid, nx=fast_odd(math.ceil(FINER * grid.nx)))
        elif problem.what == "nv":
            grid = dataclasses.replace(grid, nv=math.ceil(FINER * grid.nv))
        else:
            more = WIDER * (grid.high - grid.low)
            low, high = (more, 0.0) if problem.what == "low" else (0.0, more)
            grid = window_in_cells(grid, grid.low - low, grid.high + high)
        if hopeless or not self._free(problem.what) or grid.nx * grid.nv > MOST_GROWTH * first.nx * first.nv:
            if problem.value <= plan.inner.accuracy.rtol and self._monitor.share < 1:
                self._monitor.share = 1.0  # a larger grid is not to be had, and this one will do
                self._change(plan, carried=False)
                return
            times = sum(map(len, self._tried.values())) - 1
            raise SolverStopped(f"{problem}" + (f" (refining the grid {times} times did not help)" if times else "")) from None
        self._change(dataclasses.replace(plan, grid=grid), carried=False)

    def _with_shorter_steps(self) -> Plan:
        """Exact steps of two thirds of the length, on points dense enough for their kernel."""
        rules = self._rules
        step = (self.plan.time_step or self.plan.inner.run.end_time) / FINER
        grid = self.plan.grid
        nv = max(grid.nv, math.ceil((grid.high - grid.low) / rules.exact_step_spacing(step)))
        return dataclasses.replace(self.plan, time_step=step, grid=dataclasses.replace(grid, nv=nv))

    def _change(self, plan: Plan, carried: bool) -> None:
        """Go on from the last good state by another plan. Exact steps that are not carried over start again from time 0."""
        old, grid = self.plan, plan.grid
        if plan.shortest_step > 0 and grid.dv != old.grid.dv:
            shortest = self._rules.shortest_exact_step(grid)
            plan = dataclasses.replace(plan, shortest_step=shortest)
        try:
            check_memory(plan)
        except SceneError as error:
            raise SolverStopped(f"{self._between(self._good[0], self._good[0])}: {error}") from None
        stepper = self._stepper
        self._build(plan)
        self._now, state, mark = self._good
        if self._ledger is not None:
            self._ledger.rewind(mark)
        self._grids.append((self._now, grid))
        if isinstance(stepper, ExactSteps) and isinstance(self._stepper, ExactSteps):
            if carried:
                stepper.carry_over(self._stepper.step, lambda f: regrid(f, old.grid, grid))
                self._stepper = stepper
                self._state = regrid(state, old.grid, grid)
            else:
                self._state, self._behind = self._representation.start(), self._now
        elif self._now == 0:
            self._state = self._representation.start()
        else:
            points = plan.velocity != "hermite"
            self._state = regrid(state, old.grid, grid) if points else _with_functions(resize(state, grid.nx), grid.nv)
        self._f = self._representation.points(self._state)
        if self._ledger is not None and self._now == 0:
            self._ledger.start(self._f, self._representation.totals(self._state))

    def _smaller(self) -> PhaseSpaceGrid | None:
        """A grid that would still hold f, where it is worth going over to it. What was once too small is not made smaller."""
        plan, grid, rtol, f = self.plan, self.plan.grid, self.plan.inner.accuracy.rtol, self._f
        if (plan.times[-1] - self._now) / self._step < LEFT or self._mixing:
            return None
        new, rules = grid, self._rules
        if self._free("nx") and "nx" not in self._tried:
            waves = int(np.flatnonzero(self._monitor.waves(f, self._now) > rtol / 100)[-1])
            new = dataclasses.replace(new, nx=min(grid.nx, rules.enough_points(waves, f.sum(axis=1) * grid.dv)))
        if self._free("low") and not self._tried.keys() & {"low", "high"}:
            held = np.flatnonzero(self._monitor.amplified(f, self._now) > rtol / 300 * f.max())
            m = moments(grid, f)
            low, high = rules.window_to_come(m.mean_velocity, m.temperature, plan.times[-1] - self._now)
            needed = np.searchsorted(grid.faces, [low, high])
            first, last = max(0, min(held[0], needed[0] - 1)), min(grid.nv, max(held[-1] + 1, needed[1]))
            new = dataclasses.replace(new, nv=last - first, low=grid.faces[first], high=grid.faces[last])
        if self._free("nv") and not self._exact and plan.velocity != "hermite" and "nv" not in self._tried:
            nv = self._estimate.enough_velocities(f, self._now, self._operator)
            amplitude = self._monitor.waves(f, self._now)
            alive = np.flatnonzero(amplitude > rtol / 10)
            left, digits = float(plan.times[-1]) - self._now, np.log(10 * amplitude[alive] / rtol)
            mixing = rules.mixing_to_come(grid.wavenumbers[alive], digits, rules.theta_min, left)
            nv = max(nv, math.ceil((grid.high - grid.low) * mixing / math.pi))
            new = dataclasses.replace(new, nv=min(new.nv, max(16, math.ceil(new.nv * nv / grid.nv))))
        return new if WORTH_SHRINKING * new.nx * new.nv <= grid.nx * grid.nv else None

    # -- what the run says

    def _between(self, start: float, end: float) -> str:
        a, b = self.plan.frame.place(start).time, self.plan.frame.place(end).time
        return f"between t = {a:.6g} and {b:.6g}" if b > a else f"t = {a:.6g}"

    def _last_words(self) -> None:
        plan, scene, stepper = self.plan, self.plan.inner, self._stepper
        if not isinstance(stepper, Controlled):
            return
        if plan.symmetric and plan.stepping == "extrapolated":
            shortest = stepper.shortest / stepper.method.counts[-1]
            self._rules.warn_of_an_unresolved_kernel(plan.grid, shortest, plan.drift_diffusion)
        if stepper.fixed is not None:
            estimate = stepper.error / float(np.abs(self._f).max())
            if estimate > scene.accuracy.rtol:
                warnings.warn(
                    f"grid.time_step = {stepper.fixed:g}: the steps' errors may add up to {estimate:.2g} of max f "
                    f"(accuracy.rtol = {scene.accuracy.rtol:g}); reduce it, or leave it out",
                    stacklevel=2,
                )

    def _report(self) -> Report:
        place = self.plan.frame.place
        grids = [f"t = {place(time).time:.4g}: {g.nx} × {g.nv} on [{g.low:.4g}, {g.high:.4g}]" for time, g in self._grids]
        return Report(self._estimate.total, self._estimate.limited_by(), "; ".join(grids))
