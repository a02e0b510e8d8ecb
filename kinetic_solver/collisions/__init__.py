"""The two collision operators, (6) follow-the-leader and (12) inelastic, on velocity points and on Hermite coefficients."""

from kinetic_solver.collisions.follow_leader import FollowLeader
from kinetic_solver.collisions.hermite import FollowLeaderHermite, InelasticHermite
from kinetic_solver.collisions.inelastic import Inelastic
from kinetic_solver.collisions.protocol import CollisionOperator

__all__ = ["CollisionOperator", "FollowLeader", "FollowLeaderHermite", "Inelastic", "InelasticHermite"]
