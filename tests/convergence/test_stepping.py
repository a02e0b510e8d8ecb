"""Composition in time: observed orders from both sides, error control, exact steps, conservation.

The small problem is y' = λy + (β - cy²), a Riccati equation in closed form, split into its linear part and the rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numba
import numpy as np
import pytest

from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy, StepTooSmall
from kinetic_solver.exact import Solution
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import density, maxwellian, start_state
from kinetic_solver.operators.collisions import FollowLeader, Inelastic
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Scene
from kinetic_solver.stepping import (
    BaseMethod,
    Controlled,
    Embedded,
    ExactSteps,
    Extrapolated,
    Fixed,
    Integral,
    OneStep,
    Signs,
    Stalled,
    Step,
    Stepper,
    advance,
    embedded_lawson,
    lawson,
    strang,
)
from kinetic_solver.stepping.controlled import DEEPEST

MakeScene = Callable[..., Scene]
LAMBDA, BETA, C, T = -2.3, 1.4, 0.8, 1.1
Y0 = np.array([0.2, 0.9, 1.7])


def riccati(y: Array, beta: float, h: float) -> Array:
    """y' = β - cy² over h."""
    fixed, t = math.sqrt(beta / C), math.tanh(math.sqrt(beta * C) * h)
    return fixed * (y + fixed * t) / (fixed + y * t)


def solution(t: float) -> Array:
    """y - λ/2c obeys the equation without a linear part."""
    middle = LAMBDA / (2 * C)
    return middle + riccati(Y0 - middle, BETA + LAMBDA**2 / (4 * C), t)


def grow(y: Array, h: float) -> Array:
    return y * math.exp(LAMBDA * h)


STRANG = strang(lambda y, h: riccati(y, BETA, h), grow)
LAWSON = lawson(lambda y: BETA - C * y**2, grow)
EMBEDDED = embedded_lawson(lambda y: BETA - C * y**2, grow)
SIGNS = Signs(gain=1.2, stages=10.0, power=0.75)
EIGHTH, FIFTH = (1, 2, 3, 4), (1, 2)


def repeated(method: Extrapolated, f: Array, interval: float, steps: int) -> Array:
    for _ in range(steps):
        f = method.step(f, interval / steps)[0]
    return f


def assert_order(order: float, counts: Sequence[int], error: Callable[[int], float]) -> None:
    errors = [error(n) for n in counts]
    pairs = zip(itertools.pairwise(counts), itertools.pairwise(errors), strict=True)
    orders = [math.log(a / b) / math.log(q / p) for (p, q), (a, b) in pairs]
    assert all(abs(seen - order) < 0.3 for seen in orders), (errors, orders)


@pytest.mark.parametrize(
    ("base", "counts", "order", "steps"),
    [
        (STRANG, (1,), 2, (8, 16, 32, 64)),
        (STRANG, (1, 2), 4, (4, 8, 16, 32)),
        (STRANG, (1, 2, 3), 6, (8, 12, 16, 24)),
        (STRANG, EIGHTH, 8, (4, 5, 6, 8)),
        (LAWSON, (1,), 4, (8, 16, 32, 64)),
        (LAWSON, FIFTH, 5, (8, 16, 32, 64)),
    ],
)
def test_orders_on_the_riccati_equation(base: BaseMethod, counts: tuple[int, ...], order: int, steps: tuple[int, ...]) -> None:
    """The order that a method declares is the one that is observed."""
    method = Extrapolated(base, counts)
    assert method.order == order
    assert_order(order, steps, lambda n: float(np.abs(repeated(method, Y0, T, n) - solution(T)).max()))


@pytest.mark.parametrize(
    ("base", "counts", "order"), [(STRANG, (1, 2), 2), (STRANG, (1, 2, 3), 4), (STRANG, EIGHTH, 6), (LAWSON, FIFTH, 4)]
)
def test_the_estimate_is_the_error_of_the_next_lower_order(base: BaseMethod, counts: tuple[int, ...], order: int) -> None:
    """That of one step, in which the error is of an order more; and larger than the error of the result."""
    method = Extrapolated(base, counts)
    assert method.error_order == order
    assert_order(
        order + 1, {2: (16, 24, 32, 48), 4: (32, 48, 64, 96), 6: (12, 16, 20, 24)}[order], lambda n: method.step(Y0, T / n)[1]
    )
    best, estimate = method.step(Y0, T / 8)
    lower, _ = Extrapolated(base, counts[1:]).step(Y0, T / 8)
    assert estimate == pytest.approx(np.abs(best - lower).max(), rel=1e-6)
    assert np.abs(best - solution(T / 8)).max() < estimate


