"""What a particle-step costs, after compilation, on one core and on all, against NumPy's normal deviates and memory.

    python -m benchmarks.particles_speed [count]

Answers are checked: the variance of the velocities stays σ, the number of collisions is that of kinetic theory.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numba
import numpy as np

from benchmarks.timing import best
from kinetic_solver.scene import Model
from particles.collisions import collide
from particles.ensemble import Ensemble
from particles.langevin import LangevinStep
from particles.random import LANGEVIN, key, standard_normals

STEP = 0.02
LENGTH = 100.0
MODEL = Model(gravity=0.3, friction=1.0, noise=1.0)


def main() -> int:
    count = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    cells = max(1, count // 500)
    rng = np.random.default_rng(1)
    ensemble = Ensemble(rng.uniform(0, LENGTH, count), 0.3 + rng.normal(size=count), LENGTH, cells)
    k, step = key(1, 0), LangevinStep.over(MODEL, STEP)
    deviates, tally = np.empty((count, 2)), np.zeros((cells, 2), dtype=np.int64)
    numpy_generator = np.random.Generator(np.random.Philox(1))
    # One collision per particle and relaxation time: Sρ⟨|v - v'|⟩ = Sρ 2/√π = γ
    rate = math.sqrt(math.pi) / 2 * LENGTH / count * STEP / (LENGTH / cells)
    number = 0

    def counted(action: Callable[[int], None]) -> Callable[[], None]:
        def once() -> None:
            nonlocal number
            number += 1
            action(number)

        return once

    def full(n: int) -> None:
        collide(ensemble.v, ensemble.starts, rate, 0.9, n, k, tally)
        ensemble.advance_and_sort(step, n, k)

    copy = np.empty((4, count))
    cases: list[tuple[str, int, Callable[[], None]]] = [
        ("NumPy's Philox, two normal deviates", 16, lambda: numpy_generator.standard_normal(out=deviates)),
        ("two normal deviates", 16, counted(lambda n: standard_normals(deviates, LANGEVIN, np.uint64(n), k[0], k[1]))),
        ("Langevin update", 32, counted(lambda n: ensemble.advance(step, n, k))),
        ("Langevin update and sort", 72, counted(lambda n: ensemble.advance_and_sort(step, n, k))),
        ("the same with collisions", 80, counted(full)),
        ("copy of x and v, both ways", 64, lambda: np.copyto(copy[2:], copy[:2]) or np.copyto(copy[:2], copy[2:])),
    ]
    print(f"{count} particles, {cells} cells, {ensemble.count * 36 / 2**20:.0f} MiB")
    print("| | threads | ns a particle | million a second | bytes a particle | GB/s |")
    print("|---|---|---|---|---|---|")
    for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
        numba.set_num_threads(threads)
        ensemble.advance_and_sort(step, 0, k)
        for name, size, action in cases:
            seconds = best(action)
            print(
                f"| {name} | {threads} | {1e9 * seconds / count:.1f} | {count / seconds / 1e6:.1f} | {size} |"
                f" {size * count / seconds / 1e9:.1f} |"
            )
    assert abs(ensemble.v.var() - 1) < 0.1, ensemble.v.var()
    per_particle = 2 * tally[:, 1].sum() / count / STEP
    assert abs(per_particle - 1) < 0.1, per_particle
    each = tally[:, 0].sum() / tally[:, 1].sum()
    print(f"collisions per particle and relaxation time: {per_particle:.3f}; candidates for each: {each:.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
