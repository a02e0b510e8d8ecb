"""The tests of a comparison, calibrated by Monte Carlo with fixed seeds: p is uniform, or too large, and never too small."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from kinetic_solver.arrays import Array
from kinetic_solver.compare.statistics import beyond, chi_squared, largest_of
from kinetic_solver.compare.values import Values

LEVELS = (0.05, 0.01)
CONFIDENCE = 0.999
"""With which a count of trials lies within its binomial bounds."""


def correlated(rng: np.random.Generator, q: int) -> Array:
    """A matrix A (q, q) that makes correlated variables A·z of very different sizes."""
    return np.asarray(10.0 ** rng.uniform(-3, 1, (q, 1)) * (rng.normal(size=(q, q)) + 2 * rng.normal(size=(q, 1))))


def one_trial(rng: np.random.Generator, a: Array, replicas: int) -> tuple[Array, Array]:
    """A mean over replicas (q,) whose true value is 0, and its estimated covariance."""
    values = rng.normal(size=(replicas, len(a))) @ a.T
    return values.mean(axis=0), np.atleast_2d(np.cov(values, rowvar=False)) / replicas


def at_most(p: Array, level: float) -> None:
    """The rate of p < level is not above it."""
    assert (p < level).sum() <= stats.binom.ppf(CONFIDENCE, p.size, level)


@pytest.mark.parametrize(("replicas", "q"), [(4, 1), (4, 2), (8, 1), (8, 4), (20, 1), (20, 5), (20, 10)])
def test_p_is_uniform(replicas: int, q: int) -> None:
    """Without a bias, for correlated Gaussians, at every p (Kolmogorov and Smirnov) and at 5 % and 1 %."""
    rng = np.random.default_rng([replicas, q])
    a, bound = correlated(rng, q), np.zeros(q)
    p = np.array([chi_squared(*one_trial(rng, a, replicas), bound, replicas - 1)[1] for _ in range(1500)])
    assert stats.kstest(p, "uniform").pvalue > 1 - CONFIDENCE
    for level in LEVELS:
        assert stats.binom.ppf(1 - CONFIDENCE, p.size, level) <= (p < level).sum() <= stats.binom.ppf(CONFIDENCE, p.size, level)


@pytest.mark.parametrize(("ratio", "first"), [(1.0, 8), (1e-3, 8), (1e3, 8), (1.0, 20), (30.0, 20)])
def test_two_samples_of_different_scatter(ratio: float, first: int) -> None:
    """Both sides scatter, with other covariances and numbers of replicas: freedom of the smaller number, p not too small."""
    rng = np.random.default_rng(first)
    q, second = 3, 8
    a, b = correlated(rng, q), ratio * correlated(rng, q)
    p = []
    for _ in range(1200):
        (left, ours), (right, theirs) = one_trial(rng, a, first), one_trial(rng, b, second)
        p.append(chi_squared(left - right, ours + theirs, np.zeros(q), second - 1)[1])
    for level in LEVELS:
        at_most(np.array(p), level)


@pytest.mark.parametrize("bias", [(0.0, 0.0, 0.0), (1.0, -1.0, 1.0), (1.0, 0.3, -0.6), (0.2, 0.5, -0.9)], ids=str)
@pytest.mark.parametrize("size", [0.3, 3.0], ids=["small", "large"])
def test_p_is_never_too_small_within_the_bound(bias: tuple[float, ...], size: float) -> None:
    """True biases at the middle, a corner, an edge and inside of the box, which is 0.3 or 3 standard errors wide."""
    rng = np.random.default_rng(11)
    replicas, a = 12, correlated(rng, 3)
    bound = size * np.sqrt(np.diag(a @ a.T) / replicas)
    p = []
    for _ in range(400):
        mean, covariance = one_trial(rng, a, replicas)
        p.append(chi_squared(mean + bias * bound, covariance, bound, replicas - 1)[1])
    for level in LEVELS:
        at_most(np.array(p), level)


def least_on_the_box(difference: Array, inverse: Array, bound: Array) -> float:
    """min (d - s)ᵀ C⁻¹ (d - s) for q = 2: 0 inside, else on one of the four edges, each a parabola."""
    if (np.abs(difference) <= bound).all():
        return 0.0
    found = []
    for fixed in (0, 1):
        free = 1 - fixed
        for sign in (-1, 1):
            rest = difference[fixed] - sign * bound[fixed]
            best = difference[free] + inverse[0, 1] / inverse[free, free] * rest
            s = np.empty(2)
            s[fixed], s[free] = sign * bound[fixed], np.clip(best, -bound[free], bound[free])
            found.append((difference - s) @ inverse @ (difference - s))
    return float(min(found))


def test_the_least_within_the_bound() -> None:
    """Against the four edges, and against all points of a grid, of which none is less."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        half = rng.normal(size=(2, 2))
        covariance = half @ half.T + 1e-3 * np.eye(2)
        bound, difference = rng.uniform(0.1, 2, 2), rng.normal(0, 3, 2)
        value, p = chi_squared(difference, covariance, bound, 9)
        inverse = np.linalg.inv(covariance)
        expected = least_on_the_box(difference, inverse, bound)
        assert value == pytest.approx(expected, rel=1e-6, abs=1e-8)
        rest = difference - bound * np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 201)]), axis=-1)
        everywhere = np.einsum("...i,ij,...j", rest, inverse, rest)
        assert value <= everywhere.min() * (1 + 1e-9) + 1e-9
        assert p == pytest.approx(stats.f.sf(value * 8 / 18, 2, 8), rel=1e-12)


