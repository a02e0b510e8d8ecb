"""Random numbers by counting: published answers, distributions, independence, threads."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import stats

from particles.random import LANGEVIN, POSITIONS, TAIL, key, philox, standard_normals, uniforms

MASK = 0xFFFFFFFF


def twin(counter: list[int], words: list[int]) -> list[int]:
    """Philox4x32-10 in Python's integers."""
    c, k = list(counter), list(words)
    for _ in range(10):
        first, second = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(second >> 32) ^ c[1] ^ k[0], second & MASK, (first >> 32) ^ c[3] ^ k[1], first & MASK]
        k = [(k[0] + 0x9E3779B9) & MASK, (k[1] + 0xBB67AE85) & MASK]
    return c


@numba.njit
def compiled(counter, words):  # type: ignore[no-untyped-def]
    return philox(counter[0], counter[1], counter[2], counter[3], words[0], words[1])


@pytest.mark.parametrize(
    ("counter", "words", "expected"),
    [
        ([0] * 4, [0] * 2, "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ([MASK] * 4, [MASK] * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ([0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344], [0xA4093822, 0x299F31D0], "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)
def test_known_answers(counter: list[int], words: list[int], expected: str) -> None:
    """Those published with the generator (Random123)."""
    answer = [int(part, 16) for part in expected.split()]
    assert twin(counter, words) == answer
    assert [int(w) for w in compiled(np.array(counter, dtype=np.uint64), np.array(words, dtype=np.uint64))] == answer


def normals(count: int, step: int = 0, seed: int = 5, replica: int = 0) -> np.ndarray:
    out, k = np.empty((count, 2)), key(seed, replica)
    standard_normals(out, LANGEVIN, np.uint64(step), k[0], k[1])
    return out


def test_normal_deviates() -> None:
    """Kolmogorov and Smirnov, moments to order 8, and the tail that has its own branch."""
    sample = normals(500_000).ravel()
    assert stats.kstest(sample, "norm").pvalue > 1e-3
    for order, expected in ((1, 0), (2, 1), (3, 0), (4, 3), (6, 15), (8, 105)):
        powers = sample**order
        assert abs(powers.mean() - expected) < 4 * powers.std() / np.sqrt(sample.size)
    tail = np.abs(sample[np.abs(sample) > TAIL])
    probability = 2 * stats.norm.sf(TAIL)
    assert abs(tail.size - probability * sample.size) < 4 * np.sqrt(probability * sample.size)
    assert stats.kstest(stats.norm.sf(tail) / stats.norm.sf(TAIL), "uniform").pvalue > 1e-3


def test_independence() -> None:
    """The two deviates, neighbouring counters, steps, replicas and seeds: correlations within 4 standard errors."""
    base = normals(200_000)
    others = [base[:, 1], np.roll(base[:, 0], 1), normals(200_000, step=1)[:, 0]]
    others += [normals(200_000, replica=1)[:, 0], normals(200_000, seed=6)[:, 0]]
    for other in others:
        assert abs(np.corrcoef(base[:, 0], other)[0, 1]) < 4 / np.sqrt(200_000)
        assert abs(np.corrcoef(base[:, 0] ** 2, other**2)[0, 1]) < 4 / np.sqrt(200_000)


def test_uniform_numbers_and_threads() -> None:
    k, threads = key(1, 2), numba.get_num_threads()
    found = []
    try:
        for count in (1, 2):
            numba.set_num_threads(count)
            x = np.empty(100_001)
            uniforms(x, POSITIONS, np.uint64(0), k[0], k[1])
            found.append((x, normals(10_001)))
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(found[0][0], found[1][0])
    assert np.array_equal(found[0][1], found[1][1])
    x = found[0][0]
    assert x.min() >= 0
    assert x.max() < 1
    assert stats.kstest(x, "uniform").pvalue > 1e-3
