"""What a collision operator is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CollisionOperator(Protocol):
    """C[f] on velocity points, local in x; f has shape (nx, nv), v contiguous, and holds point values."""

    name: str
    conserves: tuple[str, ...]

    def rate(self, f: Array) -> Array:
        """C[f] = ∂f/∂t by collisions."""
        ...

    def __call__(self, f: Array, dt: float) -> Array:
        """f after dt of collisions alone."""
        ...