def test_beyond_the_box() -> None:
    """Within p is 1, a little beyond it is no surprise, far beyond it is one; an infinite bound explains everything."""
    covariance, bound = np.array([[1.0, 0.6], [0.6, 2.0]]), np.array([3.0, 5.0])
    p = [chi_squared(np.array([d, -4.9]), covariance, bound, 19)[1] for d in (-3.0, 0.0, 2.99, 4.0, 6.0, 9.0, 13.0)]
    assert p[:3] == pytest.approx([1, 1, 1])
    assert (np.diff(p[2:]) < 0).all()
    assert p[3] > 0.3
    assert p[5] < 1e-3
    assert p[6] < 1e-6
    assert chi_squared(np.array([1e3, -1e3]), covariance, np.full(2, np.inf), 19)[1] == 1


def test_a_bound_on_some_alone() -> None:
    """The bias of the first explains all of its difference, whatever is known of the second."""
    value, p = chi_squared(np.array([5.0, 0.1]), np.eye(2), np.array([6.0, 0.0]), 19)
    assert value == pytest.approx(0.01)
    assert p > 0.9


@pytest.mark.parametrize("freedom", [3, 7, 19])
def test_the_largest_of_many(freedom: int) -> None:
    """Independent variables: the rate of p < α is 1 - (1 - α/n)ⁿ; the same variable n times: α/n. Neither is above α."""
    rng = np.random.default_rng(freedom)
    trials, n = 2000, 30
    t = rng.standard_t(freedom, (trials, n))
    independent = np.array([largest_of(z, freedom) for z in t])
    same = np.array([largest_of(np.repeat(z[:1], n), freedom) for z in t])
    for level in LEVELS:
        rate = 1 - (1 - level / n) ** n
        count = (independent < level).sum()
        assert stats.binom.ppf(1 - CONFIDENCE, trials, rate) <= count <= stats.binom.ppf(CONFIDENCE, trials, rate)
        assert (same < level).sum() <= stats.binom.ppf(CONFIDENCE, trials, level / n)


def test_the_largest_of_means_over_replicas() -> None:
    """Of correlated Gaussian means in their own standard errors, as `compare` has them."""
    rng = np.random.default_rng(2)
    a = correlated(rng, 20)
    p = []
    for _ in range(1500):
        mean, covariance = one_trial(rng, a, 6)
        p.append(largest_of(mean / np.sqrt(np.diag(covariance)), 5))
    for level in LEVELS:
        at_most(np.array(p), level)


def test_the_largest_of_none_and_of_one() -> None:
    assert largest_of(np.empty(0), 5) == 1
    assert largest_of(np.array([-2.5]), 5) == pytest.approx(2 * stats.t.sf(2.5, 5))
    assert largest_of(np.array([0.1, -2.5]), np.array([9, 5])) == pytest.approx(4 * stats.t.sf(2.5, 5))
    assert largest_of(np.zeros(7), 5) == 1
    assert largest_of(np.array([np.inf, 0.0]), 5) == 0


def test_beyond() -> None:
    difference = np.array([-3.0, -1.0, 0.0, 0.5, 2.0])
    assert beyond(difference, 1.0) == pytest.approx([-2.0, 0.0, 0.0, 0.0, 1.0])
    assert beyond(difference, np.array([0.0, 2.0, 1.0, 0.25, np.inf])) == pytest.approx([-3.0, 0.0, 0.0, 0.25, 0.0])


def test_values_have_the_moments_of_their_replicas() -> None:
    """Variance and covariance of the mean, of linear statistics too; inflated; from standard errors; none without replicas."""
    rng = np.random.default_rng(1)
    replicas, matrix = rng.normal(size=(9, 4)), rng.normal(size=(3, 4))
    values = Values(replicas.mean(axis=0), replicas, 2.5)
    assert values.freedom == 8
    expected = 2.5 / 9 * sum(np.outer(r, r) for r in replicas - values.points) / 8
    assert values.covariance == pytest.approx(expected)
    assert values.variance == pytest.approx(np.diag(expected))
    over = values.over(matrix)
    assert over.points == pytest.approx(matrix @ values.points)
    assert over.covariance == pytest.approx(matrix @ expected @ matrix.T)
    assert over.variance == pytest.approx(np.diag(matrix @ expected @ matrix.T))
    errors = Values(values.points, None, 2.0, (np.arange(4.0), 6))
    assert errors.freedom == 5
    assert errors.variance == pytest.approx(2 * np.arange(4.0) ** 2)
    fixed = Values(values.points)
    assert fixed.freedom == 0
    assert not fixed.variance.any()
    assert not fixed.covariance.any()
