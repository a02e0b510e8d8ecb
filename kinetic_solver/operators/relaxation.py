"""(2) with a law of pairs, linearised about a homogeneous state f_h: what is left relaxes quickly and is nearly all of the rest.

Per wavenumber k of f's Fourier series in x, δf_t = M_k δf with

    M_k = -ik(v - u_h) + drift and diffusion + C'[f_h],

a dense matrix over the velocity points, in the frame of the mean velocity u_h: seen from any other the remainder would turn with
every wave that passes. What a step makes in that frame is moved on by u_h h. Drift and diffusion are the spectral derivatives of
which the kernel's band-limited form (operators/velocity/kernel.py) is the exponential; C' is that of the very quadrature that
steps f, so the remainder C[f] - C'[f_h] f has no linear part at f_h. Columns of M_0 sum to zero: mass is
kept; and momentum changes by gravity and friction alone.
Tests: tests/invariants/test_relaxation.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.fourier import RealTransform
from kinetic_solver.operators.phi_functions import Matrices, PhiTables
from kinetic_solver.scene import Model

Modes = NDArray[np.complex128] | Array
"""(nx//2 + 1, nv); real where nx = 1."""


class Generators:
    """M_k for every wavenumber of the grid, and their tables; no state, so that runs may share it."""

    def __init__(self, grid: PhaseSpaceGrid, model: Model, operator: CollisionRate, homogeneous: Array) -> None:
        """`homogeneous` is f_h (nv,) at the grid's velocities; the operator's rate must be quadratic in f. Raises SolverStopped
        where what follows is not finite."""
        self.grid = grid
        self.homogeneous = homogeneous
        self.collisions = quadratic_derivative(operator, homogeneous)
        at_rest = drift_diffusion(grid, model) + self.collisions
        share = np.maximum(homogeneous, 0.0)
        self.share = share / share.sum()
        """Of a mass that rounding makes, at each velocity."""
        at_rest -= np.outer(self.share, at_rest.sum(axis=0))
        # What the period of the spectral derivatives makes of momentum, beside g - γv for a particle at v, is taken out as well:
        # f at one edge of the window has no counterpart at the other.
        v = grid.v - self.share @ grid.v
        moved = self.share * v / (self.share @ v**2)
        at_rest -= np.outer(moved, v @ at_rest - (model.gravity - model.friction * grid.v))
        if not np.isfinite(at_rest).all():
            raise SolverStopped(
                f"the relaxation to the homogeneous state is not finite on {grid.nv} velocities in [{grid.low:g}, "
                f"{grid.high:g}]; choose grid.stepping = 'extrapolated', which does without it"
            )
        self.at_rest = at_rest
        k = grid.wavenumbers.copy()
        if grid.nx % 2 == 0:
            k[-1] = 0.0  # the Nyquist mode is a cosine alone, which transport cannot turn (operators/transport.py)
        speed = model.gravity / model.friction
        self.transport = -1j * np.outer(k, grid.v - speed)
        """-ik(v - u_h), (nx//2 + 1, nv)."""
        self.passing = -1j * k * speed
        """-iku_h, (nx//2 + 1,)."""
        matrices: Matrices = at_rest[None]
        if grid.nx > 1:
            matrices = np.repeat(at_rest[None].astype(complex), k.size, axis=0)
            diagonal = np.arange(grid.nv)
            matrices[:, diagonal, diagonal] += self.transport
        self.tables = PhiTables(matrices)


class Relaxation:
    """What an exponential method (stepping/exponential.py) asks: f (nx, nv) as Fourier modes in x, and M_k of them."""

    def __init__(self, generators: Generators) -> None:
        self.generators = generators
        grid = generators.grid
        self._transform = RealTransform(grid.nx, grid.nv) if grid.nx > 1 else None
        self._collisions_t = np.ascontiguousarray(generators.collisions.T)
        self._at_rest_t = np.ascontiguousarray(generators.at_rest.T)

    def distance(self, f: Array) -> float:
        """max|f - f_h|/max f."""
        return float(np.abs(f - self.generators.homogeneous).max() / np.abs(f).max())

    def forward(self, f: Array) -> Modes:
        return f if self._transform is None else self._transform.forward(f).copy()

    def inverse(self, modes: Modes) -> Array:
        if self._transform is None:
            return modes.real
        self._transform.spectrum[:] = modes
        return self._transform.inverse()

    def moved(self, modes: Modes, time: float) -> Modes:
        """Moved on by u_h times this time."""
        if self._transform is None:
            return modes
        return np.asarray(modes * np.exp(time * self.generators.passing)[:, None])

    def remainder(self, f: Array, rate: Array) -> Modes:
        """Modes of C[f] - C'[f_h] f, the rate being C[f]."""
        return self.forward(rate - f @ self._collisions_t)

    def whole(self, modes: Modes, remainder: Modes) -> Modes:
        """∂f/∂t in the frame of u_h: M f and the remainder. What rounding makes of its mass is taken out."""
        if self._transform is None:
            whole = modes @ self._at_rest_t + remainder
        else:
            whole = (modes.real @ self._at_rest_t) + 1j * (modes.imag @ self._at_rest_t)
            whole += self.generators.transport * modes
            whole += remainder
        whole[0] -= whole[0].sum() * self.generators.share
        return whole

    def functions(self, h: float) -> tuple[Matrices, Matrices, Matrices]:
        return self.generators.tables.get(h)


def drift_diffusion(grid: PhaseSpaceGrid, model: Model) -> Array:
    """f → -∂[(g - γv) f] + σγ ∂²f, spectral on the window as a period, (nv, nv)."""
    nv, period = grid.nv, grid.high - grid.low
    q = 2 * np.pi / period * np.arange(nv // 2 + 1)
    waves = np.exp(1j * np.outer(grid.v, q))
    weight = np.full(q.size, 2.0 / nv)
    weight[0] = 1.0 / nv
    slope = weight * 1j * q
    if nv % 2 == 0:
        weight[-1], slope[-1] = 1.0 / nv, 0.0  # the Nyquist mode is a cosine, whose slope vanishes at the points
    back = waves.conj().T
    first, second = ((waves * slope) @ back).real, ((waves * (-(q**2) * weight)) @ back).real
    return np.asarray(model.friction * model.noise * second - first * (model.gravity - model.friction * grid.v))


def quadratic_derivative(operator: CollisionRate, f: Array) -> Array:
    """C'[f], (nv, nv), of a rate that is quadratic in f: its central differences are exact, whatever their size."""
    size = float(np.abs(f).max())
    changes = size * np.eye(f.size)
    return np.asarray((operator.rate(f + changes) - operator.rate(f - changes)).T / (2 * size))
