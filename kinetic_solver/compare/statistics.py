"""Is a difference larger than chance and a known bound together explain? Tests that hold whatever is correlated with what.

Means over R replicas are Gaussian, for ensembles of more than a few particles, with a covariance that has to be estimated from
the same replicas: so Hotelling's T² (1931) for a few statistics at a time, and Student's t for the largest of many. A systematic
part that is only known to lie within a bound is chosen within it so that the difference is least: p is then an upper bound.
Tests: tests/cross_validation/compare/test_statistics.py.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg, optimize, stats

from kinetic_solver.arrays import Array


def chi_squared(difference: Array, covariance: Array, bound: Array, freedom: int) -> tuple[float, float]:
    """(χ², p) of differences (q,) of means with an estimated covariance (q, q) of `freedom` ≥ q, and bounds (q,) on their bias.

    χ² = min over |s| ≤ bound of (d - s)ᵀ C⁻¹ (d - s). Without a bias χ²(ν - q + 1)/(νq) has the F distribution of q and
    ν - q + 1, exactly for Gaussian data (Hotelling 1931). Raises LinAlgError where a
    combination of the statistics does not scatter.
    """
    size = np.sqrt(np.diag(covariance))
    half = linalg.cholesky(covariance / np.outer(size, size), lower=True)
    whitened = linalg.solve_triangular(half, np.diag(1 / size), lower=True)
    if (bound > 0).any():
        granted = np.maximum(bound, 1e-12 * bound.max())  # the solver wants an interior
        result = optimize.lsq_linear(whitened, whitened @ difference, bounds=(-granted, granted), tol=1e-12)
        value = 2 * float(result.cost)
    else:
        value = float(np.sum((whitened @ difference) ** 2))
    count = difference.size
    return value, float(stats.f.sf(value * (freedom - count + 1) / (freedom * count), count, freedom - count + 1))


def largest_of(z: Array, freedom: Array | int) -> float:
    """p of the largest |z| among values each with Student's distribution, for any correlation between them (Bonferroni)."""
    each = 2 * stats.t.sf(np.abs(z), freedom)
    return float(min(1.0, z.size * each.min())) if z.size else 1.0


def beyond(difference: Array, bound: Array | float) -> Array:
    """What is left of a difference when a bias within the bound is granted."""
    return np.asarray(np.sign(difference) * np.maximum(np.abs(difference) - bound, 0.0))
