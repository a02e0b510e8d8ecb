"""(2) with operator (12) for an f that does not depend on x, in velocities that follow its mean u and its width s.

With v = u + sw and f(v, t) = F(w, t)/s,

    ∂F/∂t = (γ + s'/s) ∂(wF)/∂w + (γσ/s²) ∂²F/∂w² + S s C[F],    s'/s = half of θ'/θ,

so that F keeps its width however far the gas cools or is heated: as many points serve at any temperature. u moves as friction and
gravity have it, since collisions keep momentum. It is a system of ordinary differential equations for the waves of F,
F = Σ c_l exp(iξ_l w) with C as in theory/collisions_in_waves.py, for ln s, and for two integrals over time that the budgets ask
for. It converges geometrically. The wave of length 0, the mass, does not change at all.
Tests: tests/exact/test_homogeneous_flow.py.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.interpolation import through_waves
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Model
from kinetic_solver.theory.collisions_in_waves import CollisionsInWaves

KEPT = 4
"""Tables of collisions, for the next frame or run; up to some megabytes each."""
Waves: TypeAlias = NDArray[np.complex128] | Array
"""Complex, or, of an even F, real."""
REFUSED = 1e100
"""A rate at which no step ends."""
INTEGRALS = 2
"""γ∫θ dt and ∫c dt, c the energy that collisions bring per mass and time, both in units of a width squared."""


@dataclass(frozen=True)
class Shape:
    """f(v) = mass F((v - mean)/width)/width on a period 2·half of w, ∫F = 1; 0 beyond. F is real: waves -l are the conjugates of
    l."""

    waves: Array
    """Re c_l for l = 0 …, and then, unless F is even, Im c_l for l = 2 …: that of l = 1 follows, since the mean of F is 0."""
    even: bool
    mass: float
    """Of f, per length."""
    mean: float
    width: float
    half: float

    @classmethod
    def of(cls, values: Array, mass: float, mean: float, width: float, half: float, even: bool) -> Shape:
        """From F at `points(half, count)`, count odd."""
        count = values.size
        turns = np.exp(2j * np.pi / count * (count // 2) * np.arange(count // 2 + 1))
        return cls(packed(np.fft.rfft(values) / count * turns, even), even, mass, mean, width, half)

    @property
    def c(self) -> NDArray[np.complex128]:
        """c_l, l = 0 … ."""
        return unpacked(self.waves, self.even)

    @property
    def count(self) -> int:
        """Points that hold these waves: odd."""
        return 2 * self.c.size - 1

    def at(self, v: Array) -> Array:
        """f on uniform points v, which hold all of it: the sum over them is its mass, as that of a start is."""
        return self._at((v - self.mean) / self.width) * (self.mass / self.width)

    def on(self, half: float, count: int) -> Shape:
        """The same F on another period, with the waves of an odd number of points."""
        if half == self.half:
            c, kept = np.zeros(count // 2 + 1, dtype=complex), min(count // 2 + 1, self.c.size)
            c[:kept] = self.c[:kept]
            return replace(self, waves=packed(c, self.even))
        return Shape.of(self._at(points(half, count)), self.mass, self.mean, self.width, half, self.even)

    def _at(self, w: Array) -> Array:
        """F on other uniform points, by the trigonometric interpolant."""
        inside = np.abs(w) < self.half
        values = np.zeros(w.size)
        values[inside] = through_waves(points(self.half, self.count), w[inside], 2 * self.half) @ self.values
        return values / (values.sum() * (w[1] - w[0]))

    @property
    def values(self) -> Array:
        """F at its own points."""
        count = self.count
        turns = np.exp(-2j * np.pi / count * (count // 2) * np.arange(count // 2 + 1))
        return np.asarray(np.fft.irfft(self.c * turns, count)) * count

    def distance(self, other: Shape) -> float:
        """The largest difference in F, over the largest F, or that in the width of f; both on the same points."""
        width = math.sqrt(self.variance / other.variance) * self.width / other.width
        return max(float(np.abs(self.values - other.values).max() / np.abs(self.values).max()), abs(width - 1))

    @property
    def variance(self) -> float:
        """Of F over w."""
        values = self.values
        return float(points(self.half, self.count) ** 2 @ values / values.sum())

    def needed(self, least: float) -> int:
        """Points, an odd number, that hold its waves down to this amplitude over the largest F."""
        above = np.flatnonzero(np.abs(self.c) > least * np.abs(self.values).max())
        return 2 * int(above[-1]) + 1


def points(half: float, count: int) -> Array:
    """An odd number of points of [-half, half), 0 the middle one."""
    return 2 * half / count * (np.arange(count) - count // 2)


def packed(c: NDArray[np.complex128], even: bool) -> Array:
    return np.ascontiguousarray(c.real) if even else np.concatenate([c.real, c.imag[2:]])


def unpacked(waves: Array, even: bool) -> NDArray[np.complex128]:
    """c_l; waves of shape (unknowns,)."""
    if even:
        return waves.astype(complex)
    longest = waves.size // 2 + 1
    c = waves[:longest].astype(complex)
    c[2:] += 1j * waves[longest:]
    c[1] += 1j * (of_the_first(longest) @ waves[longest:])
    return c


def of_the_first(longest: int) -> Array:
    """Im c_1 = Σ of these times Im c_l, l = 2 …, where Σ w F = 0 on the points: momentum is what it is by construction."""
    share = np.pi / (2 * longest - 1)
    waves = np.arange(2, longest)
    return np.asarray((-1.0) ** waves * math.sin(share) / np.sin(share * waves))


@functools.lru_cache(maxsize=KEPT)
def collisions_in_waves(restitution: float, half: float, count: int) -> CollisionsInWaves:
    """Read only: runs of one process share it."""
    return CollisionsInWaves(restitution, half, count)


class HomogeneousFlow:
    """y' = rate(t, y) of y = (waves of a Shape, ln of its width over a given one, γ∫θ dt, ∫c dt). All are numbers without a unit,
    so that the bits of a run do not depend on units."""

    width: float
    """That one, set before each use: that of a shape."""

    def __init__(self, model: Model, law: Inelastic, shape: Shape) -> None:
        self.friction, self.noise, self.cross_section = model.friction, model.noise, law.cross_section * shape.mass
        self.even, self.half, self.count = shape.even, shape.half, shape.count
        self.unknowns = shape.waves.size
        middle = self.count // 2
        collisions = collisions_in_waves(law.restitution, self.half, self.count)
        self._quadratic, self._pairs = collisions.quadratic[middle:], collisions.pairs[middle:]
        self._xi = collisions.xi[middle:]
        squares = (collisions.w**2 @ collisions.to_points).real / self.count
        # ∫w²F dw over the period: each wave stands for itself and its conjugate.
        self._squares = np.append(squares[middle], 2 * squares[middle + 1 :])
        # ∂(wF)/∂w: multiplication by w convolves waves.
        saw = collisions.to_waves @ collisions.w
        apart = collisions.index[middle:, None] - collisions.index
        self._drift = 1j * self._xi[:, None] * saw[(apart + middle) % self.count]
        if self.even:
            self._drift = np.ascontiguousarray(self._drift.real)  # the waves of an even F are real

    def rate(self, time: float, y: Array) -> Array:
        """y'. Where F has no width, as it may in a try of the integrator, a rate that makes it take a shorter step."""
        c, width = self._of(y)
        both = self._both(c)
        change = self.cross_section * width * ((self._quadratic * both[self._pairs]) @ both)
        theta, power = self._moments(c, change)
        if not 0 < theta < np.inf:
            return np.full(self.unknowns + 1 + INTEGRALS, REFUSED)  # its norms would not see a NaN
        drag = self.friction * self.noise / width**2
        narrowing = power / theta - self.friction + drag / theta
        rate = np.empty(self.unknowns + 1 + INTEGRALS)
        moved = (self.friction + narrowing) * (self._drift @ both) - drag * self._xi**2 * c + change
        rate[: self.unknowns] = packed(moved, self.even)
        square = (width / self.width) ** 2
        rate[self.unknowns :] = narrowing, self.friction * square * theta, square * power
        return rate

    def jacobian(self, time: float, y: Array) -> Array:
        """∂y'/∂y."""
        n = self.unknowns
        c, width = self._of(y)
        both = self._both(c)
        products = self.cross_section * width * (self._quadratic * both[self._pairs])
        change, linear = products @ both, 2 * products
        theta, power = self._moments(c, change)
        mass = float(c[0].real)
        squares = packed(self._squares.astype(complex), self.even)
        first = np.zeros(n)
        first[0] = 1.0
        by_theta = (squares - theta * first) / mass
        collisions = self._columns(linear)
        by_power = self._squares @ collisions[: self._squares.size] / (2 * mass) - power / mass * first
        drag = self.friction * self.noise / width**2
        narrowing = power / theta - self.friction + drag / theta
        by_narrowing = by_power / theta - (power + drag) / theta**2 * by_theta
        # What collisions do grows as the width, and what noise does falls as its square.
        by_width = power / theta - 2 * drag / theta
        drift, damped = packed(self._drift @ both, self.even), -drag * self._xi**2
        result = np.zeros((n + 1 + INTEGRALS, n + 1 + INTEGRALS))
        result[:n, :n] = collisions + (self.friction + narrowing) * self._columns(self._drift) + np.outer(drift, by_narrowing)
        diagonal = np.arange(n)
        if self.even:
            result[diagonal, diagonal] += damped
        else:
            result[diagonal, diagonal] += np.append(damped, damped[2:])
        result[:n, n] = by_width * drift + packed(change - 2 * damped * c, self.even)
        result[n, :n], result[n, n] = by_narrowing, by_width
        square = (width / self.width) ** 2
        result[n + 1, :n], result[n + 1, n] = self.friction * square * by_theta, 2 * self.friction * square * theta
        result[n + 2, :n], result[n + 2, n] = square * by_power, 3 * square * power
        return result

    def _of(self, y: Array) -> tuple[NDArray[np.complex128], np.float64]:
        return unpacked(y[: self.unknowns], self.even), self.width * np.exp(y[self.unknowns])

    def _both(self, c: NDArray[np.complex128]) -> Waves:
        """c_l of l = -longest … longest; real where F is even."""
        return np.concatenate([c.real[:0:-1], c.real]) if self.even else np.concatenate([c[:0:-1].conj(), c])

    def _moments(self, c: NDArray[np.complex128], change: Waves) -> tuple[np.float64, np.float64]:
        """(∫w²F, half of ∫w²(its change by collisions)), over the mass."""
        mass = c[0].real
        return self._squares @ c.real / mass, self._squares @ change.real / (2 * mass)

    def _columns(self, linear: Waves) -> Array:
        """From waves -l … l to waves n ≥ 0, as a matrix between packed waves."""
        middle = self.count // 2
        positive, negative = linear[:, middle:].copy(), linear[:, middle::-1].copy()
        negative[:, 0] = 0.0
        by_real = positive + negative
        if self.even:
            return by_real.real
        by_imaginary = 1j * (positive - negative)
        by_others = by_imaginary[:, 2:] + np.outer(by_imaginary[:, 1], of_the_first(middle + 1))
        return np.block([[by_real.real, by_others.real], [by_real.imag[2:], by_others.imag[2:]]])


