"""Steps in time: how long they may be, how short, and how many they will be.

Exact steps have no error in time; their length is bounded by what happens within them. The others are bounded by the error that
their method makes, Strang's by a measured rule, extrapolated ones by their own estimate while they run.
"""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.velocity.kernel import resolution
from kinetic_solver.plan import kernel_sums, measured
from kinetic_solver.plan.criterion import Criterion
from kinetic_solver.plan.refusal import Refused, Remedy
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import Waves
from kinetic_solver.scene import SteppingScheme
from kinetic_solver.stepping import count_of
from kinetic_solver.theory.ornstein_uhlenbeck import transition

FARTHEST = (4.0, 2.0)
"""Of an exact step, in mean times between thermal collisions and in relaxation times. Chosen: within a step are states on which
friction has not yet acted, and collisions then move them by a few √θ at most."""
ERROR_SHARE = {True: 0.3, False: 1.0}
"""Of rtol, to the estimated errors of all steps together, with (6) and with (12); by a law of one's own that amplifies it is
divided by `amplified_error`. Chosen: with (12) estimates are twice the error or more, and a step is rarely as long as it may be;
with 1.4 one of 118 random scenes told 2.7 rtol (benchmarks/random_kinds.py), with 1 none more than 0.9, the grid's share
included."""
MEMORY_TIME = 5.0
"""Relaxation times for which the errors of steps last with (6), and where nothing else forgets them: exp(-5) is left then."""
LONGER = 1.1
"""From one to the next of the shortest exact steps that are tried. Chosen."""
STABLE = 2.6
"""Step times collision frequency at the window's edge that Lawson's method may take: it is stable to 2.8. With up to 10 in two
half steps the error of a wave of 95 %, Sρ = 10, ε = 0.9, came to 2.7 rtol (1e-3) unseen."""
WHOLE_PARTS = 1.2
"""By how many times more steps it takes than that asks for: lengths are parts of what is left of an interval. Measured."""
MOST_GROWTH = 300.0
"""Exponent of the largest growth that is told from more."""
MOST_MIXING = 2e4
"""Λ min(1/γ, t) up to which steps under error control were seen to follow waves that mix in v: 2.5e4 did, 3.4e4 did not (pipes of
0.0004 and 0.0003; tests/contracts/test_refusals.py)."""
MOST_STEPS = 1_000_000
"""Of a run, between frames: more would take hours on the smallest grid."""
FEWER_STEPS = (
    Remedy("run.end_time", "less"),
    Remedy("collisions.cross_section", "less"),
    Remedy("initial.density", "less"),
    Remedy("model.friction", "less"),
    Remedy("initial.temperature", "less"),
    Remedy("pipe.length", "more"),
)
"""What may bring the number of steps down."""
MIXING = (6.0, 12, 4)
"""(a, n, m): budgets are integrated on up to n intervals, m for each mode, within a/(k√θ_min), in which free motion mixes the
start's longest wave k away. Chosen."""


def farthest_exact_step(scales: Scales) -> float:
    """Within an exact step are states that friction has not yet acted on: collisions may move them by a few √θ."""
    free, relaxation = FARTHEST
    friction = scales.scene.model.friction
    return min(free / scales.collision_rate, relaxation / friction if friction > 0 else math.inf, scales.end)


def shortest_exact_step(scales: Scales, waves: Waves, grid: PhaseSpaceGrid, widths: float | None = None) -> float:
    """The time from which on dv resolves the kernel, twice that in the local gauge, and its sums with f; where none does, the
    farthest step.

    The kernel's width after h is √(σ(1 - exp(-2γh))); it is to be `widths` times dv, `resolution`(rtol) unless given.
    """
    gamma, sigma = scales.scene.model.friction, scales.scene.model.noise
    if gamma * sigma == 0 or scales.law is None:
        return 0.0
    spread = ((resolution(scales.rtol) if widths is None else widths) * grid.dv) ** 2 / sigma
    longest = farthest_exact_step(scales)
    if spread >= 1:
        return longest
    shortest = min(longest, -math.log1p(-spread) / (2 * gamma) * (2 if waves.local_gauge else 1))
    begun = kernel_sums.links(scales, longest) if scales.amplifies else np.empty(0)
    while scales.amplifies and shortest < longest and not kernel_sums.good(scales, waves, grid.dv, begun, shortest):
        shortest = min(longest, LONGER * shortest)
    return shortest


