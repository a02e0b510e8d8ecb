"""Steps of a homogeneous flow of (12): one from frame to frame, by an integrator of ordinary differential equations.

Tests: tests/exact/test_homogeneous_flow.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy, StepTooSmall
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.homogeneous import HomogeneousFlow, Shape, points
from kinetic_solver.plan import Plan, ReferenceFrame, homogeneous
from kinetic_solver.stepping import Step, integrate

HELD, ENDS, KEPT = 1.0, 10.0, 0.1
"""Local errors: the shortest waves of F, and F at its window's edges, at most, and the waves that are kept where fewer points may
do. All waves that are left out together are some tens of the longest of them. Chosen; of themselves local errors leave a quarter
of one in a wave, and up to three at the edges."""
ADDED_UP = 30.0
"""Local errors that the error of an interval may come to, as it is told: that of 32 runs, hot, cold, and of beams, was less at
each rtol from 1e-3 to 1e-8 (tests/exact/test_homogeneous_flow.py)."""
FINER, WIDER = 1.5, 1.3
"""By how much the points, and the window, are raised at a time where they do not hold F. Chosen."""
TRIES = 8
"""After so many F is not held at all. Chosen."""
RELAXED, AT_REST = 40.0, 3.0
"""Relaxation times 1/γ after which nothing moves, for what lasts longest falls as exp(-2γt); or, before, local errors between
F and the homogeneous state."""
MANY, WORTH_FEWER = 250, 1.3
"""Of so many points a run looks, after a collision or relaxation time, whether as many times fewer would do: their number squared
is what a rate costs. Chosen."""


@dataclass(frozen=True)
class Place:
    """All that one step hands to the next."""

    shape: Shape
    elapsed: float
    """Since the interval began; 0 at its end."""


class HomogeneousSteps:
    """A stepper (stepping/protocol.py) from frame to frame; f itself is only looked at."""

    order = math.inf
    error_order = None

    def __init__(self, plan: Plan) -> None:
        assert isinstance(plan.law, Inelastic)
        self.plan, self.law = plan, plan.law
        self.model, self.grid = plan.inner.model, plan.grid
        self.rtol = plan.inner.accuracy.rtol
        self.local = homogeneous.local_error(self.rtol)
        self.held, self.ends, self.kept = HELD * self.local, ENDS * self.local, KEPT * self.local
        self.mean = ReferenceFrame(self.model, moving=True, start=plan.scales.start.mean_velocity)
        """The mean velocity moves as that of a frame which falls freely."""
        self.books = plan.scene.output.budgets is not False
        self.relaxed = RELAXED / self.model.friction
        self._flow: HomogeneousFlow | None = None
        self._rest: Shape

    def begin(self, state: Array, time: float) -> Place:
        """The start, at time 0: known at any velocity, and better than at the grid's points."""
        assert time == 0
        start, on = self.plan.scales.start, homogeneous.shape_grid(self.plan.scales)
        width, x = math.sqrt(start.temperature), self.grid.x
        values = width * start.distribution(x, start.mean_velocity + width * points(on.half, on.count))[0]
        values /= values.sum() * (2 * on.half / on.count)
        even = not np.ptp(self.plan.scales.mean_velocity[:, 0])
        return Place(Shape.of(values, float(start.density(x)[0]), start.mean_velocity, width, on.half, even), 0.0)

    def step(self, state: Array, memory: Place, start: float, interval: float) -> Step:
        """To the end of the interval, or, with many points, to where fewer may do. Raises LostAccuracy where no points hold F."""
        shape, begun = memory.shape, start + memory.elapsed
        end = start + interval
        if begun < self.relaxed < end:
            end = self.relaxed
        if shape.count > MANY:
            rate = self.model.friction + self.law.frequency(shape.mass, shape.width**2)
            end = min(end, begun + 1 / rate)
        for _ in range(TRIES):
            try:
                y = self._integrated(shape, begun, end)
                waves, edges = self._unresolved(shape, y)
            except StepTooSmall:
                waves, edges = math.inf, 0.0  # F that its points do not hold may grow beyond all bounds
            if waves <= self.held and edges <= self.ends:
                return self._taken(shape, y[-1], (begun, end), (start, interval))
            # Waves that are not held reach the edges, too: a wider window would not mend that.
            half = shape.half * (WIDER if edges > max(self.ends, ENDS * waves) else 1.0)
            more = half / shape.half * (FINER if waves > self.held else 1.0)
            shape = shape.on(half, 2 * math.ceil(more * shape.count / 2) + 1)
        raise LostAccuracy(f"{shape.count} points do not hold the velocity distribution")

    def _integrated(self, shape: Shape, begun: float, end: float) -> Array:
        """y of the flow at the end of each of the integrator's steps."""
        flow = self._flow
        if flow is None or (flow.half, flow.count) != (shape.half, shape.count):
            flow = self._flow = HomogeneousFlow(self.model, self.law, shape)
            self._rest = homogeneous.at_rest(self.plan.scales, shape)
        flow.width = shape.width
        y = np.append(shape.waves, np.zeros(3))
        if begun >= self.relaxed or shape.distance(self._rest) <= AT_REST * self.local:
            brought = np.zeros(y.size)
            brought[-2:] = (end - begun) * flow.rate(begun, y)[-2:]
            return (y + brought)[None]
        hottest = max(self.model.noise / shape.width**2, 1.0)
        # Of F at a point the errors of all waves together.
        of_waves = np.abs(shape.values).max() / math.sqrt(shape.count)
        scales = np.append(np.full(shape.waves.size, of_waves), [1.0, hottest * self.model.friction * (end - begun), hottest])
        return integrate(flow.rate, flow.jacobian, y, begun, end, self.local, self.local * scales)

    def _unresolved(self, shape: Shape, y: Array) -> tuple[float, float]:
        """(its shortest waves, F at its window's edges), over the largest F: the largest of all steps."""
        longest = shape.count // 2 + 1
        real = y[:, :longest]
        last = np.abs(real[:, -2:])
        if not shape.even:
            last = np.hypot(last, y[:, shape.waves.size - 2 : shape.waves.size])
        signs = 2.0 * (-1.0) ** np.arange(longest)
        signs[0] = 1.0
        largest = np.abs(shape.values).max()
        return 2 * float(last.max()) / largest, float(np.abs(real @ signs).max()) / largest

    def _taken(self, shape: Shape, y: Array, step: tuple[float, float], within: tuple[float, float]) -> Step:
        """`step` is its beginning and end, `within` beginning and length of the interval."""
        (begun, end), (start, interval) = step, within
        n, done = shape.waves.size, end == start + interval
        width = shape.width * math.exp(y[n])
        now = Shape(y[:n], shape.even, shape.mass, self.mean.place(end).velocity, width, shape.half)
        f = now.at(self.grid.v)[None]
        integral = None
        if self.books:
            position, kinetic = np.subtract(self.mean.travelled(end), self.mean.travelled(begun)).tolist()
            thermal, brought = shape.width**2 * y[n + 1 :]
            thermal /= self.model.friction
            integral = now.mass * self.grid.length * np.array([position, kinetic + thermal / 2, 0.0, brought])
        needed = now.needed(self.kept)
        later = now.on(now.half, needed) if now.count > max(MANY, WORTH_FEWER * needed) else now
        elapsed = interval if done else end - start
        error = ADDED_UP * self.local * float(f.max())
        return Step(f, elapsed, end - begun, error, Place(later, 0.0 if done else elapsed), integral=integral)
