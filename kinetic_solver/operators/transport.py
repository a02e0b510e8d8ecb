"""Spectral transport in x: ∂f/∂t + v ∂f/∂x = 0, exact in time, as a phase per wavenumber and velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid


def resolved_waves(grid: PhaseSpaceGrid) -> Array:
    """A factor for each wavenumber, shape (nx//2 + 1,), that damps the highest tenth: exp(-36 (k/k_max)^36).

    Operator (6) amplifies waves transiently, and products on the grid fold waves beyond the spectrum's end back into it: together
    these feed on themselves. Damping the end of the spectrum breaks the loop; what is well resolved keeps its 16 digits.
    """
    n = np.arange(grid.wavenumbers.size)
    return np.exp(-36 * (n / max(n[-1], 1)) ** 36)


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
