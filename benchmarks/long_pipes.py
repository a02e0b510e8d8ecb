"""What a point costs where the pipe takes many of them: beyond nx = 500 f leaves the second-level cache. One core.

The linear step, its two transforms, the exact step of (6) in either gauge, and the rate of (12), in ns a point, as nx grows at
the same dx. Beside the linear step the same one in blocks of velocities that stay in the cache, each transformed, multiplied by
its phases and transformed back before the next: the answers must have the same bits. It is not what the solver does, since it
gains only where nv is a multiple of 64, whose rows lie at the same places of the cache.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import sys
import time
from collections.abc import Callable

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import Inelastic
from kinetic_solver.operators.collisions import PairCollisions
from kinetic_solver.operators.fourier import RealTransform
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.linearised import GridLinearisedStep
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model
from kinetic_solver.threads import one_blas_thread

H, DX = 0.5, 0.2
MODEL = Model(gravity=1.3, friction=0.7, noise=0.9)
BLOCK = 32
"""Velocities: 32 · nx · 16 bytes of spectrum, half a MiB at nx = 2000."""
GROWTH = 2.0
"""By which a point may cost more at the largest nx than at the least: transforms take log nx operations, 1.8 times as many."""
SIZES = (125, 375, 735, 1575, 3087)


def best(call: Callable[[], object], repeats: int = 9) -> float:
    """Seconds of the processor, which others on the machine take no part of: the least of `repeats` calls after the first."""
    call()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def in_blocks(step: LinearStep, f: Array) -> Array:
    table, (nx, nv) = step._tables.get(H, step._table), f.shape
    transform, waves = RealTransform(nx, BLOCK), nx // 2 + 1
    blocks = [slice(start, start + BLOCK) for start in (*range(0, nv - BLOCK, BLOCK), nv - BLOCK)]
    parts, out = np.empty((2 * waves, nv)), np.empty_like(f)
    for block in blocks:
        spectrum = transform.forward(f[:, block])
        spectrum *= table.before[:, block]
        parts[:waves, block], parts[waves:, block] = spectrum.real, spectrum.imag
    parts = parts @ table.kernel_t
    for block in blocks:
        spectrum.real, spectrum.imag = parts[:waves, block], parts[waves:, block]
        spectrum *= table.after[:, block]
        out[:, block] = transform.inverse()
    return out


def main() -> int:
    print("ns a point (nv, nx): MiB of f, linear step, in blocks, two transforms, (6) global gauge, local gauge, (12) quintic")
    failed = False
    for nv in (101, 128, 200):
        costs = []
        for nx in SIZES:
            grid = PhaseSpaceGrid(nx, nv, DX * nx, -8.0, 9.0)
            f = (1 + 0.3 * np.cos(grid.wavenumbers[1] * grid.x))[:, None] * np.exp(-((grid.v - 0.4) ** 2) / 1.8)
            kernel = OrnsteinUhlenbeckKernel(grid, MODEL)
            linear, transform = LinearStep(grid, MODEL, kernel), RealTransform(nx, nv)
            same = np.array_equal(in_blocks(linear, f), linear(f, H))
            one, local = (GridLinearisedStep(grid, MODEL, 1.1, kernel, tolerance) for tolerance in (1.0, 1e-30))
            lifted, held = one.lifted(f, 1.0), local.lift(f)
            pairs = PairCollisions(grid.v, Inelastic(1.1, 0.4), "quintic")
            found = [
                best(call) / f.size * 1e9
                for call in (
                    lambda linear=linear, f=f: linear(f, H),
                    lambda linear=linear, f=f: in_blocks(linear, f),
                    lambda t=transform, f=f: (t.forward(f), t.inverse()),
                    lambda one=one, lifted=lifted: one.lower(one.propagate(lifted, H)),
                    lambda local=local, held=held: local.propagate(held, H),
                    lambda pairs=pairs, f=f: pairs.rate(f),
                )
            ]
            costs.append(found)
            print(f"{nv:4} {nx:5} {f.nbytes / 2**20:6.2f} " + " ".join(f"{value:7.1f}" for value in found), flush=True)
            failed |= not same
        grown = max(last / first for n, (first, last) in enumerate(zip(costs[1], costs[-1], strict=True)) if n != 1)
        print(f"     from {SIZES[1]} to {SIZES[-1]} points: at most {grown:.1f} times as much a point")
        failed |= grown > GROWTH
    return int(failed)


if __name__ == "__main__":
    with one_blas_thread(with_scipy=False):
        sys.exit(main())
