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
from kinetic_solver.compiling import watch
from particles.threads import over_particles

watch()

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


BLOCK = 128
"""Indices whose numbers are made together, in loops that the compiler turns into vector instructions: Philox then takes 0.9 ns an
index, and 13 ns one by one (one core of an AMD EPYC with 512-bit vectors). Blocks of 32 to 256 took the same."""


@numba.njit
def scratch():  # type: ignore[no-untyped-def]
    """(bits, deviates) for `normals` to work in, both (2, BLOCK)."""
    return np.empty((2, BLOCK), np.uint64), np.empty((2, BLOCK))


@numba.njit
def draw_bits(bits, purpose, first, step, k0, k1):  # type: ignore[no-untyped-def]
    """Fill `bits`, shape (2, n): two times 64 random bits of each of the n indices from `first` on, of their draw 0."""
    for j in range(bits.shape[1]):
        a, b, c, d = words(purpose, first + j, step, 0, k0, k1)
        bits[0, j] = (a << _WORD) | b
        bits[1, j] = (c << _WORD) | d


@numba.njit
def normals(deviates, bits, purpose, first, step, k0, k1):  # type: ignore[no-untyped-def]
    """Fill `deviates` with two standard normal deviates of each index from `first` on; all that `bits` held is lost.

    A deviate takes 64 bits; one in 67 takes further draws, the first of an index at 2, 4, … and the second at 3, 5, … of the same
    counter.
    """
    draw_bits(bits, purpose, first, step, k0, k1)
    for which in range(2):
        if _inside(deviates[which], bits[which]) > 0:
            _complete(deviates[which], bits[which], purpose, first, step, which, k0, k1)


@numba.njit(inline="always")
def _point(bits):  # type: ignore[no-untyped-def]
    """(layer, sign, fraction of the layer's width) from 64 bits."""
    sign = 1.0 - 2.0 * float((bits >> _BYTE) & np.uint64(1))
    return np.int64(bits & np.uint64(255)), sign, float(bits >> np.uint64(11)) * _UNIT_53


@numba.njit
def _inside(deviates, bits):  # type: ignore[no-untyped-def]
    """Deviates whose points are inside their layers' inner rectangles; NaN for the others, whose number is returned."""
    others = 0
    for j in range(bits.size):
        layer, sign, fraction = _point(bits[j])
        x = fraction * _WIDTH[layer]
        inside = x < _WIDTH[layer + 1]
        deviates[j] = sign * x if inside else np.nan
        others += not inside
    return others


@numba.njit
def _complete(deviates, bits, purpose, first, step, draw, k0, k1):  # type: ignore[no-untyped-def]
    """The deviates that `_inside` left."""
    for j in range(bits.size):
        if math.isnan(deviates[j]):
            layer, sign, fraction = _point(bits[j])
            deviates[j] = _outside(layer, sign, fraction, purpose, first + j, step, draw, k0, k1)


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


def standard_normals(out: Array, purpose: int, step: np.uint64, k0: np.uint64, k1: np.uint64, first: int = 0) -> None:
    """Fill `out`, shape (n, 2), with the two deviates of each of n indices from `first` on."""
    over_particles(lambda part: _standard_normals(out[part], purpose, first + part.start, step, k0, k1), len(out))


def uniforms(out: Array, purpose: int, step: np.uint64, k0: np.uint64, k1: np.uint64, first: int = 0) -> None:
    """Fill `out`, shape (n,), with a number in [0, 1) of 53 bits for each of n indices from `first` on."""
    over_particles(lambda part: _uniforms(out[part], purpose, first + part.start, step, k0, k1), len(out))


@numba.njit(nogil=True, cache=True)
def _standard_normals(out, purpose, start, step, k0, k1):  # type: ignore[no-untyped-def]
    bits, deviates = scratch()
    count = out.shape[0]
    for first in range(0, count, BLOCK):
        normals(deviates, bits, purpose, start + first, step, k0, k1)
        for i in range(first, min(first + BLOCK, count)):
            out[i, 0], out[i, 1] = deviates[0, i - first], deviates[1, i - first]


@numba.njit(nogil=True, cache=True)
def _uniforms(out, purpose, start, step, k0, k1):  # type: ignore[no-untyped-def]
    bits, _ = scratch()
    for first in range(0, out.size, BLOCK):
        draw_bits(bits, purpose, start + first, step, k0, k1)
        for i in range(first, min(first + BLOCK, out.size)):
            out[i] = float(bits[0, i - first] >> np.uint64(11)) * _UNIT_53
