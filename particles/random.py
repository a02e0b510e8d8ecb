"""Random numbers by counting: the same stream for any number of threads, and after a restart.

A number is a function of a key (seed, replica) and a counter (what it is for, which particle or cell, which step, which draw):
nothing is carried from one to the next. Philox4x32-10 (J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw 2011) makes 128
random bits of each counter; a normal deviate takes 64 of them by the ziggurat method (G. Marsaglia and W. W. Tsang 2000).
Tests: tests/cross_validation/particles/test_random.py, against the published known answers and the distributions' moments.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array

LANGEVIN, COLLISIONS, POSITIONS, VELOCITIES, OVERTAKINGS, PARTS = 0, 1, 2, 3, 4, 5
"""What numbers are for: the highest byte of the counter's last word, above the number of the draw."""

_MULTIPLY_0, _MULTIPLY_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_WORD, _BYTE = np.uint64(32), np.uint64(8)
_UNIT_53, _UNIT_32 = 2.0**-53, 2.0**-32


def key(seed: int, replica: int) -> NDArray[np.uint64]:
    """The two words of a replica's key: independent streams for every (seed, replica), by NumPy's SeedSequence."""
    return np.random.SeedSequence(seed, spawn_key=(replica,)).generate_state(2, np.uint32).astype(np.uint64)


@numba.njit(inline="always")
def philox(c0, c1, c2, c3, k0, k1):  # type: ignore[no-untyped-def]
    """Four random words of 32 bits from a counter of four and a key of two, all held in uint64."""
    for _ in range(10):
        first, second = _MULTIPLY_0 * c0, _MULTIPLY_1 * c2
        c0, c1, c2, c3 = (second >> _WORD) ^ c1 ^ k0, second & _LOW, (first >> _WORD) ^ c3 ^ k1, first & _LOW
        k0, k1 = (k0 + _WEYL_0) & _LOW, (k1 + _WEYL_1) & _LOW
    return c0, c1, c2, c3


@numba.njit(inline="always")
def words(purpose, index, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    """Four words for one draw of a particle or cell: 2^64 indices, 2^32 steps, 2^24 draws."""
    i = np.uint64(index)
    last = (np.uint64(purpose) << np.uint64(24)) | np.uint64(draw)
    return philox(i & _LOW, i >> _WORD, np.uint64(step), last, k0, k1)


@numba.njit(inline="always")
def unit(word):  # type: ignore[no-untyped-def]
    """A number in (0, 1) from 32 bits."""
    return (float(word) + 0.5) * _UNIT_32


def _ziggurat(layers: int = 256) -> tuple[Array, Array]:
    """(widths, heights) of the layers of equal area under exp(-x²/2); the lowest includes the tail beyond `TAIL`."""
    area = TAIL * math.exp(-(TAIL**2) / 2) + math.sqrt(math.pi / 2) * math.erfc(TAIL / math.sqrt(2))
    x = np.empty(layers + 1)
    x[0], x[1], x[layers] = area / math.exp(-(TAIL**2) / 2), TAIL, 0.0
    for n in range(2, layers):
        x[n] = math.sqrt(-2 * math.log(area / x[n - 1] + math.exp(-(x[n - 1] ** 2) / 2)))
    return x, np.exp(-(x**2) / 2)


TAIL = 3.6541528853610088
"""Where 256 layers of equal area end (Marsaglia and Tsang 2000)."""
_WIDTH, _HEIGHT = _ziggurat()


@numba.njit(inline="always")
def normal(high, low, purpose, index, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    """A standard normal deviate from 64 random bits; one in 80 takes further draws, at `draw` + 2, + 4, … of the same counter."""
    bits = (high << _WORD) | low
    layer = np.int64(bits & np.uint64(255))
    sign = 1.0 - 2.0 * float((bits >> _BYTE) & np.uint64(1))
    fraction = float(bits >> np.uint64(11)) * _UNIT_53
    if fraction * _WIDTH[layer] < _WIDTH[layer + 1]:
        return sign * fraction * _WIDTH[layer]
    return _outside(layer, sign, fraction, purpose, index, step, draw, k0, k1)


@numba.njit
def _outside(layer, sign, fraction, purpose, index, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    """Where the point is not inside its layer's inner rectangle: the tail, or the wedge, or another point."""
    while True:
        draw += 2
        a, b, c, d = words(purpose, index, step, draw, k0, k1)
        if layer == 0:
            x, y = -math.log(unit(a)) / TAIL, -math.log(unit(b))
            if 2 * y > x * x:
                return sign * (TAIL + x)
            continue
        x = fraction * _WIDTH[layer]
        if _HEIGHT[layer] + unit(a) * (_HEIGHT[layer + 1] - _HEIGHT[layer]) < math.exp(-x * x / 2):
            return sign * x
        layer = np.int64(b & np.uint64(255))
        sign = 1.0 - 2.0 * float((b >> _BYTE) & np.uint64(1))
        fraction = (float(c) + float(d >> np.uint64(11)) * 2.0**-21) * _UNIT_32
        if fraction * _WIDTH[layer] < _WIDTH[layer + 1]:
            return sign * fraction * _WIDTH[layer]


@numba.njit(parallel=True, cache=True)
def standard_normals(out, purpose, step, k0, k1):  # type: ignore[no-untyped-def]
    """Fill `out`, shape (n, 2), with the two deviates of each of n indices."""
    for i in numba.prange(out.shape[0]):
        a, b, c, d = words(purpose, i, step, 0, k0, k1)
        out[i, 0] = normal(a, b, purpose, i, step, 0, k0, k1)
        out[i, 1] = normal(c, d, purpose, i, step, 1, k0, k1)


@numba.njit(parallel=True, cache=True)
def uniforms(out, purpose, step, k0, k1):  # type: ignore[no-untyped-def]
    """Fill `out`, shape (n,), with numbers in [0, 1) of 53 bits."""
    for i in numba.prange(out.size):
        a, b, _, _ = words(purpose, i, step, 0, k0, k1)
        out[i] = float(((a << _WORD) | b) >> np.uint64(11)) * _UNIT_53
