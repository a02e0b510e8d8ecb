"""One field at one time: how far two sides are apart, what bounds and chance allow, and the p of that."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.linalg import LinAlgError

from kinetic_solver.arrays import Array
from kinetic_solver.compare.sides import Side
from kinetic_solver.compare.statistics import beyond, chi_squared, largest_of
from kinetic_solver.compare.values import Values

MOST_STATISTICS = 16
"""Statistics in one χ². There are never more than half as many as replicas, from which their covariance is estimated."""
LEAST_COUNT = 50
"""Particles that a replica must have at a velocity: of fewer, means over replicas are not Gaussian enough to be tested."""
MEAN = math.inf
"""The time of a row that is about the mean over all frames after the first."""
W = "velocity_distribution"
"""The variable w(v), (time, v)."""
WAVE = 4 / math.pi
"""Largest Fourier amplitude of a function within ±1: that of a square wave."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One field at one time."""

    field: str
    time: float
    points: Array
    """x (n,), v (n,), both (n, 2), or nothing of use (1,)."""
    first: Array
    second: Array
    error: Array
    """Standard error of the difference; 0 without chance, NaN where there are too few particles for one."""
    bound: float
    """On the systematic part of the difference."""
    scale: float
    """What relative numbers are relative to."""
    z: Array
    """(first - second), less what the bound grants, in standard errors; NaN where there is none."""
    mode_z: Array
    """Likewise the amplitudes 1, cos, sin, cos 2, … of a field over x; empty otherwise."""
    chi_squared: float
    """NaN without chance."""
    statistics: int
    """In χ²."""
    p: float
    """Probability of so large a difference by chance, at most; without chance 1 within the bound and 0 beyond."""

    @property
    def difference(self) -> Array:
        return self.first - self.second

    @property
    def worst(self) -> int:
        """Where z is largest, or without chance the difference."""
        z = np.nan_to_num(np.abs(self.z))
        return int(np.argmax(z if z.any() else np.abs(self.difference)))


@dataclasses.dataclass(frozen=True)
class Both:
    """What is known of two sides together, at one time or over all."""

    a: Side
    b: Side
    hottest: float
    """Largest θ of either, over the pipe."""
    coldest: float
    folded: float = 0.0
    """What waves that a grid does not hold may do to the fields over x, relative to their scale."""

    @property
    def length(self) -> float:
        """The period."""
        return next(side.ruling.pipe.length for side in (self.a, self.b) if side.ruling)

    @property
    def scatter(self) -> bool:
        return self.a.stochastic or self.b.stochastic

    @property
    def bound(self) -> float:
        return self.a.bound + self.b.bound

    @property
    def particles(self) -> float:
        """In a replica of either side, whichever has fewer; inf without particles."""
        return min((side.particles_of_a_replica for side in (self.a, self.b) if side.stochastic), default=math.inf)

    def of_counts(self, points: Array, cell: float) -> Array:
        """Least variance of point values made from counts in cells of dx dv: that of Poisson's distribution.

        Replicas may count the same by chance; their scatter then says that there is none.
        """
        mass = sum(
            side.ruling.initial.density * side.ruling.pipe.length / side.number for side in (self.a, self.b) if side.ruling
        )
        return np.asarray(np.maximum(points, 0) * mass / cell)

    def of_bins(self, v: Array) -> float:
        """Relative error of point values of a Gaussian made from bins: (3/640) dv⁴ times its fourth derivative."""
        return 9 / 640 * (float(v[1] - v[0]) ** 2 / self.coldest) ** 2 if self.scatter else 0.0

    def of_number(self, nx: int) -> float:
        """Relative bias of θ of n particles, 1/n, where half as many as on average are in each of nx parts of the pipe."""
        return 2 * nx / min(self.a.number, self.b.number)


def over_x(name: str, time: float, x: Array, left: Values, right: Values, both: Both) -> Row:
    """Of a field over x: its points, and the amplitudes of its waves."""
    scale = float(max(np.abs(left.points).max(), np.abs(right.points).max()))
    if name == "mean_velocity":
        scale = max(scale, math.sqrt(both.hottest))
    relative = both.bound + both.folded + (both.of_number(x.size) if name == "temperature" else 0.0)
    waves, bounds = amplitudes(x.size), np.full(x.size, WAVE * relative * scale)
    bounds[0] = relative * scale
    if name == "density":  # whose mean is the number of particles
        waves, bounds = waves[1:], bounds[1:]
    return _row(name, time, x, left, right, relative * scale, scale, np.ones(x.size, dtype=bool), waves, bounds, waves)


