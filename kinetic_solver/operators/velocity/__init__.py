"""How the velocity direction is represented: points, with drift (gravity, friction) and diffusion (noise) over a time h as a
matrix between them, or Hermite functions."""

from kinetic_solver.operators.velocity.expansion import Expansion
from kinetic_solver.operators.velocity.finite_volume import FiniteVolume, HighOrderFiniteVolume
from kinetic_solver.operators.velocity.hermite import HermiteBasis
from kinetic_solver.operators.velocity.kernel import OrnsteinUhlenbeckKernel
from kinetic_solver.operators.velocity.protocol import DriftDiffusion

__all__ = ["DriftDiffusion", "Expansion", "FiniteVolume", "HermiteBasis", "HighOrderFiniteVolume", "OrnsteinUhlenbeckKernel"]
