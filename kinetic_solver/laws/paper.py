"""The two laws of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from kinetic_solver.laws.law import PairLaw


@dataclass(frozen=True)
class FollowTheLeader(PairLaw):
    """Operator (6), C[f] = S f ρ (u - v): the faster particle of a pair takes the velocity of the slower one."""

    cross_section: float
    name: ClassVar[str] = "follow-the-leader"
    conserves: ClassVar[tuple[str, ...]] = ("mass",)
    linearises: ClassVar[bool] = True

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.0, 0.0


@dataclass(frozen=True)
class Inelastic(PairLaw):
    """Operator (12): of the relative velocity of a pair (11) leaves -ε times it, and its mean as it was."""

    cross_section: float
    restitution: float
    """ε."""
    name: ClassVar[str] = "inelastic"
    conserves: ClassVar[tuple[str, ...]] = ("mass", "momentum")

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        restitution = numbers[1]
        return 0.5 * (1 - restitution) * r, 0.5 * (1 + restitution) * r

    @property
    def dissipation(self) -> float:
        """1 - ε²."""
        return 1 - self.restitution**2


def law_of(operator: str | None, cross_section: float, restitution: float) -> PairLaw | None:
    """The law that a scene's [collisions] means; None without collisions, and for those that change nothing."""
    if operator is None:
        return None
    return FollowTheLeader(cross_section) if operator == FollowTheLeader.name else Inelastic(cross_section, restitution)
