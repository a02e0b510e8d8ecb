"""The literal picture: every overtaking is detected, and with probability P = S w it is a collision, of operator (6) or (12).

w = ρ̄L/N is the number of real particles that each simulated one stands for. Without memory of earlier encounters a pair overtakes
at the rate |v - v'| times the density of simulated particles, ρ/w: times P, the rate of (6) and (12).

A step is Strang's splitting of two exact parts: the Ornstein-Uhlenbeck process of v alone, and flight in straight lines in which
overtakings are processed one by one in the order of time. Order 2 in the step h, which has nothing to do with the spacing of
particles. (A scan for changes of order after a long step is no substitute: it makes pairs collide that no longer approach.)

**What P ≪ 1 is needed for.** After a collision of (6), or of (12) with ε = 0, a pair is at Δx = Δv = 0. Noise then makes Δv a
Brownian motion and Δx its integral, a randomly accelerated particle. It returns to Δx = 0 infinitely often, √3/(2π) times on
average in each e-fold of time (H. P. McKean 1963), and each return acts with probability P again. The pair reaches the age t
without that with probability (1 - 0.53 P)(t/h)^-θ, θ = 1/4 - (3/2π) arcsin((1 - P)/2) (G. De Smedt, C. Godrèche and J. M. Luck
2001; the factor is measured): √3/(2π) P for small P, 1/4 for P = 1. So these collisions have no limit h → 0 at fixed P, but a
plateau where `sticking` is small. (12) with ε > 0 multiplies Δv instead; at P = 1 it has the limit for ε > exp(-π/√3) = 0.163
(S. J. Cornell, M. R. Swift and A. J. Bray 1998).

Tests: tests/cross_validation/particles/test_single_file.py.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError, SolverStopped
from kinetic_solver.laws import PairLaw
from kinetic_solver.scene import Model
from particles.langevin import LangevinStep
from particles.random import BLOCK, LANGEVIN, OVERTAKINGS, normals, scratch, unit, words
from particles.specialised import specialised


def memory(count: int) -> int:
    """Bytes."""
    return 48 * count


_DONE, _NOT_FINITE, _TOO_MANY = 0, 1, 2


def sticking(probability: float, gamma_h: float) -> float:
    """The share 1 - (γh)^θ of pairs at Δx = Δv = 0 that collide again before the age 1/γ. Test: test_the_exponent_of_sticking."""
    theta = 0.25 - 1.5 / math.pi * math.asin((1 - probability) / 2)
    return 1 - min(gamma_h, 1.0) ** theta


class SingleFile:
    """n particles of a ring in the order of their places: x, v (n,), slot by slot.

    x ascends over at most one length from x[0] in [0, length), so the whole state, ties included, is (x, v) and the number of
    the step. A slot is no particle: where particles swap, x and v do. Serial; the interpreter's lock is released meanwhile.
    """

    def __init__(self, x: Array, v: Array, length: float, probability: float, law: PairLaw) -> None:
        """x in [0, length) in any order, or ascending as left by `advance`."""
        if not probability <= 1:
            raise SceneError(
                f"particles.count: with {x.size} particles the probability S_C w of a collision at an overtaking is "
                f"{probability:.4g}; allowed: up to 1; raise particles.count to {math.ceil(x.size * probability)} or more"
            )
        self.length, self.probability, self.law = length, probability, law
        order = np.argsort(x, kind="stable")
        self.x, self.v = np.array(x, dtype=float)[order], np.array(v, dtype=float)[order]
        self._first = np.empty(2 << (x.size - 1).bit_length())

    @property
    def count(self) -> int:
        return int(self.x.size)

    def places(self) -> Array:
        """x in [0, length), slot by slot."""
        x = np.where(self.x >= self.length, self.x - self.length, self.x)
        x[x >= self.length] = 0.0
        return x

    def advance(
        self, model: Model, interval: float, steps: int, number: int, key: NDArray[np.uint64], part: range | None = None
    ) -> tuple[int, int]:
        """`steps` steps over the time `interval`, with random numbers `number` to `number + steps`: overtakings and collisions.
        Or only a part of these steps, after which the next part has the same bits as all at once.

        Overtakings are all meetings of two particles, collisions included. (12) conserves momentum to round-off.
        SolverStopped where x or v is not finite, and where overtakings of one flight exceed 1000 n + 100 n²wh/L, w the range of
        velocities (a homogeneous gas has less than n²wh/2L): inelastic collapse, or a cluster of all particles.
        """
        h = interval / steps
        half, whole = (_of_velocity(model, t) for t in (h / 2, h))
        kind: Any = type(self.law)
        keeps = "momentum" in self.law.conserves
        overtakings, collisions, ended = _kernel(kind)(
            *(self.x, self.v, self._first, self.length, self.probability, self.law.numbers, keeps),
            *(h, steps, half, whole, number, key[0], key[1], 100.0),
            *((0, steps) if part is None else (part.start, part.stop)),
        )
        if ended == _NOT_FINITE:
            raise SolverStopped("single-file particles: a place or velocity is not a finite number; lower particles.time_step")
        if ended == _TOO_MANY:
            raise SolverStopped(
                f"single-file particles: 100 times the overtakings of a homogeneous gas in one step of {h:.4g}, as in inelastic "
                f"collapse; P = S_C w is {self.probability:.4g}: raise particles.count, or lower particles.time_step"
            )
        return overtakings, collisions


def _of_velocity(model: Model, h: float) -> tuple[float, float, float]:
    """(a, b, c) of v' = a v + b + c n over the time h."""
    step = LangevinStep.over(model, h)
    return step.v_velocity, step.v_constant, step.v_noise