def over_v(time: float, v: Array, left: Values, right: Values, both: Both) -> Row:
    """Of w(v): its points, and the shares of ranges of v that hold about as many particles each."""
    scale, dv = float(max(left.points.max(), right.points.max())), float(v[1] - v[0])
    bound = (both.bound + both.folded + both.of_bins(v)) * scale
    if not (freedom := _freedom(left, right)):
        return _row(W, time, v, left, right, bound, scale, np.ones(v.size, dtype=bool))
    w = np.maximum(right.points if left.freedom else left.points, 0)
    enough = w / w.sum() * both.particles >= LEAST_COUNT
    number = min(MOST_STATISTICS, max(1, freedom // 2))
    group = ((np.cumsum(w) - w / 2) / w.sum() * (number + 1)).astype(int)
    groups = np.array([dv * (group == n) for n in np.unique(group)[:-1]]).reshape(-1, v.size)
    least = both.of_counts(w, dv) if time != MEAN else np.zeros(v.size)
    return _row(W, time, v, left, right, bound, scale, enough, groups, groups.sum(axis=1) * bound, least=least)


def of_all(name: str, time: float, left: Values, right: Values, variance: float, both: Both) -> Row:
    """Of the mean or the variance of all velocities, which is one number."""
    scale = max(abs(float(left.points[0])), math.sqrt(variance)) if name == "velocity_of_all" else variance
    bound = (both.bound + both.folded + (both.of_number(1) if name == "variance_of_all" else 0.0)) * scale
    return _row(name, time, np.zeros(1), left, right, bound, scale, np.ones(1, dtype=bool))


def over_phase_space(time: float, x: Array, v: Array, left: Values, right: Values, both: Both) -> Row | None:
    """Of f at its points; None where no cell holds particles enough."""
    scale = float(max(left.points.max(), right.points.max()))
    f, enough = np.maximum(right.points if left.freedom else left.points, 0), np.ones(left.points.size, dtype=bool)
    if _freedom(left, right):
        enough = f / f.sum() * both.particles >= LEAST_COUNT
        if not enough.any():
            return None
    place = np.stack([np.repeat(x, v.size), np.tile(v, x.size)], axis=1)
    bound = (both.bound + both.folded + both.of_bins(v)) * scale
    least = both.of_counts(f, float(v[1] - v[0]) * both.length / x.size)
    return _row("f", time, place, left, right, bound, scale, enough, least=least)


def _freedom(left: Values, right: Values) -> int:
    """Degrees of freedom of the scatter: of the smaller number of replicas, where both have some; 0 without chance."""
    return min((values.freedom for values in (left, right) if values.freedom), default=0)


def _row(
    name: str,
    time: float,
    points: Array,
    left: Values,
    right: Values,
    bound: float,
    scale: float,
    enough: Array,
    statistics: Array | None = None,
    bounds: Array | None = None,
    modes: Array | None = None,
    least: Array | None = None,
) -> Row:
    difference, freedom = left.points - right.points, _freedom(left, right)
    mode_z: Array = np.empty(0)
    value, count = math.nan, 0
    if not freedom:
        p = 1.0 if np.abs(difference).max() <= bound else 0.0
        none = np.full(difference.size, np.nan)
        return Row(name, time, points, left.points, right.points, 0 * difference, bound, scale, none, mode_z, value, count, p)
    variance = left.variance + right.variance
    error: Array = np.where(enough, np.sqrt(variance if least is None else np.maximum(variance, least)), np.nan)
    z = _z(difference, bound, error)
    found = [largest_of(z[enough], freedom)]
    if modes is not None and bounds is not None and len(modes):
        ours, theirs = left.over(modes), right.over(modes)
        mode_z = _z(ours.points - theirs.points, bounds, np.sqrt(ours.variance + theirs.variance))
        found.append(largest_of(mode_z, freedom))
    if statistics is not None and bounds is not None and len(statistics):
        chosen = min(len(statistics), MOST_STATISTICS, max(1, freedom // 2))
        ours, theirs = left.over(statistics[:chosen]), right.over(statistics[:chosen])
        if (ours.variance + theirs.variance > 0).all():
            try:
                covariance = ours.covariance + theirs.covariance
                value, p = chi_squared(ours.points - theirs.points, covariance, bounds[:chosen], freedom)
                count = chosen
                found.append(p)
            except LinAlgError:  # ranges of v with hardly a particle scatter together; points and amplitudes are tested
                value = math.nan
    p = min(1.0, len(found) * min(found))
    return Row(name, time, points, left.points, right.points, error, bound, scale, z, mode_z, value, count, p)


def _z(difference: Array, bound: Array | float, error: Array) -> Array:
    """0 where nothing scatters and nothing differs."""
    rest = beyond(difference, bound + 1e-12 * np.abs(difference).max())
    z = np.divide(rest, error, out=np.where(rest == 0, 0.0, np.copysign(np.inf, rest)), where=error > 0)
    return np.asarray(np.where(np.isnan(error), np.nan, z))


def amplitudes(nx: int) -> Array:
    """Rows that give the amplitudes of 1, cos, sin, cos 2, sin 2, … of values at nx points (odd)."""
    angle = 2 * np.pi * np.arange(nx) / nx
    rows = [np.full(nx, 1 / nx)]
    for m in range(1, (nx - 1) // 2 + 1):
        rows += [2 / nx * np.cos(m * angle), 2 / nx * np.sin(m * angle)]
    return np.array(rows)
