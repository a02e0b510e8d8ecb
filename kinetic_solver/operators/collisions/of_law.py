"""From a collision law to its operator on the grid: the one place that knows which scheme computes which law."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from kinetic_solver import laws
from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions.follow_leader import FollowLeader
from kinetic_solver.operators.collisions.hermite import FollowLeaderHermite, InelasticHermite
from kinetic_solver.operators.collisions.pairs import PairCollisions
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.velocity.hermite import HermiteBasis


class RateOfLaw:
    """The rate that a law brings itself, on given velocity points."""

    def __init__(self, velocity: Array, law: laws.CollisionLaw) -> None:
        self.velocity, self.law = velocity, law
        self.conserves = law.conserves

    def rate(self, f: Array) -> Array:
        return self.law.rate(f, self.velocity)

    def on(self, nv: int) -> RateOfLaw:
        """The same on nv points in the same window."""
        dv = float(self.velocity[1] - self.velocity[0])
        points = self.velocity[0] - dv / 2 + dv * self.velocity.size / nv * (np.arange(nv) + 0.5)
        return RateOfLaw(points, self.law)


@singledispatch
def on_points(law: laws.CollisionLaw, velocity: Array, deposit: str | None) -> CollisionRate:
    """C[f] of a law on uniform velocity points; `deposit` is for laws of pairs."""
    return RateOfLaw(velocity, law)


@on_points.register
def _(law: laws.PairLaw, velocity: Array, deposit: str | None) -> CollisionRate:
    assert deposit is not None
    return PairCollisions(velocity, law, deposit)


@on_points.register
def _(law: laws.FollowTheLeader, velocity: Array, deposit: str | None) -> CollisionRate:
    return FollowLeader(velocity, law.cross_section)


@singledispatch
def in_hermite(law: laws.CollisionLaw, basis: HermiteBasis) -> FollowLeaderHermite | InelasticHermite | None:
    """C[f] of a law on Hermite coefficients; None where it has no such rate."""
    return None


@in_hermite.register
def _(law: laws.FollowTheLeader, basis: HermiteBasis) -> FollowLeaderHermite:
    return FollowLeaderHermite(basis, law.cross_section)


@in_hermite.register
def _(law: laws.Inelastic, basis: HermiteBasis) -> InelasticHermite:
    return InelasticHermite(basis, law.cross_section, law.restitution)


def has_hermite(law: laws.CollisionLaw) -> bool:
    """Whether `in_hermite` has a rate for it."""
    return in_hermite.dispatch(type(law)) is not in_hermite.dispatch(object)


def has_deposit(law: laws.CollisionLaw | None) -> bool:
    """Whether its products are deposited between points."""
    return on_points.dispatch(type(law)) is on_points.dispatch(laws.PairLaw)