@functools.cache
def _kernel(law: Any) -> Callable[..., tuple[int, int, int]]:
    """The loop over steps for a class of laws."""
    flight = specialised(_fly, law, {}, after=numba.njit(law.after))
    return specialised(_advance, law, {"nogil": True}, _fly=flight)


after: Any = None
"""Of the law (laws/law.py): bound by `specialised`."""


def _advance(  # type: ignore[no-untyped-def]
    x, v, first, length, probability, numbers, keeps, h, steps, half, whole, number, k0, k1, generous, done, end
):
    overtakings = collisions = 0
    if done == 0:
        _kick(v, half, np.uint64(number), k0, k1)
    for n in range(done + 1, end + 1):
        step = np.uint64(number + n)
        most = _most(x, v, length, h, generous)
        if most < 0.0:
            return overtakings, collisions, _NOT_FINITE
        met, collided = _fly(x, v, first, length, h, probability, numbers, keeps, step, k0, k1, most)
        if met < 0:
            return overtakings, collisions, _TOO_MANY
        _settle(x, v, length, h)
        overtakings += met
        collisions += collided
        _kick(v, whole if n < steps else half, step, k0, k1)
    return overtakings, collisions, _DONE


@numba.njit(cache=True)
def _kick(v, coefficients, step, k0, k1):  # type: ignore[no-untyped-def]
    """The Ornstein-Uhlenbeck process, in place. Slot s takes the first deviate of counter s, whoever is in it."""
    v_velocity, v_constant, v_noise = coefficients
    bits, deviates = scratch()
    for begin in range(0, v.size, BLOCK):
        normals(deviates, bits, LANGEVIN, begin, step, k0, k1)
        for s in range(begin, min(begin + BLOCK, v.size)):
            v[s] = v_velocity * v[s] + v_constant + v_noise * deviates[0, s - begin]


@numba.njit(cache=True)
def _most(x, v, length, h, generous):  # type: ignore[no-untyped-def]
    """A bound on the overtakings of a flight, no physics; -1 where anything is not finite."""
    low = high = v[0]
    for s in range(v.size):
        if not abs(x[s]) + abs(v[s]) < np.inf:
            return -1.0
        low, high = min(low, v[s]), max(high, v[s])
    return generous * v.size * (10.0 + v.size * (high - low) * h / length)


