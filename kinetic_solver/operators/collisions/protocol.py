"""What a collision operator on the grid is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from kinetic_solver.arrays import Array


class CollisionRate(Protocol):
    """C[f] on velocity points, local in x; f has shape (nx, nv), v contiguous, and holds point values."""

    @property
    def conserves(self) -> tuple[str, ...]:
        """Which of "mass", "momentum", "energy" it leaves alone at every x."""
        ...

    def rate(self, f: Array) -> Array:
        """C[f] = ∂f/∂t by collisions."""
        ...


class CollisionOperator(CollisionRate, Protocol):
    """That, and the substep."""

    def __call__(self, f: Array, dt: float) -> Array:
        """f after dt of collisions alone."""
        ...


@runtime_checkable
class RefinableRate(Protocol):
    """A rate with an error of its own in dv, which the same on more points shows."""

    def rate(self, f: Array) -> Array: ...

    def on(self, nv: int) -> RefinableRate:
        """The same operator on nv points in the same window."""
        ...