def longest_strang_step(scales: Scales, waves: Waves) -> Criterion:
    """At which Strang's splitting errs by RULE_SHARE of rtol, and no longer than the time in which its parts fail to commute."""
    coefficient, rate = strang_coefficient(scales), commutation_rate(scales, waves)
    share = measured.RULE_SHARE
    h = min(1.0, math.sqrt(share * scales.rtol / coefficient)) / rate
    return Criterion(min(h, scales.end), f"splitting error {coefficient:.2g} (rate h)² = {share:g} rtol, rate = {rate:.3g}")


def strang_error(scales: Scales, waves: Waves, h: float) -> float:
    """Of f over max f, of Strang's splitting in steps of h."""
    return strang_coefficient(scales) * (commutation_rate(scales, waves) * h) ** 2


def strang_coefficient(scales: Scales) -> float:
    """Strang's error of f over max f, over (rate h)²."""
    law = scales.law
    assert law is not None
    return measured.STRANG_ERROR[law.name] * (amplified_error(scales) if law.linearises else law.dissipation**2)


def amplified_error(scales: Scales, clock: float = 0.0) -> float:
    """By how much the errors of steps grow with (6), or a law that amplifies likewise, from then until the end of the run."""
    rate = measured.AMPLIFIED if scales.amplifies else measured.AMPLIFIED_BY_PAIRS * abs(scales.slows)
    if rate == 0:
        return 1.0
    model, left = scales.scene.model, max(0.0, scales.end - clock)
    share = transition(model, left).drift_time / transition(model, scales.end).drift_time
    return grown(rate * scales.amplification * share)


def grown(exponent: float) -> float:
    """exp, or a number so large that whatever grows by it is out of reach."""
    return math.exp(min(exponent, MOST_GROWTH))


def commutation_rate(scales: Scales, waves: Waves) -> float:
    """The fastest rate Λ at which the split parts of (2) fail to commute: γ, collisions, transport across a wave."""
    k = 2 * math.pi / scales.scene.pipe.length * waves.highest_mode
    return scales.scene.model.friction + scales.collision_rate + k * math.sqrt(scales.theta_max)


def budget_step(scales: Scales) -> Criterion:
    """The longest at which the budgets' integrals in time, quintic splines through the ends of the steps, are good."""
    bound = measured.BUDGET_STEP
    h = bound / max(scales.lab_friction + scales.collision_rate, bound / scales.end)
    return Criterion(h, "the budgets' integrals in time")


def first_step(scales: Scales, waves: Waves) -> float:
    """With (12), that of a run: of a longer one, over waves that have not mixed yet, the error's estimate cannot be believed."""
    return math.inf if scales.amplifies else 1 / commutation_rate(scales, waves)


def memory_time(scales: Scales) -> float:
    """How long errors last, at most the run: where friction and noise act on pairs, until these and inelastic collisions at the
    mean density have forgotten them, unless pairs slow down and amplify them; else a few relaxation times. By the frame's
    clock."""
    model, law = scales.scene.model, scales.law
    rate = scales.forgetting / MEMORY_TIME
    if scales.of_pairs and not scales.slows and model.friction * model.noise > 0:
        assert law is not None
        rate = model.friction + law.frequency(float(scales.density.mean()), scales.hottest) * law.dissipation
    return min(scales.end, 1 / rate if rate > 0 else math.inf)


def filling(scales: Scales, longest: float) -> float:
    """The longest step, of at most this length, of which the run is a multiple."""
    return scales.end / count_of(scales.end, longest)


def longest_gap(scales: Scales) -> Criterion:
    return Criterion(float(np.diff(scales.times).max()), "from frame to frame")


def shortest_step_that_fills(scales: Scales, time_step: float) -> float:
    """The shortest of the equal steps, none longer than `time_step`, that fill the intervals between frames."""
    return min(float(gap) / count_of(float(gap), time_step) for gap in np.diff(scales.times))


def expected_steps(scales: Scales, waves: Waves, stepping: SteppingScheme, time_step: float | None) -> int:
    """How many steps a run will take; with error control, about. Exact ones end at frames and at the links of their chain."""
    h = math.inf if time_step is None else time_step
    _check_number(scales, scales.end / h)
    if stepping == "exact":
        links = h * np.arange(1, count_of(scales.end, h)) if h < scales.end else np.empty(0)
        return int(np.unique(np.round(np.concatenate([links, scales.times[1:]]) / scales.end, 9)).size)
    growing = 0
    if stepping == "extrapolated" and scales.scene.grid.time_step is None:
        if scales.amplifies:
            h = min(h, (scales.rtol / measured.LAWSON_ERROR) ** 0.2 / commutation_rate(scales, waves))
        else:
            _check_mixing(scales, waves)
            h = min(h, _lawson_step(scales))
            growing = _growing(scales, waves, h)
    _check_number(scales, scales.end / h)
    return growing + sum(count_of(float(gap), h) for gap in np.diff(scales.times))