def _fly(x, v, first, length, h, probability, numbers, keeps, step, k0, k1, most):  # type: ignore[no-untyped-def]
    """All overtakings within h. x + v t is the place at time t after the flight's start: x changes with v; h is not flown yet.

    `first` (twice n or the next power of two) is a binary tree: its leaves say when each slot meets the next, a node i is the
    earlier of 2i and 2i + 1. Of equal times that of the lowest slot comes first.
    Collisions that keep momentum give whole grains of velocity to the one ahead, rounded up. So momentum is exact, the one
    behind is not the faster afterwards, and Σ s v of a chain of slots s grows: in inelastic collapse there is no endless round
    of meetings at one time. Returns overtakings (-1: more than `most`) and collisions.
    """
    n, leaves = x.size, first.size // 2
    grain = _rounded(v) if keeps else 0.0
    for s in range(leaves):
        first[leaves + s] = _meeting(x, v, s, 0.0, length, h) if s < n else np.inf
    _climb(first, 0, leaves - 1)
    overtakings = collisions = 0
    while first[1] < np.inf:
        if overtakings >= most:
            return -1, collisions
        now, a = first[1], 1
        while a < leaves:
            a = 2 * a + (first[2 * a] > now)
        a -= leaves
        b, shift = (a + 1, 0.0) if a + 1 < n else (0, length)
        chance, _, _, _ = words(OVERTAKINGS, overtakings, step, 0, k0, k1)
        overtakings += 1
        if unit(chance) < probability:
            collisions += 1
            behind, ahead = after(v[a] - v[b], *numbers)
            if ahead == 0.0:
                # The leader's own trajectory, so that the two never meet again in this flight
                x[a], v[a] = x[b] + shift, v[b]
            else:
                meeting = x[a] + v[a] * now
                if keeps:
                    given = grain * math.ceil(ahead / grain)
                    v[a], v[b] = v[a] - given, v[b] + given
                else:
                    v[a], v[b] = v[b] + behind, v[b] + ahead
                x[a], x[b] = meeting - v[a] * now, meeting - v[b] * now - shift
        else:
            x[a], x[b] = x[b] + shift, x[a] - shift
            v[a], v[b] = v[b], v[a]
        before = a - 1 if a > 0 else n - 1
        for s in (before, a, b):
            first[leaves + s] = _meeting(x, v, s, now, length, h)
        if before < a < b:
            _climb(first, before, b)
        else:
            for s in (before, a, b):
                _climb(first, s, s)
    return overtakings, collisions


@numba.njit(cache=True)
def _rounded(v):  # type: ignore[no-untyped-def]
    """All v to multiples of the grain that is returned, at most 2^-51 of the largest: sums and differences are then exact."""
    largest = 0.0
    for s in range(v.size):
        largest = max(largest, abs(v[s]))
    grain = math.ldexp(1.0, math.frexp(largest)[1] - 52)
    for s in range(v.size):
        v[s] = grain * np.rint(v[s] / grain)
    return grain


@numba.njit(inline="always")
def _meeting(x, v, s, now, length, h):  # type: ignore[no-untyped-def]
    """When slot s meets the next, within the flight; at once where rounding has put it ahead already; inf if not at all."""
    ahead, shift = (s + 1, 0.0) if s + 1 < x.size else (0, length)
    if v[s] > v[ahead]:
        time = max(now, (x[ahead] + shift - x[s]) / (v[s] - v[ahead]))
        if time < h:
            return time
    return np.inf


@numba.njit(cache=True)
def _climb(first, low, high):  # type: ignore[no-untyped-def]
    """The tree above slots low to high."""
    low, high = low + first.size // 2, high + first.size // 2
    while low > 1:
        low, high = low // 2, high // 2
        for i in range(low, high + 1):
            first[i] = min(first[2 * i], first[2 * i + 1])


@numba.njit(cache=True)
def _settle(x, v, length, h):  # type: ignore[no-untyped-def]
    """The flight over h, and x[0] back in [0, length). What rounding put behind its follower is put beside it."""
    first = x[0] + v[0] * h
    back = length * math.floor(first / length)
    if first - back >= length:
        back += length
    for s in range(x.size):
        x[s] = max(x[s] + v[s] * h - back, x[s - 1] if s > 0 else 0.0)