@pytest.mark.parametrize(
    ("counts", "order", "steps"),
    [((1,), 2, (4, 8, 16, 32)), ((1, 2), 4, (4, 8, 16, 32)), ((1, 2, 3), 6, (6, 8, 12, 16)), (EIGHTH, 8, (4, 6, 8, 10))],
)
def test_orders_with_operator_6(standing_scene: MakeScene, counts: tuple[int, ...], order: int, steps: tuple[int, ...]) -> None:
    """Against the closed form at R* = 0.3, on a grid whose own error is 1e-14."""
    scene = standing_scene(0.3)
    grid = PhaseSpaceGrid(63, 128, scene.pipe.length, -9.0, 9.0)
    (u0, theta0), rho = start_state(scene), density(scene, grid.x)
    start = maxwellian(rho, np.full_like(rho, u0), np.full_like(rho, theta0), grid.v)
    linear = LinearStep(grid, scene.model, OrnsteinUhlenbeckKernel(grid, scene.model))
    method = Extrapolated(strang(FollowLeader(grid.v, scene.cross_section), linear), counts)
    truth = Solution(scene, 2.0).distribution(grid.x, grid.v)
    assert_order(order, steps, lambda n: float(np.abs(repeated(method, start, 2.0, n) - truth).max() / truth.max()))


@pytest.fixture
def one_thread() -> Iterator[None]:
    """For arrays so small two threads spend their time waiting for each other."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


def inelastic(make_scene: MakeScene, nx: int = 15, nv: int = 64) -> tuple[BaseMethod, Array]:
    """Lawson's method for (12), and a start off equilibrium; Sρ = 2."""
    scene = make_scene(collisions={"operator": "inelastic", "cross_section": 2.5, "restitution": 0.5})
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, -4.0, 6.0)
    operator = Inelastic(grid.v, scene.cross_section, scene.restitution, "quintic")
    rho = density(scene, grid.x)
    start = maxwellian(rho, np.full_like(rho, 0.9), np.full_like(rho, 0.6), grid.v)
    return lawson(operator.rate, LinearStep(grid, scene.model, OrnsteinUhlenbeckKernel(grid, scene.model))), start


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize(("counts", "order"), [((1,), 4), (FIFTH, 5)])
def test_orders_with_operator_12(make_scene: MakeScene, counts: tuple[int, ...], order: int) -> None:
    """Against the same grid at four times as many steps."""
    base, start = inelastic(make_scene)
    reference = repeated(Extrapolated(base, FIFTH), start, 1.0, 96)
    method = Extrapolated(base, counts)

    def error(steps: int) -> float:
        return float(np.abs(repeated(method, start, 1.0, steps) - reference).max() / reference.max())

    assert_order(order, (8, 12, 16, 24), error)


class Spy(Extrapolated):
    """Notes the length of every step tried, and its estimate."""

    def step(self, f: Array, h: float, integral: Integral | None = None) -> tuple[Array, float]:
        result, error = super().step(f, h, integral)
        self.tried = [*getattr(self, "tried", []), (h, error)]
        return result, error


def steps_of(stepper: Stepper, interval: float, f: Array = Y0) -> list[Step]:
    """The steps that fill the interval."""
    steps: list[Step] = []
    advance(stepper, f, 0.0, interval, steps.append)
    return steps


def driven(stepper: Stepper, intervals: Sequence[float], f: Array = Y0) -> list[Step]:
    """The steps that fill intervals one after another, with one memory."""
    steps, memory, start = [], stepper.begin(f, 0.0), 0.0
    for interval in intervals:
        elapsed = 0.0
        while elapsed < interval:
            step = stepper.step(f, memory, start, interval)
            assert isinstance(step, Step)
            f, memory, elapsed = step.state, step.memory, step.elapsed
            steps.append(step)
        start += interval
    return steps


def total(steps: list[Step]) -> float:
    return sum(step.error for step in steps)


