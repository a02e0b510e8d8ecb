"""Random numbers by counting: published answers, distributions, independence, threads."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
from scipy import stats

from particles import random
from particles.random import BLOCK, LANGEVIN, POSITIONS, TAIL, VELOCITIES, key, philox, standard_normals, uniforms

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


def test_random_counters() -> None:
    """Against Python's integers, which cannot overflow."""
    for row in np.random.default_rng(8).integers(0, 2**32, (500, 6), dtype=np.uint64):
        c, k = [int(word) for word in row[:4]], [int(word) for word in row[4:]]
        assert [int(w) for w in compiled(row[:4], row[4:])] == twin(c, k)


@numba.njit
def drawn(purpose, index, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    return random.words(purpose, index, step, draw, k0, k1)


def test_a_counter_for_each_draw() -> None:
    """The place of purpose, index (two words), step and draw in the counter: none is lost, none meets another."""
    k = key(5, 1)
    for purpose, index, step, draw in ((0, 3, 7, 2), (3, 2**40 + 5, 2**32 - 1, 2**24 - 1), (2, 2**32 - 1, 0, 1)):
        counter = [index & MASK, index >> 32, step, purpose << 24 | draw]
        found = drawn(purpose, np.uint64(index), np.uint64(step), draw, k[0], k[1])
        assert [int(w) for w in found] == twin(counter, [int(word) for word in k])


def normals(count: int, step: int = 0, seed: int = 5, replica: int = 0) -> np.ndarray:
    out, k = np.empty((count, 2)), key(seed, replica)
    standard_normals(out, LANGEVIN, np.uint64(step), k[0], k[1])
    return out


def slow_normal(words: list[int], purpose: int, index: int, step: int, draw: int, k: list[int]) -> float:
    """The ziggurat by its definition: layers of equal area, points uniform in each, a point under the curve is kept."""
    area = TAIL * math.exp(-(TAIL**2) / 2) + math.sqrt(math.pi / 2) * math.erfc(TAIL / math.sqrt(2))
    edges = [area * math.exp(TAIL**2 / 2), TAIL]
    while len(edges) < 256:
        edges.append(math.sqrt(-2 * math.log(area / edges[-1] + math.exp(-(edges[-1] ** 2) / 2))))
    edges.append(0.0)
    bits = words[0] << 32 | words[1]
    layer, sign, fraction = bits % 256, 1 - 2 * (bits >> 8 & 1), (bits >> 11) / 2**53
    while True:
        x = fraction * edges[layer]
        if x < edges[layer + 1]:
            return sign * x
        while True:
            draw += 2
            a, b, c, d = twin([index, 0, step, purpose << 24 | draw], k)
            first, second = (a + 0.5) / 2**32, (b + 0.5) / 2**32
            if layer > 0:
                break
            beyond = -math.log(first) / TAIL
            if -2 * math.log(second) > beyond**2:
                return sign * (TAIL + beyond)
        low, high = (math.exp(-(edges[n] ** 2) / 2) for n in (layer, layer + 1))
        if low + first * (high - low) < math.exp(-x * x / 2):
            return sign * x
        layer, sign, fraction = b % 256, 1 - 2 * (b >> 8 & 1), (c << 21 | d >> 11) / 2**53


def test_normals_against_a_slow_twin() -> None:
    """Every deviate that left its layer's inner rectangle, tail included, of 40 000, and 300 others."""
    found, k = normals(20_000, step=3), [int(word) for word in key(5, 0)]
    hard = 0
    for index in range(20_000):
        words = twin([index, 0, 3, LANGEVIN << 24], k)
        for draw, pair in ((0, words[:2]), (1, words[2:])):
            bits = pair[0] << 32 | pair[1]
            outside = (bits >> 11) / 2**53 * random._WIDTH[bits % 256] >= random._WIDTH[bits % 256 + 1]
            hard += outside
            if outside or index < 150:
                assert found[index, draw] == pytest.approx(slow_normal(pair, LANGEVIN, index, 3, draw, k), rel=1e-14, abs=0)
    assert hard == pytest.approx(40_000 / 67, rel=0.1)  # "one in 67"


@numba.njit
def one_by_one(out, purpose, first, step, k0, k1):  # type: ignore[no-untyped-def]
    """The two deviates of each index, by one counter at a time and the ziggurat's rectangles with a branch."""
    for j in range(out.shape[1]):
        words = random.words(purpose, first + j, step, 0, k0, k1)
        for which in range(2):
            bits = (words[2 * which] << np.uint64(32)) | words[2 * which + 1]
            layer, fraction = np.int64(bits & np.uint64(255)), float(bits >> np.uint64(11)) * 2.0**-53
            sign = -1.0 if bits & np.uint64(256) else 1.0
            if fraction * random._WIDTH[layer] < random._WIDTH[layer + 1]:
                out[which, j] = sign * fraction * random._WIDTH[layer]
            else:
                out[which, j] = random._outside(layer, sign, fraction, purpose, first + j, step, which, k0, k1)


@pytest.mark.parametrize("purpose", [LANGEVIN, VELOCITIES])
@pytest.mark.parametrize("first", [0, 77, 2**32 - 50])
def test_blocks_have_the_bits_of_single_counters(purpose: int, first: int) -> None:
    """Blocks made with vector instructions against one index after another, across the counter's second word too."""
    (bits, deviates), k, single = random.scratch(), key(7, 4), np.empty((2, BLOCK))
    for step in range(60):
        begin = first + BLOCK * step
        random.normals(deviates, bits, purpose, begin, np.uint64(step), k[0], k[1])
        one_by_one(single, purpose, begin, np.uint64(step), k[0], k[1])
        assert np.array_equal(deviates, single)


@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK + 1, 32 * BLOCK, 33 * BLOCK + 3])
def test_every_length_has_the_same_numbers(count: int) -> None:
    """Arrays that end within a block, or begin another turn of the parallel loop: the first numbers of a longer array."""
    k, whole, part = key(1, 2), np.empty(64 * BLOCK), np.empty(count)
    for out in (whole, part):
        uniforms(out, POSITIONS, np.uint64(3), k[0], k[1])
    assert np.array_equal(part, whole[:count])
    assert np.array_equal(normals(count, step=2), normals(64 * BLOCK, step=2)[:count])


