"""How the velocity direction is stepped: drift (gravity, friction) and diffusion (noise) over a time h, as a matrix."""

from kinetic_solver.velocity.finite_volume import FiniteVolume
from kinetic_solver.velocity.kernel import OrnsteinUhlenbeckKernel
from kinetic_solver.velocity.protocol import DriftDiffusion

__all__ = ["DriftDiffusion", "FiniteVolume", "OrnsteinUhlenbeckKernel"]
