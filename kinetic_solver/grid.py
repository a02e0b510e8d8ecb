"""The phase-space grid: geometry only. f is a plain array of shape (nx, nv) of point values f(x_i, v_j)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinetic_solver.arrays import Array


def wavenumbers(nx: int, length: float) -> Array:
    """k = 2π n/L for n = 0 … nx//2, the rows of a real transform."""
    return 2 * np.pi / length * np.arange(nx // 2 + 1)


@dataclass(frozen=True)
class PhaseSpaceGrid:
    """Uniform points x_i = i L/nx on the periodic pipe and v_j = low + (j + 1/2) dv, the centres of nv velocity cells.

    Sums over the points times dx dv are the integrals: for smooth f that vanishes at the window's edges they converge
    faster than any power of dx and dv (the trapezoidal rule on a periodic function).
    """

    nx: int
    nv: int
    length: float
    low: float
    high: float
    scaled: bool = False
    """Whether v stands for scaled velocities (v - u)/s, s and u of each time: of the output of a run that cools."""

    @property
    def dx(self) -> float:
        return self.length / self.nx

    @property
    def dv(self) -> float:
        return (self.high - self.low) / self.nv

    @cached_property
    def x(self) -> Array:
        return self.dx * np.arange(self.nx)

    @cached_property
    def v(self) -> Array:
        return self.low + self.dv * (np.arange(self.nv) + 0.5)

    @cached_property
    def faces(self) -> Array:
        """The nv + 1 cell faces in v."""
        return self.low + self.dv * np.arange(self.nv + 1)

    @cached_property
    def wavenumbers(self) -> Array:
        return wavenumbers(self.nx, self.length)