def test_layers_have_equal_areas() -> None:
    """256 of them under exp(-x²/2), x > 0: rectangles, of which the lowest is as wide as its tail makes it."""
    x = random._WIDTH
    areas = x[1:-1] * (np.exp(-(x[2:] ** 2) / 2) - np.exp(-(x[1:-1] ** 2) / 2))
    lowest = TAIL * math.exp(-(TAIL**2) / 2) + math.sqrt(2 * math.pi) * stats.norm.sf(TAIL)
    assert x.size == 257
    assert (np.diff(x) < 0).all()
    assert np.abs(areas / lowest - 1).max() < 1e-12
    assert x[0] * math.exp(-(TAIL**2) / 2) == pytest.approx(lowest, rel=1e-14, abs=0)


def test_normal_deviates() -> None:
    """Kolmogorov and Smirnov, moments to order 8, and the tail that has its own branch."""
    sample = normals(500_000).ravel()
    assert stats.kstest(sample, "norm").pvalue > 1e-3
    for order, expected in enumerate((0, 1, 0, 3, 0, 15, 0, 105), start=1):
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
    k, start = key(5, 0), np.empty((200_000, 2))
    standard_normals(start, VELOCITIES, np.uint64(0), k[0], k[1])
    others.append(start[:, 0])
    for other in others:
        assert abs(np.corrcoef(base[:, 0], other)[0, 1]) < 4 / np.sqrt(200_000)
        assert abs(np.corrcoef(base[:, 0] ** 2, other**2)[0, 1]) < 4 / np.sqrt(200_000)


def test_keys_differ() -> None:
    """(seed, replica) are not added up: (1, 2) is not (2, 1), nor (3, 0)."""
    keys = {tuple(int(word) for word in key(seed, replica)) for seed in range(60) for replica in range(60)}
    assert len(keys) == 3600
    assert max(max(words) for words in keys) <= MASK


def test_uniform_numbers_and_threads() -> None:
    k, threads = key(1, 2), numba.get_num_threads()
    found = []
    try:
        for count in (1, 2):
            numba.set_num_threads(count)
            x = np.empty(1_000_001)
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
