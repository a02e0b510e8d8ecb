"""Between uniform points: matrices from values there to values at any places. Tests: tests/invariants/test_interpolation.py."""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array

SAME_POINT = 1e-8
"""Of the distance between two points: a place no further from one of them is that one. Chosen: far above rounding."""


def through_waves(own: Array, places: Array, period: float) -> Array:
    """Matrix (places, own) of the trigonometric interpolant through one period of uniform points.

    Exact for the waves that the points hold, of which a wave of two points counts as a cosine. It is Dirichlet's kernel,
    sin(nφ/2)/(n sin(φ/2)) for odd n, sin(nφ/2)/(n tan(φ/2)) for even n, with φ = 2π(place - point)/period.
    """
    n = own.size
    turns = np.subtract.outer(places, own) / period
    half = np.pi * (turns - np.round(turns))
    below = np.sin(half) if n % 2 else np.tan(half)
    with np.errstate(divide="ignore", invalid="ignore"):
        kernel = np.sin(n * half) / (n * below)
    kernel = np.where(half == 0, 1.0, kernel)
    # At a point is its own value alone: rounding of all others may be more than what is in the tail of f.
    steps = n * turns
    known = np.abs(steps - np.rint(steps)).max(axis=1) < SAME_POINT
    kernel[known] = np.rint(steps[known]) % n == 0
    return np.asarray(kernel)


def through_splines(own: Array, places: Array, degree: int = 5) -> Array:
    """Matrix (places, own) of the spline of odd degree through the points, not-a-knot at the ends; places lie within them."""
    from scipy.interpolate import make_interp_spline

    return np.asarray(make_interp_spline(own, np.eye(own.size), k=degree)(places))
