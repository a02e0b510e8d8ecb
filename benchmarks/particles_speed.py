"""What a particle-step costs, after compilation, on one core and on all, against NumPy's normal deviates and memory.

    python -m benchmarks.particles_speed [count] [--against CHECKOUT]

Answers are checked: the variance of the velocities stays σ, the number of collisions is that of kinetic theory. With another
checkout of this repository, both are timed in turn, and must have the same particles, bit for bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numba
import numpy as np

from benchmarks.timing import best
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Model
from particles.collisions import collide
from particles.ensemble import Ensemble
from particles.langevin import LangevinStep
from particles.random import LANGEVIN, key, standard_normals

STEP = 0.02
LENGTH = 100.0
MODEL = Model(gravity=0.3, friction=1.0, noise=1.0)
ROUNDS = 5
"""Of two checkouts in turn."""

Case = tuple[str, int, Callable[[], object]]


class Steps:
    """An ensemble and what is timed on it."""

    def __init__(self, count: int) -> None:
        self.count, self.cells = count, max(1, count // 500)
        rng = np.random.default_rng(1)
        self.ensemble = Ensemble(rng.uniform(0, LENGTH, count), 0.3 + rng.normal(size=count), LENGTH, self.cells)
        self.key, self.step = key(1, 0), LangevinStep.over(MODEL, STEP)
        self.tally, self.number = np.zeros((self.cells, 2), dtype=np.int64), 0
        # One collision per particle and relaxation time: Sρ⟨|v - v'|⟩ = Sρ 2/√π = γ
        self.law = Inelastic(cross_section=math.sqrt(math.pi) / 2, restitution=0.9)
        self.rate = self.law.cross_section * LENGTH / count * STEP / (LENGTH / self.cells)
        self.deviates, self.copy = np.empty((count, 2)), np.empty((4, count))

    def draw(self) -> None:
        self.number += 1
        standard_normals(self.deviates, LANGEVIN, np.uint64(self.number), *self.key)

    def advance(self) -> None:
        self.number += 1
        self.ensemble.advance(self.step, self.number, self.key)

    def sort(self) -> None:
        self.number += 1
        self.ensemble.advance_and_sort(self.step, self.number, self.key)

    def collide(self) -> None:
        """After a sort."""
        ensemble = self.ensemble
        collide(ensemble.v, ensemble.starts, self.rate, self.law, self.number + 1, self.key, self.tally)
        self.sort()

    def move_memory(self) -> None:
        np.copyto(self.copy[2:], self.copy[:2])
        np.copyto(self.copy[:2], self.copy[2:])

    def cases(self) -> list[Case]:
        """(what, bytes a particle, one of it)."""
        generator = np.random.Generator(np.random.Philox(1))
        return [
            ("NumPy's Philox, two normal deviates", 16, lambda: generator.standard_normal(out=self.deviates)),
            ("two normal deviates", 16, self.draw),
            ("Langevin update", 32, self.advance),
            ("Langevin update and sort", 72, self.sort),
            ("the same with collisions", 80, self.collide),
            ("copy of x and v, both ways", 64, self.move_memory),
        ]

    def check(self) -> str:
        """Raises AssertionError where the particles are not those of kinetic theory."""
        assert abs(self.ensemble.v.var() - 1) < 0.1, self.ensemble.v.var()
        per_particle = 2 * self.tally[:, 1].sum() / self.count / STEP
        assert abs(per_particle - 1) < 0.1, per_particle
        each = self.tally[:, 0].sum() / self.tally[:, 1].sum()
        return f"collisions per particle and relaxation time: {per_particle:.3f}; candidates for each: {each:.1f}"


def table(count: int) -> None:
    steps = Steps(count)
    print(f"{count} particles, {steps.cells} cells, {count * 36 / 2**20:.0f} MiB")
    print("| | threads | ns a particle | million a second | bytes a particle | GB/s |")
    print("|---|---|---|---|---|---|")
    for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
        numba.set_num_threads(threads)
        steps.sort()
        for name, size, action in steps.cases():
            seconds = best(action)
            print(
                f"| {name} | {threads} | {1e9 * seconds / count:.1f} | {count / seconds / 1e6:.1f} | {size} |"
                f" {size * count / seconds / 1e9:.1f} |"
            )
    print(steps.check())


def timed(count: int) -> dict[str, object]:
    """One core: seconds of each case, and a digest of the particles afterwards."""
    numba.set_num_threads(1)
    steps = Steps(count)
    steps.sort()
    seconds = {name: best(action) for name, _, action in steps.cases()}
    steps.check()
    digest = hashlib.sha256(steps.ensemble.x.tobytes() + steps.ensemble.v.tobytes() + steps.deviates.tobytes()).hexdigest()
    return {"seconds": seconds, "digest": digest}


def in_turn(count: int, other: Path) -> None:
    """The same in this checkout and in the other, by turns; this very file in both."""
    here = Path(__file__).parents[1]
    found: dict[Path, list[dict[str, dict[str, float]]]] = {here: [], other: []}
    for _ in range(ROUNDS):
        for root, runs in found.items():
            command = [sys.executable, __file__, str(count), "--json"]
            done = subprocess.run(
                command, env=os.environ | {"PYTHONPATH": str(root)}, cwd=root, stdout=subprocess.PIPE, text=True, check=True
            )
            runs.append(json.loads(done.stdout))
    digests = {str(run["digest"]) for runs in found.values() for run in runs}
    assert len(digests) == 1, f"the particles differ: {digests}"
    print(f"{count} particles, one core, {ROUNDS} runs of each in turn; the same particles, bit for bit")
    print("| | here, million a second | there | here/there, median (least, most) |")
    print("|---|---|---|---|")
    for name in found[here][0]["seconds"]:
        ours, theirs = ([run["seconds"][name] for run in runs] for runs in found.values())
        ratios = sorted(b / a for a, b in zip(ours, theirs, strict=True))
        rates = [count / median(seconds) / 1e6 for seconds in (ours, theirs)]
        print(f"| {name} | {rates[0]:.1f} | {rates[1]:.1f} | {median(ratios):.2f} ({ratios[0]:.2f}, {ratios[-1]:.2f}) |")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("count", nargs="?", type=float, default=1e6)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--json", action="store_true", help="one core, for a comparison of two checkouts")
    given = parser.parse_args()
    if given.json:
        print(json.dumps(timed(int(given.count))))
    elif given.against is not None:
        in_turn(int(given.count), given.against.resolve())
    else:
        table(int(given.count))
    return 0


if __name__ == "__main__":
    sys.exit(main())