@pytest.mark.parametrize(("base", "counts"), [(STRANG, EIGHTH), (LAWSON, FIFTH)])
def test_controlled_meets_its_tolerance_and_not_by_waste(base: BaseMethod, counts: tuple[int, ...]) -> None:
    """Neighbouring solutions approach each other, so the errors of the steps at most add up."""
    numbers = []
    for tolerance in (1e-3, 1e-6, 1e-8, 1e-10):
        stepper = Controlled(Extrapolated(base, counts), lambda f, tolerance=tolerance: tolerance)
        steps = steps_of(stepper, T)
        error = float(np.abs(steps[-1].state - solution(T)).max())
        assert error < tolerance * T
        assert total(steps) <= tolerance * T
        assert error < total(steps) or len(steps) == 1  # as long as the interval: too long for an estimate of its error
        numbers.append(len(steps))
    assert numbers[0] < numbers[1] < numbers[2] < numbers[3], numbers
    # An estimate of order p asks for 1e4^(1/p) times the steps, and lengths are powers of two.
    assert stepper.error_order is not None
    assert numbers[-1] <= 2 * 1e4 ** (1 / stepper.error_order) * numbers[1], numbers


@pytest.mark.parametrize(("counts", "order"), [((1,), 4), (FIFTH, 5)])
def test_orders_of_integrals_over_steps(counts: tuple[int, ...], order: int) -> None:
    """∫y dt and ∫t²r dt, r the rate that is not linear, against Gauss-Legendre quadrature of the closed form."""

    def watched(y: Array, rate: Array, time: float) -> Array:
        return np.concatenate([y, time**2 * rate])

    def integral(steps: int) -> Array:
        taken = steps_of(Fixed(Extrapolated(LAWSON, counts), T / steps, watched), T)
        return np.sum([step.integral for step in taken], axis=0)

    nodes, weights = np.polynomial.legendre.leggauss(20)
    times = T / 2 * (1 + nodes)
    values = np.array([solution(t) for t in times])
    rates = times[:, None] ** 2 * (BETA - C * values**2)
    truth = T / 2 * np.concatenate([weights @ values, weights @ rates])
    assert_order(order, (12, 16, 24, 32), lambda n: float(np.abs(integral(n) - truth).max()))
    controlled = Controlled(Extrapolated(LAWSON, counts), lambda f: 1e-8, T / 40, watched)
    found = np.sum([step.integral for step in steps_of(controlled, T)], axis=0)
    assert found == pytest.approx(truth, abs=1e-7)


def test_an_embedded_method_is_the_same_with_two_signs_of_its_error() -> None:
    """Lawson's method, of order 4; a result of order 3, whose error in one step is of order 4; a second difference, of order 3;
    and the change, of order 1. Steps that err by 1e-6 to 4e-3 are told at once to twelve times that."""

    def of_step(n: int, sign: str) -> float:
        return float(np.abs(getattr(EMBEDDED(Y0, T / n, None, None), sign)).max())

    known, y = None, Y0
    for _ in range(5):
        y, known, *_ = EMBEDDED(y, T / 5, known, None)
    assert y == pytest.approx(LAWSON.over(Y0, T, 5, None), rel=1e-14)
    assert_order(4, (24, 32, 48, 64), lambda n: of_step(n, "lower"))
    assert_order(3, (48, 64, 96, 128), lambda n: of_step(n, "curvature"))
    assert_order(1, (48, 64, 96, 128), lambda n: of_step(n, "change"))
    method = Embedded(EMBEDDED, SIGNS)
    for n in (2, 4, 6, 8, 12, 16):
        found, estimate, _ = method.onward(Y0, T / n)
        assert 1 < estimate / float(np.abs(found - solution(T / n)).max()) < 12
    assert_order(4.5, (64, 96, 128, 192), lambda n: method.onward(Y0, T / n)[1])


def test_the_estimate_knows_weak_rates() -> None:
    """A rate that is a million times weaker, of time above all, makes errors so many times less, and estimates likewise: within a
    factor of four of one another, where a power of the signs alone tells twenty times less."""

    def turned(y: Array, h: float) -> Array:
        return np.array([[math.cos(h), math.sin(h)], [-math.sin(h), math.cos(h)]]) @ y

    ratios = []
    for weak in (1.0, 1e-2, 1e-4, 1e-6):
        one = embedded_lawson(lambda y, weak=weak: weak * (BETA - C * y**2) * np.array([1.0, 0.3]), turned)
        found, estimate, _ = Embedded(one, SIGNS).onward(Y0[:2], 0.7)
        right = repeated_embedded(one, Y0[:2], 0.7, 64)
        ratios.append(estimate / float(np.abs(found - right).max()))
    assert max(ratios) < 4 * min(ratios), ratios
    assert all(1 < ratio < 30 for ratio in ratios), ratios


