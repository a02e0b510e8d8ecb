"""f on points that are not equally far apart, brought to uniform ones without loss of mass.

Through the points goes a cubic spline, periodic in x. Its integral over each uniform cell is exact, so that the sum over the
cells is the integral of the spline to round-off; averages over cells become values at their centres wave by wave, which leaves
the mean as it is. Order 4 in the distance between the points. Tests: tests/exact/test_file_coordinates.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array

DENSER = 4
"""Times as many uniform points as there are uneven ones, at most: where a few lie very close, the others would become too many.
Chosen."""


def uniform_in_x(x: Array, f: Array, length: float) -> tuple[float, Array]:
    """(first place, f at uniform places) from f (nx, nv) at ascending places that lie within one period."""
    from scipy.interpolate import CubicSpline

    around = np.append(x, x[0] + length)
    spline = CubicSpline(around, np.concatenate([f, f[:1]]), axis=0, bc_type="periodic")
    count = _count(np.diff(around), length) | 1  # odd: an even number has a wave without a sine
    spacing = length / count
    averages = _averages(spline, x[0] + spacing * np.arange(count + 1))
    return float(x[0] + spacing / 2), at_centres(averages)


def uniform_in_v(v: Array, f: Array) -> tuple[Array, Array]:
    """(uniform velocities from the first to the last, f there) from f (nx, nv) at ascending velocities, 0 beyond them."""
    from scipy.interpolate import CubicSpline

    span = float(v[-1] - v[0])
    count = _count(np.diff(v), span) + 1
    new, spacing = np.linspace(v[0], v[-1], count), span / (count - 1)
    faces = np.clip(v[0] + spacing * (np.arange(count + 1) - 0.5), v[0], v[-1])
    return new, at_centres(_averages(CubicSpline(v, f.T, axis=0), faces, spacing)).T


def at_centres(averages: Array) -> Array:
    """Values at the centres of uniform cells from averages over them, along axis 0: waves are averaged by sin(kh/2)/(kh/2)."""
    n = averages.shape[0]
    damped = np.sinc(np.arange(n // 2 + 1) / n)
    spectrum = np.fft.rfft(averages, axis=0) / damped[:, None]
    return np.asarray(np.fft.irfft(spectrum, n=n, axis=0))


def _count(gaps: Array, span: float) -> int:
    """Uniform intervals as short as the shortest gap, within reason."""
    return min(math.ceil(span / float(gaps.min()) - 1e-6), DENSER * gaps.size)


def _averages(spline: Any, faces: Array, spacing: float | None = None) -> Array:
    """Over the cells between the faces; of cells of this width, of which the faces bound the part where there is anything."""
    integrals = np.diff(spline.antiderivative()(faces), axis=0)
    return np.asarray(integrals / (float(faces[1] - faces[0]) if spacing is None else spacing))
