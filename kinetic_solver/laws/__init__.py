"""Collision laws: what a collision does, in one record a law, of which everything else asks.

A law says what it is, not how it is computed: the grid's rates of the laws of the paper are in operators/collisions/, the
particles' kernels in particles/. Anyone may write another one (docs/extending.md).
"""

from kinetic_solver.laws.checks import check_frequency, check_given, check_law, check_pairs
from kinetic_solver.laws.law import CollisionLaw, PairLaw
from kinetic_solver.laws.paper import FollowTheLeader, Inelastic, law_of

__all__ = [
    "CollisionLaw",
    "FollowTheLeader",
    "Inelastic",
    "PairLaw",
    "check_frequency",
    "check_given",
    "check_law",
    "check_pairs",
    "law_of",
]