def lawson_steps(scales: Scales, waves: Waves) -> float:
    """Of a run with pairs under error control in Lawson's variable, about; tries are counted."""
    h = min(_lawson_step(scales), longest_gap(scales).value)
    return _growing(scales, waves, h) + sum(count_of(float(gap), h) for gap in np.diff(scales.times))


def _lawson_step(scales: Scales) -> float:
    """Of Lawson's method with pairs, about: where the tail is stable, and where collisions make their share of the error."""
    rate, lasting = scales.collision_rate, memory_time(scales)
    if rate * lasting == 0:
        return math.inf
    coefficient, coupled, power = measured.LAWSON_COLLISIONS
    turning = abs(scales.scene.model.friction) + coupled * rate
    error = ERROR_SHARE[False] * scales.rtol / (coefficient * math.sqrt(rate * lasting) * math.sqrt(rate / turning))
    return float(min(STABLE / (WHOLE_PARTS * rate * scales.tail), error ** (1 / (power + 0.5)) / turning))


def _growing(scales: Scales, waves: Waves, h: float) -> int:
    """Steps more, since error control begins with short ones, and at the most doubles them."""
    doublings = measured.STEPS_TO_A_DOUBLING * math.log2(h / first_step(scales, waves))
    return max(0, round(doublings), round(steps_after_a_jump(scales, waves)))


def steps_after_a_jump(scales: Scales, waves: Waves) -> float:
    """Of a run with pairs under error control, while a jump in the density smooths; 0 where there is none."""
    rate = scales.collision_rate * memory_time(scales)
    if scales.scene.initial.step is None or rate == 0:
        return 0.0
    earlier, coefficient = measured.AFTER_A_JUMP
    share = (ERROR_SHARE[False] * scales.rtol / coefficient) ** (1 / 4) / math.sqrt(rate)
    return math.log(earlier * max(1.0, scales.end / first_step(scales, waves))) / math.log1p(share)


def _check_mixing(scales: Scales, waves: Waves) -> None:
    """Waves that cross the pipe so often mix in v to what the points do not hold, before friction and noise act."""
    friction, scene = scales.scene.model.friction, scales.scene
    crossings = commutation_rate(scales, waves) * min(scales.end, 1 / friction if friction > 0 else math.inf)
    if crossings > MOST_MIXING and scene.grid.time_step is None:
        raise Refused(
            f"pipe.length = {scene.pipe.length:g}: particles cross its waves {crossings:.2g} times before friction acts, "
            f"more than the {MOST_MIXING:g} that error control follows",
            (
                Remedy("pipe.length", "more"),
                Remedy("run.end_time", "less"),
                Remedy("model.friction", "more"),
                Remedy("initial.temperature", "less"),
            ),
        )


def _check_number(scales: Scales, steps: float) -> None:
    if steps > MOST_STEPS and scales.scene.grid.time_step is None:
        raise Refused(
            f"run.end_time = {scales.end:g}: {steps:.2g} steps in time would be needed, more than {MOST_STEPS}",
            FEWER_STEPS,
        )


def error_share(scales: Scales) -> float:
    """Of rtol, to the local errors of all steps together: less where (6) amplifies them later."""
    if scales.amplifies:
        return ERROR_SHARE[True] * math.exp(-measured.AMPLIFIED * scales.amplification)
    return ERROR_SHARE[False] / amplified_error(scales)


def budget_pieces(scales: Scales, waves: Waves) -> Array:
    """Ends of the intervals on which the budgets of an exact step are integrated, besides its own: while the start's waves mix a
    few per mean free flight across the shortest; and where the frame's clock runs as exp(-γt), two per relaxation time."""
    pieces = np.empty(0)
    if scales.lab_friction > scales.scene.model.friction == 0:
        clock = 1 - scales.lab_friction * scales.end  # exp(-γt) at the end
        steps = np.arange(1, math.ceil(-2 * math.log(clock)))
        pieces = -np.expm1(-steps / 2) / scales.lab_friction
    if scales.start.homogeneous:
        return pieces
    reach, most, per_mode = MIXING
    k, thermal = 2 * math.pi / scales.scene.pipe.length, math.sqrt(scales.theta_min)
    count = min(most, math.ceil(per_mode * waves.highest_mode))
    return np.union1d(pieces, reach / (k * thermal) * (np.arange(count) + 1) / count)
