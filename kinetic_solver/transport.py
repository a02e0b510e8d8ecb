"""Spectral transport in x: ∂f/∂t + v ∂f/∂x = 0, exact in time, as a phase per wavenumber and velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid


def shift_phases(grid: PhaseSpaceGrid, displacement: Array) -> NDArray[np.complex128]:
    """exp(-ik·displacement), shape (nx//2 + 1, len(displacement)): multiplies the x-spectrum of f, shifting it.

    Exact for every f that the grid represents when nx is odd. For even nx the Nyquist mode has a cosine only; its sine
    vanishes on the grid, so its factor is the real part, cos(k·displacement): mass is kept, that one mode is damped.
    The automatic choice of nx is odd.
    """
    phases = np.exp(-1j * np.outer(grid.wavenumbers, displacement))
    if grid.nx % 2 == 0:
        phases[-1] = phases[-1].real
    return phases
