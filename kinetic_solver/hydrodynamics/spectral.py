"""A run of M moments: steps with error control on as many waves as the solution needs.

A step is the classical Runge-Kutta method on exp(-Lt)ã, whose linear part is exact (J. D. Lawson 1967), taken as one step and
as two and extrapolated: order 5, tests/hydrodynamics/test_hierarchy.py. Lengths are binary fractions of the time between
frames, so that few matrix exponentials are needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.hierarchy import Hierarchy
from kinetic_solver.hydrodynamics.plan import Plan
from kinetic_solver.hydrodynamics.records import Values, values
from kinetic_solver.stability.units import Complex

SHARE = 0.02
"""Of rtol, the error per relaxation time 1/γ that steps may make: what operator (6) amplifies (exp(R*²/2) at most,
docs/stability_details.md) fits up to R* ≈ 3."""
TAIL = 0.1
"""Of rtol, what the shortest eighth of the waves may hold of ρ̄."""
GROW = 1.5
"""By how much the number of waves is raised."""
MOST_WAVES, MOST_NUMBERS = 1024, 4_000_000
"""Of a solution, and of an exponential, which has M² numbers for every wave: 64 MB."""
SHORTEST = 2**24
"""Steps between two frames, beyond which a run gives up."""
RUNAWAY = 1e3
"""Of ρ̄, what no moment of a solution that can be resolved reaches."""


class SpectralRun:
    """M moments of a plan's scene, from 0 to the end."""

    def __init__(self, plan: Plan) -> None:
        assert plan.moments is not None
        self.plan, self.hierarchy = plan, Hierarchy(plan.scene, plan.moments)
        self.time = 0.0
        self.recorded = 0
        """Frames that were handed on."""
        self._within: tuple[int, int] | None = None
        """(level, done) of `_advance` in the interval after the last of them."""
        self._most = min(MOST_WAVES, MOST_NUMBERS // plan.moments**2)
        self._given = plan.scene.grid.nx
        self._density, self._rtol = plan.scene.initial.density, plan.scene.accuracy.rtol
        self._tables: dict[float, Complex] = {}
        self._last = plan.scene.run.end_time
        """The last step."""
        if self._given is not None:
            self.state = self.hierarchy.start((self._given - 1) // 2)
        elif plan.scene.homogeneous:
            self.state = self.hierarchy.start(0)
        else:
            waves = 16
            while self._tail(state := self.hierarchy.start(waves)) > 0.01 * TAIL * self._rtol and waves < self._most:
                waves = math.ceil(GROW * waves)
            self.state = state
        self._generator = self.hierarchy.generator(self.state.shape[0] - 1)

    def frames(self, after_step: Callable[[SpectralRun], None] = lambda run: None) -> Iterator[tuple[int, Values]]:
        """(number, values) of the frames that are not recorded yet.

        `after_step` is called after every step and every frame but the last, and may raise. Raises SolverStopped where waves grow
        beyond what can be resolved."""
        times = self.plan.schedule.times.tolist()
        for number in range(self.recorded, len(times)):
            if number > 0:
                self._advance(times[number - 1], times[number], after_step)
            self.time = times[number]
            yield number, values(self.hierarchy.fields(self.state, self.plan.output.nx), self.hierarchy.totals(self.state))
            self.recorded, self._within = number + 1, None
            if self.recorded < len(times):
                after_step(self)

    def report(self) -> dict[str, Any]:
        """Attributes of the run that is over."""
        waves = str(self.state.shape[0] - 1)
        return {"moments": str(self.plan.moments), "waves": waves, "spectral_tail": self._tail(self.state)}

    def snapshot(self) -> dict[str, Any]:
        """A tree from which a new run of the same plan goes on."""
        return {
            "recorded": self.recorded,
            "time": self.time,
            "state": self.state,
            "last": self._last,
            "within": self._within,
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        self.recorded, self.time = snapshot["recorded"], snapshot["time"]
        self.state, self._last, self._within = snapshot["state"], snapshot["last"], snapshot["within"]
        self._generator = self.hierarchy.generator(self.state.shape[0] - 1)

    def _advance(self, start: float, end: float, after_step: Callable[[SpectralRun], None]) -> None:
        """In binary fractions of the interval: `done` of 2^level of them are behind."""
        given = self.plan.scene.grid.time_step
        least = 0 if given is None else max(0, math.ceil(math.log2((end - start) / given) - 1e-9))
        level, done = self._within or (max(least, round(math.log2((end - start) / self._last))), 0)
        while done < 2**level:
            h = (end - start) / 2**level
            new, error = self._attempt(h)
            allowed = SHARE * self._rtol * self._density * h * self.hierarchy.gamma
            if not error <= allowed:
                level, done = level + 1, 2 * done
                if 2**level > SHORTEST:
                    raise self._lost(start + (end - start) * done / 2**level)
                continue
            done += 1
            self.state = new
            self._last = h
            self.time = start + (end - start) * done / 2**level
            self._check(self.time)
            # Two steps make one of twice the length, order 4 before the extrapolation
            if level > least and done % 2 == 0 and error < allowed / 64:
                level, done = level - 1, done // 2
            self._within = (level, done)
            after_step(self)

    def _attempt(self, h: float) -> tuple[Complex, float]:
        with np.errstate(over="ignore", invalid="ignore"):
            once = self._step(self.state, h)
            twice = self._step(self._step(self.state, h / 2), h / 2)
            difference = (twice - once) / 15
        return twice + difference, float(np.abs(difference).max())

    def _step(self, a: Complex, h: float) -> Complex:
        rate, half = self.hierarchy.quadratic, self._half(h)
        k1 = rate(a)
        k2 = rate(half(a + h / 2 * k1))
        moved = half(a)
        k3 = rate(moved + h / 2 * k2)
        k4 = rate(half(moved + h * k3))
        return half(half(a + h / 6 * k1) + h / 3 * (k2 + k3)) + h / 6 * k4

    def _half(self, h: float) -> Callable[[Complex], Complex]:
        """exp(L h/2)."""
        from scipy.linalg import expm

        if h not in self._tables:
            if len(self._tables) > 6:
                self._tables.clear()
            self._tables[h] = expm(h / 2 * self._generator)
        table = self._tables[h]
        return lambda a: np.matmul(table, a[:, :, None])[:, :, 0]

    def _tail(self, state: Complex) -> float:
        """The shortest eighth of the waves over ρ̄."""
        waves = state.shape[0] - 1
        return float(np.abs(state[waves + 1 - max(1, waves // 8) :]).max() / self._density) if waves > 0 else 0.0

    def _check(self, now: float) -> None:
        if not np.abs(self.state).max() < RUNAWAY * self._density:
            raise self._lost(now)
        waves = self.state.shape[0] - 1
        if waves == 0 or self._tail(self.state) <= TAIL * self._rtol:
            return
        if self._given is not None:
            if self._tail(self.state) > TAIL:
                raise self._lost(now)
            return
        if waves >= self._most:
            raise self._lost(now)
        more = min(math.ceil(GROW * waves), self._most) - waves
        self.state = np.pad(self.state, ((0, more), (0, 0)))
        self._generator = self.hierarchy.generator(waves + more)
        self._tables.clear()

    def _lost(self, now: float) -> SolverStopped:
        where = f"{self.state.shape[0] - 1} waves" + ("" if self._given is None else f" (grid.nx = {self._given})")
        return SolverStopped(
            f"t = {now:.6g}: the hierarchy of {self.plan.moments} moments grows beyond what {where} resolve; end before that "
            "(run.end_time), raise hydrodynamics.moments, or lower initial.density"
        )