def test_no_rate_no_error() -> None:
    """Lawson's method is exact then, and the estimate says so."""
    found, estimate, _ = Embedded(embedded_lawson(np.zeros_like, grow), SIGNS).onward(Y0, T)
    assert estimate == 0
    assert found == pytest.approx(grow(Y0, T), rel=1e-15)


def repeated_embedded(one: OneStep, y: Array, interval: float, steps: int) -> Array:
    for _ in range(steps):
        y = one(y, interval / steps, None, None).state
    return y


@pytest.mark.parametrize("thirds", [False, True])
def test_controlled_with_an_embedded_method(thirds: bool) -> None:
    """It meets its tolerance, and not by waste; each rate is found once; with thirds every length divides what is left."""
    rates = 0

    def counted(y: Array) -> Array:
        nonlocal rates
        rates += 1
        return BETA - C * y**2

    for tolerance in (1e-3, 1e-5, 1e-7):
        rates = 0
        method = Embedded(embedded_lawson(counted, grow), SIGNS)
        stepper = Controlled(method, lambda f, tolerance=tolerance: tolerance, T / 2, memory=T / 3, adding=0.5, thirds=thirds)
        steps = driven(stepper, [T / 2, T / 2])
        assert rates <= 1 + 6 * len(steps)  # four each, one for the start, and those of what was rejected
        error = float(np.abs(steps[-1].state - solution(T)).max())
        assert 1e-4 * tolerance * T < error < 0.1 * tolerance * T  # friction forgets what steps err by
        assert steps[-1].elapsed == T / 2
    lengths = {round(T / 2 / step.length, 9) for step in steps}
    assert any(n % 3 == 0 for n in lengths) == thirds, lengths


@pytest.mark.parametrize("longest", [0.5, 0.3, 0.07])
def test_controlled_takes_dyadic_steps_of_at_most_the_longest(longest: float) -> None:
    stepper = Controlled(Extrapolated(STRANG, EIGHTH), lambda f: 1e-5, longest=longest)
    for interval in (T, 0.4):
        places = [step.elapsed for step in steps_of(stepper, interval)]
        assert places[-1] == interval
        exact = np.array(places) / interval * 2**DEEPEST
        units = np.round(exact)
        assert exact == pytest.approx(units, rel=1e-15)
        lengths = np.diff(units, prepend=0.0)
        assert np.array_equal(lengths, 2.0 ** np.round(np.log2(lengths)))
        assert not np.any(units % lengths)
        assert lengths.max() * interval / 2**DEEPEST <= longest


def test_controlled_goes_on_with_the_length_it_found() -> None:
    """In a second interval nothing is rejected that the first has taught; longer steps come back."""
    method = Spy(LAWSON, FIFTH)
    stepper = Controlled(method, lambda f: 1e-9)
    first = driven(stepper, [T])
    rejected = len(method.tried) - len(first)
    assert rejected > 0
    method.tried = []
    both = driven(stepper, [T, T])
    assert len(method.tried) - len(both) == rejected
    assert len(both) < 2 * len(first)


def test_a_step_can_be_taken_again_from_its_memory() -> None:
    """The stepper itself remembers nothing: the same memory gives the same step, whatever came between."""
    stepper = Controlled(Extrapolated(LAWSON, FIFTH), lambda f: 1e-9)
    steps = driven(stepper, [T])
    driven(stepper, [0.3, 0.1])
    again = stepper.step(steps[2].state, steps[2].memory, 0.0, T)
    assert isinstance(again, Step)
    assert np.array_equal(again.state, steps[3].state)
    assert (again.elapsed, again.length, again.error) == (steps[3].elapsed, steps[3].length, steps[3].error)


def test_fixed_steps_are_equal() -> None:
    method = Spy(LAWSON, FIFTH)
    steps = steps_of(Fixed(method, 0.3), T)
    assert [step.elapsed for step in steps] == pytest.approx([T / 4, T / 2, 3 * T / 4, T], rel=1e-15)
    assert steps[-1].elapsed == T
    assert np.array_equal(steps[-1].state, repeated(Extrapolated(LAWSON, FIFTH), Y0, T, 4))
    assert [h for h, _ in method.tried] == [T / 4] * 4
    assert [step.error for step in steps] == [error for _, error in method.tried]
    assert len(steps_of(Fixed(method, T / 7), T)) == 7
    assert len(driven(Fixed(method, 0.3), [T, 0.4])) == 6


