"""The two collision operators, (6) follow-the-leader and (12) inelastic, on velocity points and on Hermite coefficients."""

from kinetic_solver.operators.collisions.follow_leader import FollowLeader
from kinetic_solver.operators.collisions.hermite import FollowLeaderHermite, InelasticHermite
from kinetic_solver.operators.collisions.inelastic import Inelastic
from kinetic_solver.operators.collisions.protocol import CollisionOperator

__all__ = ["CollisionOperator", "FollowLeader", "FollowLeaderHermite", "Inelastic", "InelasticHermite"]
