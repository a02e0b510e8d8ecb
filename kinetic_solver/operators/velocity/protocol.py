"""What a drift-diffusion substep is."""

from __future__ import annotations

from typing import Protocol

from kinetic_solver.arrays import Array


class DriftDiffusion(Protocol):
    """Solves ∂f/∂t + ∂/∂v[(g - γv) f] = σγ ∂²f/∂v² on the velocity points, over any time h."""

    def matrix(self, h: float) -> Array:
        """K(h), shape (nv, nv): f(v_i) after h is Σ_j K_ij f(v_j). Every column sums to 1: mass is conserved."""
        ...
