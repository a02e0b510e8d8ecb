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
    f: Array, scale: float, linear: NDArray[np.int64], linear_weights: Array, high: NDArray[np.int64], high_weights: Array
) -> Array:
    """∂f/∂t (nx, nv) of pairs m apart that collide at the rate scale·m f f'.

    `linear`, `high` (2, nv): the first points of the stencils of the slower and the faster particle, for each m, counted from the
    slower particle, and their `_weights` (2, nv, points); the linear ones are for pairs whose others would leave the window.
    """
    nx, nv = f.shape
    out, padded = np.empty((nx, nv)), np.zeros((nx, nv + 2 * (high_weights.shape[2] - 1)))
    source, kernel = np.ascontiguousarray(f), _kernel()

    def of(rows: slice) -> None:
        # What is not finite stops a run with a line of its own.
        with np.errstate(all="ignore"):
            kernel(source[rows], scale, linear, linear_weights, high, high_weights, padded[rows], out[rows])

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


@numba.njit(inline="always")
def _gain(c, p, w):  # type: ignore[no-untyped-def]
    """c_k += Σ_q w_q p_{k - q}, p padded with zeros, of stencils of 2, 4 and 6 points."""
    if w.size == 2:
        w0, w1 = w[0], w[1]
        for k in range(c.size):
            c[k] += w0 * p[k + 1] + w1 * p[k]
    elif w.size == 4:
        w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
        for k in range(c.size):
            c[k] += (w0 * p[k + 3] + w1 * p[k + 2]) + (w2 * p[k + 1] + w3 * p[k])
    else:
        w0, w1, w2, w3, w4, w5 = w[0], w[1], w[2], w[3], w[4], w[5]
        for k in range(c.size):
            c[k] += (w0 * p[k + 5] + w1 * p[k + 4]) + (w2 * p[k + 3] + w3 * p[k + 2]) + (w4 * p[k + 1] + w5 * p[k])


_TABLES = "int64[:,::1], float64[:,:,::1], int64[:,::1], float64[:,:,::1]"
_SIGNATURE = f"void(float64[::1], float64, {_TABLES}, float64[::1], float64[::1])"
_SHAPES = "(n),(),(s,n),(s,n,l),(s,n),(s,n,p),(z)->(n)"


@functools.cache
def _kernel() -> Any:
    """Of rows of f, for stencils of 2, 4 and 6 points: compiled when it is first asked for, 0.9 s.

    One kernel for all three. Three closures of one function would compile faster, 0.6 s for the one that is asked for, but numba
    gives the functions of two processes the same name in the cache, and a third process that loads both calls one for the other.
    """
    with getting_ready():
        return _made()


def _made() -> Any:
    @numba.guvectorize([_SIGNATURE], _SHAPES, nopython=True, cache=True, writable_args=("padded",))
    def row(f, scale, linear, linear_weights, high, high_weights, padded, c):  # type: ignore[no-untyped-def]
        """c, the rate of one row f; the first points of `padded` are zeros."""
        nv, pad = f.size, high_weights.shape[2] - 1
        _loss(c, f, scale)
        for m in range(1, nv):
            pairs = nv - m
            p = padded[pad : pad + pairs]
            _pair_rates(p, f[:pairs], f[m:], scale * m)
            # [begin, end): pairs whose stencils, which may overhang the pair on either side, stay inside the window
            slow, fast = high[0, m], high[1, m]
            begin = min(max(0, -slow, -fast), pairs)
            end = max(begin, pairs - max(0, slow + pad - m, fast + pad - m))
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
                    _gain(c[first : first + reached], padded[begin : begin + reached + pad], high_weights[particle, m])

    return row