class ShapedCollisions:
    """C[f] of (12) on the points of a grid without places, by way of F: what `HomogeneousFlow` does to f at an instant."""

    conserves = ("mass", "momentum")

    def __init__(self, grid: PhaseSpaceGrid, law: Inelastic, half: float, count: int) -> None:
        self.grid, self.cross_section = grid, law.cross_section
        self._waves = collisions_in_waves(law.restitution, half, count)

    def rate(self, f: Array) -> Array:
        """f (1, nv)."""
        (row,), grid = f, self.grid
        mass = float(row.sum())
        mean = float(row @ grid.v) / mass
        width = math.sqrt(float(row @ (grid.v - mean) ** 2) / mass)
        v = mean + width * self._waves.w
        inside = (v > grid.low) & (v < grid.high)
        values = np.zeros(self._waves.count)
        values[inside] = width * (through_waves(grid.v, v[inside], grid.high - grid.low) @ row)
        change = self.cross_section * self._waves.rate(values)  # of F; that of f is as many times 1/width, and w runs as v/width
        back = (grid.v - mean) / width
        inside = np.abs(back) < self._waves.half
        rate = np.zeros(grid.nv)
        rate[inside] = through_waves(self._waves.w, back[inside], 2 * self._waves.half) @ change
        return rate[None]
