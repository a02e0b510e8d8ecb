"""What the velocity window does to f: it cuts off the ends of the start, and keeps in what would leave it within a step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.laws import FollowTheLeader
from kinetic_solver.plan.edges import stays_slow
from kinetic_solver.solver.observation import Observation
from kinetic_solver.stepping import ExactSteps
from kinetic_solver.theory.ornstein_uhlenbeck import transition

ALL_OF_IT = 5.0
"""Times the most that stays within a step at one velocity: what stays about it, and what of the steps before is left. Measured:
errors of the homogeneous state came to 0.4 to 1.2 of that most, of cold starts to 3.5 (tests/convergence/test_edges.py)."""


@dataclass(frozen=True)
class CutOff:
    """Of f at time 0 beyond one edge."""

    height: float
    """The largest f at the edge, amplified as operator (6) does."""
    length: float
    """In v, within which it falls by a factor of e there."""
    overtaking: float
    """How much faster than the flow at the place where it is, at least; 0 at the lower edge."""
    thinnest: float
    """The least density of the start."""

    def after(self, seen: Observation) -> float:
        """What its absence makes of f by then, over max f. Noise has spread it over a Gaussian of variance s²: of height·length
        it leaves at most height·length/√(2π s²), and the mass is made up for elsewhere; (6) has stopped all but exp(-Sρwt) of the
        fast, t as friction ends it."""
        model, law = seen.plan.inner.model, seen.plan.law
        step = transition(model, seen.clock)
        spread = math.sqrt(2 * math.pi * step.velocity_variance)
        left = 1.0 if spread <= 2 * self.length else 2 * self.length / spread
        if isinstance(law, FollowTheLeader):
            left *= math.exp(-law.cross_section * self.thinnest * self.overtaking * step.drift_time)
        return self.height * left / float(seen.f.max())


def cut_off(seen: Observation, diagnostics: dict[str, float]) -> tuple[CutOff, CutOff]:
    """At the lower and the upper edge, of the state at time 0."""
    f, grid = seen.f, seen.grid
    top, thinnest = float(f.max()), max(0.0, float(seen.moments.density.min()))
    found = []
    for name, edge, inner in (("edge_error_low", 0, 1), ("edge_error_high", -1, -2)):
        at = int(np.abs(f[:, edge]).argmax())
        outermost, next_to_it = abs(float(f[at, edge])), abs(float(f[at, inner]))
        length = grid.dv / math.log(next_to_it / outermost) if 0 < outermost < next_to_it else math.inf
        overtaking = max(0.0, grid.high - float(seen.moments.mean_velocity.max())) if edge else 0.0
        found.append(CutOff(diagnostics[name] * top, length, overtaking, thinnest))
    return found[0], found[1]


def of_what_stays(seen: Observation) -> float:
    """What exact steps of (6) keep within the window, over max f: of the fastest place and of the hottest or, of a start, coldest
    (plan/edges.py)."""
    plan, m, steps = seen.plan, seen.moments, seen.scheme.stepper
    model = plan.inner.model
    kernel = plan.drift_diffusion == "kernel" and plan.velocity == "points" and model.friction * model.noise > 0
    if not (kernel and plan.scales.amplifies and isinstance(steps, ExactSteps)):
        return 0.0
    farthest = steps.spacing + steps.aside  # a frame shortly after a link is reached from the one before
    growth, window = plan.scales.cross_section * float(m.density.max()), (seen.grid.low, seen.grid.high)
    hottest = float(m.temperature.max())
    if seen.clock <= farthest:  # the step began with the start
        means, temperatures = plan.scales.mean_velocity.ravel(), plan.scales.temperature.ravel()
        places = {int(means.argmax()), int(temperatures.argmax()), int(temperatures.argmin())}
    else:
        means, temperatures = m.mean_velocity, m.temperature
        places = {int(means.argmax()), int(temperatures.argmax())}
    begun = [(float(means[at]), float(temperatures[at])) for at in places]
    found = (
        stays_slow(model, growth, window, min(seen.clock, farthest), mean, temperature) * max(1.0, hottest / temperature) ** 0.5
        for mean, temperature in begun
        if temperature > 0  # where f is thin it may be less
    )
    return ALL_OF_IT * max(found, default=0.0)
