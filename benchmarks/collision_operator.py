"""The collision operators: time against a plain NumPy double loop over velocities, and against what the machine can do.

Checks that fast and slow agree to round-off before it times them. One core, then all.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", str(os.cpu_count()))

import sys
import time

import numba
import numpy as np

from benchmarks.timing import best
from kinetic_solver.operators.collisions import POINTS, FollowLeader, Inelastic

NX, NV, RESTITUTION, S = 64, 256, 0.5, 1.0


def double_loop(f: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Operator (12) with the linear deposit, one pair of velocities at a time, vectorised over x; f is (nv, nx) here."""
    out = np.zeros_like(f)
    dv = v[1] - v[0]
    alpha = (1 - RESTITUTION) / 2
    for b in range(v.size):
        for a in range(b + 1, v.size):
            rate = S * dv * (v[a] - v[b]) * f[a] * f[b]
            shift = alpha * (a - b)
            o = int(shift)
            upper = shift - o
            out[b + o] += (1 - upper) * rate
            out[a - o] += (1 - upper) * rate
            if upper:
                out[b + o + 1] += upper * rate
                out[a - o - 1] += upper * rate
            out[a] -= rate
            out[b] -= rate
    return out


@numba.njit
def axpy(c: np.ndarray, p: np.ndarray, w: float, repeats: int) -> None:
    for _ in range(repeats):
        for k in range(c.size):
            c[k] += w * p[k]


def machine() -> tuple[float, float, float]:
    """(matrix-multiplication GFlop/s, cache GB/s, memory GB/s) of one core."""
    a = np.random.default_rng(0).random((512, 512))
    gemm = 2 * 512**3 / best(lambda: a @ a) / 1e9
    c, p = np.zeros(256), np.ones(256)
    cache = 3 * 8 * 256 * 20_000 / best(lambda: axpy(c, p, 1e-9, 20_000)) / 1e9
    c, p = np.zeros(8_000_000), np.ones(8_000_000)
    memory = 3 * 8 * c.size / best(lambda: axpy(c, p, 1e-9, 1)) / 1e9
    return gemm, cache, memory


def main() -> int:
    v = -8 + 16 / NV * (np.arange(NV) + 0.5)
    f = np.exp(-(v**2) / 2)[None] * np.linspace(0.5, 1.5, NX)[:, None]
    pairs = NX * NV * (NV - 1) / 2
    numba.set_num_threads(1)
    gemm, cache, memory = machine()
    print(
        f"one core: {gemm:.1f} GFlop/s in matrix products, {cache:.0f} GB/s from cache (c += w p), {memory:.1f} GB/s from memory"
    )

    began = time.perf_counter()
    Inelastic(v, S, RESTITUTION, "linear").rate(f)
    compiled = time.perf_counter() - began
    columns = np.ascontiguousarray(f.T)
    began = time.perf_counter()
    slow = double_loop(columns, v).T
    loop = time.perf_counter() - began
    fast = Inelastic(v, S, RESTITUTION, "linear").rate(f)
    difference = np.abs(fast - slow).max() / np.abs(slow).max()
    print(f"(12), {NX} × {NV}, linear deposit: NumPy double loop {loop * 1e3:.0f} ms; they differ by {difference:.1e} of max C")
    print(f"compilation, or reading it from numba's cache: {compiled:.2f} s, not counted below")
    failed = difference > 1e-13

    print(
        "deposit     1 core, ms  double loop/this  flops/pair  GFlop/s  of products    B/pair     GB/s  of cache  all cores, ms"
    )
    for deposit, points in POINTS.items():
        operator = Inelastic(v, S, RESTITUTION, deposit)
        numba.set_num_threads(1)
        one = best(lambda operator=operator: operator.rate(f))
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
        every = best(lambda operator=operator: operator.rate(f))
        flops = 2 + 2 * 2 * points  # the pair's rate; two gains of `points` multiplications and additions
        traffic = 8 * (3 + 2 * (points + 2))  # two loads and a store; per gain the points, and c read and written
        print(
            f"{deposit:<10} {one * 1e3:10.2f} {loop / one:14.0f} {flops:15} {flops * pairs / one / 1e9:11.1f}"
            f" {flops * pairs / one / 1e9 / gemm:14.0%} {traffic:14} {traffic * pairs / one / 1e9:8.0f}"
            f" {traffic * pairs / one / 1e9 / cache:8.0%} {every * 1e3:12.2f}"
        )
    numba.set_num_threads(1)
    follow = FollowLeader(v, S)
    one = best(lambda: follow(f, 0.1))
    per_point = one / (NX * NV) * 1e9
    print(f"(6) substep: {one * 1e3:.3f} ms, {per_point:.1f} ns a point, most of it one exponential")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
