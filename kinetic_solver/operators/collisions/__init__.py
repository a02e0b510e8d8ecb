"""Collision laws on the grid: rates on points and on Hermite coefficients, substeps, and which scheme serves which law."""

from kinetic_solver.operators.collisions.follow_leader import FollowLeader
from kinetic_solver.operators.collisions.hermite import FollowLeaderHermite, InelasticHermite
from kinetic_solver.operators.collisions.inelastic import Inelastic
from kinetic_solver.operators.collisions.of_law import has_deposit, has_hermite, in_hermite, on_points
from kinetic_solver.operators.collisions.pairs import POINTS, PairCollisions
from kinetic_solver.operators.collisions.protocol import CollisionOperator, CollisionRate, RefinableRate

__all__ = [
    "POINTS",
    "CollisionOperator",
    "CollisionRate",
    "FollowLeader",
    "FollowLeaderHermite",
    "Inelastic",
    "InelasticHermite",
    "PairCollisions",
    "RefinableRate",
    "has_deposit",
    "has_hermite",
    "in_hermite",
    "on_points",
]
