"""From one phase-space grid to another, and from a moving frame to the laboratory.

Trigonometric interpolation throughout: exact for what the coarser grid represents. A change of grid during a run keeps the
mass of every x to round-off by construction: spectra are padded or cut (their mean stays), and cells that leave the window are
added to the last one that stays. Tests: tests/invariants/test_regrid.py.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.interpolation import through_waves
from kinetic_solver.plan.moving_frame import Place


def resize(values: Array, count: int, axis: int = 0, shift: float = 0.0) -> Array:
    """A periodic function on `count` points instead of its n, moved by `shift` periods; the mean of every line is kept."""
    n = values.shape[axis]
    if count == n and shift == 0:
        return values
    spectrum = np.fft.rfft(values, axis=axis)
    if n % 2 == 0:
        # The Nyquist cosine of n points is half of each of two waves where there are more points.
        spectrum[_at(axis, n // 2, values.ndim)] *= 0.5 if count > n else 1.0
    waves = np.arange(spectrum.shape[axis])
    phases = np.exp(-2j * np.pi * shift * waves).reshape([-1 if i == axis % values.ndim else 1 for i in range(values.ndim)])
    kept = min(spectrum.shape[axis], count // 2 + 1)
    spectrum = (spectrum * phases)[_at(axis, slice(kept), values.ndim)]
    if count % 2 == 0 and count < n:
        spectrum[_at(axis, count // 2, values.ndim)] *= 2.0  # likewise, on the way down
    return np.fft.irfft(spectrum, n=count, axis=axis) * (count / n)


def _at(axis: int, index: int | slice, ndim: int) -> tuple[int | slice, ...]:
    return tuple(index if i == axis % ndim else slice(None) for i in range(ndim))


def regrid(f: Array, old: PhaseSpaceGrid, new: PhaseSpaceGrid) -> Array:
    """f on `new`, whose window is `old`'s give or take whole cells of `old` (see `window_in_cells`). Mass is kept."""
    below, above = round((old.low - new.low) / old.dv), round((new.high - old.high) / old.dv)
    if below < 0:
        f = np.concatenate([f[:, : 1 - below].sum(axis=1, keepdims=True), f[:, 1 - below :]], axis=1)
    if above < 0:
        f = np.concatenate([f[:, : above - 1], f[:, above - 1 :].sum(axis=1, keepdims=True)], axis=1)
    f = np.pad(f, ((0, 0), (max(below, 0), max(above, 0))))
    # Centres of cells lie half a cell from the window's edge.
    n = f.shape[1]
    if new.nv != n:
        f = resize(f, new.nv, axis=1, shift=(1 / n - 1 / new.nv) / 2)
    return resize(f, new.nx)


def window_in_cells(grid: PhaseSpaceGrid, low: float, high: float) -> PhaseSpaceGrid:
    """The grid of the same dv that holds [low, high] with whole cells."""
    below, above = np.ceil((grid.low - low) / grid.dv - 1e-9), np.ceil((high - grid.high) / grid.dv - 1e-9)
    return dataclasses.replace(
        grid, nv=int(grid.nv + below + above), low=grid.low - below * grid.dv, high=grid.high + above * grid.dv
    )


class ToOutput:
    """f on a solver's grid, in its frame → f on the grid of the output, in the laboratory; 0 outside the solver's window."""

    def __init__(self, source: PhaseSpaceGrid, target: PhaseSpaceGrid) -> None:
        self.source, self.target = source, target
        self._same_velocities = dataclasses.replace(source, nx=target.nx) == target
        self._matrix: tuple[tuple[float, float], Array] | None = None
        """The last that was used, and the velocity and scale of its place: a frame asks twice, and one at rest has but one."""

    def __call__(self, f: Array, place: Place) -> Array:
        if self.source == self.target and place.velocity == place.position == 0 and place.scale == 1:
            return f
        return self._along_v(self.along_x(f, place), place)

    def _along_v(self, f: Array, place: Place) -> Array:
        if self._same_velocities and place.velocity == 0 and place.scale == 1:
            return f
        w = (self.target.v - place.velocity) / place.scale
        inside = (w > self.source.low) & (w < self.source.high)
        result = np.zeros((f.shape[0], w.size))
        if self._matrix is None or self._matrix[0] != (place.velocity, place.scale):
            between = through_waves(self.source.v, w[inside], self.source.high - self.source.low)
            self._matrix = (place.velocity, place.scale), between.T
        result[:, inside] = f @ self._matrix[1] / place.scale
        return result

    def along_x(self, field: Array, place: Place) -> Array:
        """f, or a field over x, moved and evaluated at the places of the output: all of its waves, however few these are."""
        times = -(-self.source.nx // self.target.nx)
        return resize(field, times * self.target.nx, shift=np.mod(place.position / self.source.length, 1.0))[::times]

    def over_x(self, f: Array, place: Place) -> Array:
        """∫f dx at the velocities of the output."""
        return self._along_v(f.sum(axis=0, keepdims=True) * self.source.dx, place)[0]