def test_only_accepted_steps_count() -> None:
    method, tolerance = Spy(STRANG, EIGHTH), 1e-8
    steps = steps_of(Controlled(method, lambda f: tolerance), T)
    accepted = [error for h, error in method.tried if error <= tolerance * h]
    assert [step.error for step in steps] == accepted
    assert len(method.tried) > len(steps)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1e308], ids=str)
def test_controlled_recovers_from_steps_that_blow_up(bad: float) -> None:
    """Whatever a step that is too long returns, shorter ones take its place."""

    def over(y: Array, interval: float, steps: int, integral: Integral | None) -> Array:
        return STRANG.over(y, interval, steps, integral) if interval / steps < 0.1 else np.full_like(y, bad / steps)

    method = Spy(BaseMethod(over, 2, 2), EIGHTH)
    with np.errstate(all="ignore"):
        steps = steps_of(Controlled(method, lambda f: 1e-6), T)
    assert len(method.tried) > len(steps)
    assert np.diff([step.elapsed for step in steps], prepend=0.0).max() < 0.1
    assert np.abs(steps[-1].state - solution(T)).max() < 1e-6 * T


def test_a_step_that_never_succeeds_is_an_error() -> None:
    nothing = BaseMethod(lambda y, interval, steps, integral: y * math.nan, 2, 2)
    with pytest.raises(StepTooSmall, match="no step down to"):
        steps_of(Controlled(Extrapolated(nothing, EIGHTH), lambda f: 1e-6), T)


def test_errors_that_no_shorter_step_mends_stall() -> None:
    """An error that falls just as the step does is not the method's: whoever drives decides, and both ways lead on."""

    def over(y: Array, interval: float, steps: int, integral: Integral | None) -> Array:
        return STRANG.over(y, interval, steps, integral) + 1e-4 * interval / steps  # as if from a grid

    stepper = Controlled(Extrapolated(BaseMethod(over, 2, 2), EIGHTH), lambda f: 1e-9)
    found = stepper.step(Y0, stepper.begin(Y0, 0.0), 0.0, T)
    assert isinstance(found, Stalled)
    assert "the grid limits the accuracy" in str(found)
    taken = stepper.step(Y0, found.accepting, 0.0, T)
    assert isinstance(taken, Step)
    assert taken.length <= found.length
    with pytest.raises(StepTooSmall):
        stepper.step(Y0, found.insisting, 0.0, T)
    with pytest.warns(UserWarning, match="no longer help"):
        steps_of(stepper, T)


class Counting:
    """An exact step that notes its intervals, and loses its accuracy in those longer than `limit`; a lifted state is 3y."""

    def __init__(self, limit: float = math.inf) -> None:
        self.limit = limit
        self.intervals: list[float] = []

    def lift(self, y: Array) -> Array:
        return 3 * y

    def propagate(self, lifted: Array, h: float) -> Array:
        self.intervals.append(h)
        if h > self.limit:
            raise LostAccuracy("too long")
        middle = LAMBDA / (2 * C)
        return 3 * (middle + riccati(lifted / 3 - middle, BETA + LAMBDA**2 / (4 * C), h))

    def lower(self, lifted: Array, blur: float = 0.0) -> Array:
        return lifted / 3


def test_links_of_exact_steps_are_evenly_spaced() -> None:
    step = Counting()
    steps = steps_of(ExactSteps(step, spacing=T / 4), T)
    assert [step.elapsed for step in steps] == pytest.approx([T / 4, T / 2, 3 * T / 4, T], rel=1e-14)
    assert step.intervals == pytest.approx([T / 4] * 4, rel=1e-12)
    assert len(set(step.intervals)) == 1
    assert steps[-1].state == pytest.approx(solution(T), rel=1e-12)
    assert [step.side for step in steps] == [False] * 4
    assert len(steps_of(ExactSteps(Counting(), spacing=T / 7), T)) == 7
    assert len(steps_of(ExactSteps(Counting()), T)) == 1


