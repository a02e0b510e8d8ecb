"""The sum over pairs of velocity points of pairs.py, compiled: a module of its own, so that other runs need not load numba.

One kernel for a row of f at a time, without a loop of its own over x: a numba kernel that is parallel itself takes three times as
long to compile, and its threads wait busily for each other. It is a generalised ufunc because arrays reach those without
reference counts, which slices in inner loops would pay for: the same kernel as a jitted function is half as fast.
"""

from __future__ import annotations

import functools
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.compiling import getting_ready, watch
from kinetic_solver.threads import over_rows

watch()

SECONDS_OF_A_PAIR = 0.75e-9
"""With the quintic deposit, one core of an AMD EPYC (python -m benchmarks.collision_operator)."""


def pair_rates(
    f: Array,
    scale: float,
    inside: NDArray[np.int64],
    linear: NDArray[np.int64],
    linear_weights: Array,
    high: NDArray[np.int64],
    high_weights: Array,
) -> Array:
    """∂f/∂t (nx, nv) of pairs m apart that collide at the rate scale·m f f'.

    `linear`, `high` (2, nv): the first points of the stencils of the slower and the faster particle, for each m, counted from the
    slower particle, and their `_weights` (2, nv, points). Of the pairs m apart, counted by their slower particles, those from
    `inside`[0, m] up to `inside`[1, m] take the high ones; those of the others would leave the window.
    """
    nx, nv = f.shape
    points = high_weights.shape[2]
    out, padded = np.empty((nx, nv)), np.zeros((nx, nv + 2 * (points - 1)))
    source, kernel = np.ascontiguousarray(f), _kernel(points)

    def of(rows: slice) -> None:
        # What is not finite stops a run with a line of its own.
        with np.errstate(all="ignore"):
            kernel(source[rows], scale, inside, linear, linear_weights, high, high_weights, padded[rows], out[rows])

    over_rows(of, nx, nx * nv * (nv - 1) / 2 * SECONDS_OF_A_PAIR)
    return out


# The loops below take slices, not offsets: so the compiler knows that no index is negative, and vectorises them.


@numba.njit(inline="always")
def _loss(c, f, scale):  # type: ignore[no-untyped-def]
    """c = -scale f_k Σ_j f_j |k - j|, by running sums."""
    total = 0.0
    distance = 0.0
    for k in range(f.size):
        c[k] = distance
        total += f[k]
        distance += total
    total = 0.0
    distance = 0.0
    for k in range(f.size - 1, -1, -1):
        c[k] = -scale * f[k] * (c[k] + distance)
        total += f[k]
        distance += total


@numba.njit(inline="always")
def _pair_rates(p, slower, faster, scale):  # type: ignore[no-untyped-def]
    for j in range(p.size):
        p[j] = scale * slower[j] * faster[j]


# c_k += Σ_q w_q p_{k - q}, p padded with zeros, of stencils of 2, 4 and 6 points.


@numba.njit(inline="always")
def _gain_of_2(c, p, w):  # type: ignore[no-untyped-def]
    w0, w1 = w[0], w[1]
    for k in range(c.size):
        c[k] += w0 * p[k + 1] + w1 * p[k]


@numba.njit(inline="always")
def _gain_of_4(c, p, w):  # type: ignore[no-untyped-def]
    w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
    for k in range(c.size):
        c[k] += (w0 * p[k + 3] + w1 * p[k + 2]) + (w2 * p[k + 1] + w3 * p[k])


@numba.njit(inline="always")
def _gain_of_6(c, p, w):  # type: ignore[no-untyped-def]
    w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
    for k in range(c.size):
        c[k] += (w0 * p[k + 5] + w1 * p[k + 4]) + (w2 * p[k + 3] + w3 * p[k + 2]) + (w4 * p[k + 1] + w5 * p[k])


_TABLES = "int64[:,::1], float64[:,:,::1]"
_SIGNATURE = f"void(float64[::1], float64, int64[:,::1], {_TABLES}, {_TABLES}, float64[::1], float64[::1])"
_SHAPES = "(n),(),(s,n),(s,n),(s,n,l),(s,n),(s,n,p),(z)->(n)"


@functools.cache
def _kernel(points: int) -> Any:
    """Of rows of f, for stencils of 2, 4 or 6 points: compiled when it is first asked for."""
    with getting_ready():
        return _made(points)


def _made(points: int) -> Any:
    def row(f, scale, inside, linear, linear_weights, high, high_weights, padded, c):  # type: ignore[no-untyped-def]
        """c, the rate of one row f; the first points of `padded` are zeros."""
        nv, pad = f.size, points - 1
        _loss(c, f, scale)
        for m in range(1, nv):
            pairs = nv - m
            p = padded[pad : pad + pairs]
            _pair_rates(p, f[:pairs], f[m:], scale * m)
            begin, end = inside[0, m], inside[1, m]
            outside = begin + pairs - end
            for q in range(2 if outside > 0 else 0):
                for particle in range(2):
                    place, w = linear[particle, m] + q, linear_weights[particle, m, q]
                    if w != 0.0:
                        for n in range(outside):
                            j = n if n < begin else n + end - begin
                            c[place + j] += w * p[j]
            for n in range(outside + pad):
                padded[pad + (n if n < begin else n + end - begin)] = 0.0
            if end > begin:
                reached = end - begin + pad
                for particle in range(2):
                    first = high[particle, m] + begin
                    deposited, reaching = c[first : first + reached], padded[begin : begin + reached + pad]
                    # `points` is a constant to the compiler, which drops the branches of the others.
                    if points == 2:
                        _gain_of_2(deposited, reaching, high_weights[particle, m])
                    elif points == 4:
                        _gain_of_4(deposited, reaching, high_weights[particle, m])
                    else:
                        _gain_of_6(deposited, reaching, high_weights[particle, m])

    # numba keeps compiled functions by their names, and one process may load two of these: each needs a name of its own.
    row.__name__ = row.__qualname__ = f"row_of_{points}_points"
    return numba.guvectorize([_SIGNATURE], _SHAPES, nopython=True, cache=True, writable_args=("padded",))(row)
