"""Where two datasets are compared, and what a field is there: values at points, and how each replica's differ from them."""

from __future__ import annotations

import dataclasses

import numpy as np

from kinetic_solver.arrays import Array

OVER_X = ("density", "mean_velocity", "temperature")
"""Fields over x that are compared."""
TOTALS = ("velocity_of_all", "variance_of_all")
"""Mean and variance of the velocities of all particles together, which are compared as fields of one point."""


@dataclasses.dataclass(frozen=True)
class Points:
    """The points that both sides are brought to."""

    nx: int
    v: Array
    """Velocities (n,)."""
    length: float
    """The period."""

    @property
    def x(self) -> Array:
        return self.length * np.arange(self.nx) / self.nx


@dataclasses.dataclass(frozen=True)
class Values:
    """A field at one time: its points (n,), and each replica's share (replica, n), of which they are the mean."""

    points: Array
    replicas: Array | None = None
    inflation: float = 1.0
    """Factor on the variance that the scatter of the replicas gives: for parts of a single ensemble, S(k)."""
    errors: tuple[Array, int] | None = None
    """Where the replicas' shares are not there: standard errors (n,), and the number of replicas that they come from."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter; 0 where nothing scatters."""
        if self.errors is not None:
            return self.errors[1] - 1
        return 0 if self.replicas is None else len(self.replicas) - 1

    @property
    def variance(self) -> Array:
        """Of the points, (n,)."""
        if self.errors is not None:
            return np.asarray(self.inflation * self.errors[0] ** 2)
        if self.replicas is None:
            return np.zeros(self.points.shape)
        return np.asarray(self.inflation * self.replicas.var(axis=0, ddof=1) / len(self.replicas))

    @property
    def covariance(self) -> Array:
        """Of the points, (n, n)."""
        if self.replicas is None:
            return np.zeros((self.points.size, self.points.size))
        return self.inflation / len(self.replicas) * np.atleast_2d(np.cov(self.replicas, rowvar=False))

    def over(self, matrix: Array) -> Values:
        """Linear statistics (q,) of the points, matrix (q, n)."""
        replicas = None if self.replicas is None else self.replicas @ matrix.T
        return Values(matrix @ self.points, replicas, self.inflation)


def mean_of(values: list[Values]) -> Values:
    """The mean over frames, of which each replica's own mean is its share."""
    points = np.mean([v.points for v in values], axis=0)
    if values[0].replicas is None:
        return Values(points)
    return Values(points, np.mean([v.replicas for v in values if v.replicas is not None], axis=0), values[0].inflation)


def fields_of(moments: Array, stochastic: bool) -> dict[str, Values]:
    """ρ, u, θ from (replica, 3, nx) of ρ, ρu, ρ(θ + u²); the replicas' shares by the delta method, to first order in them."""
    rho, j, e = moments.mean(axis=0)
    positive = np.where(rho > 0, rho, np.nan)
    u = j / positive
    theta = e / positive - u**2
    if not stochastic:
        return {"density": Values(rho), "mean_velocity": Values(u), "temperature": Values(theta)}
    r, jr, er = moments[:, 0], moments[:, 1], moments[:, 2]
    return {
        "density": Values(rho, r),
        "mean_velocity": Values(u, u + (jr - u * r) / positive),
        "temperature": Values(theta, theta + (er - 2 * u * jr + (u**2 - theta) * r) / positive),
    }


def totals_of(shares: Array, stochastic: bool, inflation: float = 1.0) -> dict[str, Values]:
    """`TOTALS` from each replica's mass, momentum and energy, (3, replica); shares by the delta method likewise."""
    mass, momentum, energy = shares.mean(axis=1)
    u = momentum / mass
    variance = 2 * energy / mass - u**2
    mean_of_all, variance_of_all = np.array([u]), np.array([variance])
    if not stochastic:
        return {"velocity_of_all": Values(mean_of_all), "variance_of_all": Values(variance_of_all)}
    own = shares[:, :, None]
    velocity = u + (own[1] - u * own[0]) / mass
    spread = variance + (2 * own[2] - 2 * u * own[1] + (u**2 - variance) * own[0]) / mass
    return {
        "velocity_of_all": Values(mean_of_all, velocity, inflation),
        "variance_of_all": Values(variance_of_all, spread, inflation),
    }
