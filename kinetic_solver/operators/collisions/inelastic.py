"""Operator (12), inelastic collisions, on velocity points: the pair law of (11)."""

from __future__ import annotations

from kinetic_solver import laws
from kinetic_solver.arrays import Array
from kinetic_solver.operators.collisions.pairs import PairCollisions


class Inelastic(PairCollisions):
    """C[f] of (12) on uniform velocity points (pairs.py). ε = 1 gives exactly zero."""

    def __init__(self, velocity: Array, cross_section: float, restitution: float, deposit: str = "linear") -> None:
        super().__init__(velocity, laws.Inelastic(cross_section, restitution), deposit)