def test_links_do_not_depend_on_the_intervals() -> None:
    """Whatever times are asked for, the chain is built of the same steps; each time costs one more, unless a link is there."""
    alone = Counting()
    steps_of(ExactSteps(alone, spacing=T / 4, shortest=0.1), T)
    intervals = [0.04] * 5 + [T / 2 - 0.2, 0.3, T / 2 - 0.3]
    step = Counting()
    steps = driven(ExactSteps(step, spacing=T / 4, shortest=0.1), intervals)
    assert step.intervals.count(alone.intervals[0]) >= 4
    assert [taken.side for taken in steps].count(False) == 4
    assert len(step.intervals) == 4 + 5 + 1  # T/2 and T are links
    assert steps[-1].state == pytest.approx(solution(T), rel=1e-12)


@pytest.mark.parametrize("early", [None, solution])
def test_exact_steps_do_not_build_on_steps_that_are_too_short(early: Callable[[float], Array] | None) -> None:
    """Over intervals of 0.2 and at least 0.5 to a step: states between are made from the chain's last link but one."""
    step = Counting()
    steps = driven(ExactSteps(step, spacing=0.2, shortest=0.5, early=early), [0.2] * 7)
    for n, taken in enumerate(steps, 1):
        assert taken.state == pytest.approx(solution(0.2 * n), rel=1e-12)
    later = [0.6, 0.8, 1.0, 0.6, 0.8]
    assert step.intervals == pytest.approx(later if early else [0.2, 0.4, *later], rel=1e-12)


def test_exact_steps_know_f_at_any_time_within() -> None:
    steps = driven(ExactSteps(Counting(), spacing=0.3, shortest=0.4), [T, 0.4])
    starts = [0.0] * 4 + [T] * 2
    stretches = [(0, 0.3), (0.3, 0.6), (0.6, 0.9), (0.9, 1.2), (0.9, 1.2), (1.2, 1.5)]
    for step, start, stretch in zip(steps, starts, stretches, strict=True):
        assert step.within is not None
        assert step.stretch == pytest.approx(np.array(stretch) - start, abs=1e-14)
        low, high = step.stretch
        assert low < step.elapsed < high + 1e-12
        for elapsed in (low + 0.1 * (high - low), step.elapsed, high):
            assert step.within(elapsed) == pytest.approx(solution(start + elapsed), rel=1e-12)


def test_the_fallback_takes_over_with_one_warning() -> None:
    method = Spy(STRANG, EIGHTH)
    stepper = ExactSteps(Counting(limit=0.25), spacing=T / 4, fallback=Controlled(method, lambda f: 1e-9))
    with pytest.warns(UserWarning, match="too long: the quadrature path takes over") as caught:
        steps = steps_of(stepper, T)
    assert len(caught) == 1
    assert [step.elapsed for step in steps] == pytest.approx([T / 4, T / 2, 3 * T / 4, T], rel=1e-14)
    assert len(method.tried) >= 4
    assert np.abs(steps[-1].state - solution(T)).max() < 1e-9 * T


def test_without_a_fallback_lost_accuracy_is_an_error() -> None:
    with pytest.raises(LostAccuracy, match="too long"):
        steps_of(ExactSteps(Counting(limit=0.25), spacing=0.3), T)


@pytest.mark.usefixtures("one_thread")
def test_mass_over_a_thousand_extrapolated_steps_of_operator_6(make_scene: MakeScene) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.2})
    grid = PhaseSpaceGrid(9, 64, scene.pipe.length, -6.0, 7.0)
    rho = density(scene, grid.x)
    f = maxwellian(rho, np.full_like(rho, 0.9), np.full_like(rho, 0.6), grid.v)
    linear = LinearStep(grid, scene.model, OrnsteinUhlenbeckKernel(grid, scene.model))
    method = Extrapolated(strang(FollowLeader(grid.v, scene.cross_section), linear), EIGHTH)
    later = repeated(method, f, 200.0, 1000)
    assert np.abs(later - f).max() > 0.1 * f.max()
    assert abs(later.sum() / f.sum() - 1) < 5e-13


@pytest.mark.usefixtures("one_thread")
def test_mass_over_a_thousand_extrapolated_steps_of_operator_12(make_scene: MakeScene) -> None:
    base, f = inelastic(make_scene, nx=9, nv=32)
    later = repeated(Extrapolated(base, FIFTH), f, 50.0, 1000)
    assert np.abs(later - f).max() > 0.1 * f.max()
    assert abs(later.sum() / f.sum() - 1) < 5e-13
