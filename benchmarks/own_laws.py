"""Operator (12) written anew as a law of one's own (docs/extending.md), beside the built-in one: same numbers, and the times.

    python -m benchmarks.own_laws

On velocity points and as particles, half a minute on one core. Asserts the numbers, to 1e-12 of max f on the grid and to the last
bit as particles, and that the law from outside takes at most twice the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.timing import best
from kinetic_solver import PairLaw, Scene, solve
from particles import simulate

REPEATS = 5
AT_MOST = 2.0
"""Times of the built-in law: what writing one's own may cost."""


@dataclass(frozen=True)
class Twelve(PairLaw):
    """Operator (12): a pair keeps its momentum, and ε of its relative velocity."""

    cross_section: float
    restitution: float
    conserves = ("mass", "momentum")

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.5 * (1 - numbers[1]) * r, 0.5 * (1 + numbers[1]) * r


def main() -> None:
    common: dict[str, Any] = {
        "pipe": {"length": 12.0},
        "initial": {"mean_velocity": 0.0, "temperature": 0.9, "modes": [{"mode": 1, "cos": 0.3}]},
        "run": {"end_time": 1.0, "output_every": 0.5},
        "grid": {"velocity": "points"},
        "particles": {"count": 200_000, "replicas": 1},
    }
    inside = Scene.model_validate({**common, "collisions": {"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}})
    outside, law = Scene.model_validate(common), Twelve(0.9, 0.6)

    ours, theirs = solve(inside), solve(outside, operator=law)
    grids = inside.grid.model_copy(update={"nx": 33, "nv": 96, "velocity_window": (-6.0, 8.0)})
    fixed = [scene.model_copy(update={"grid": grids}) for scene in (inside, outside)]
    a, b = solve(fixed[0]), solve(fixed[1], operator=law)
    assert float(abs(a["f"] - b["f"]).max() / a["f"].max()) < 1e-12
    assert simulate(inside).equals(simulate(outside, operator=law))

    print("| | built-in | written anew | ratio |\n|---|---|---|---|")
    for name, one, other in (
        ("grid", lambda: solve(fixed[0]), lambda: solve(fixed[1], operator=law)),
        (f"grid of its own choice, {ours.sizes['v']} and {theirs.sizes['v']} velocities", lambda: solve(inside),
         lambda: solve(outside, operator=law)),
        ("particles", lambda: simulate(inside), lambda: simulate(outside, operator=law)),
    ):  # fmt: skip
        pairs = [(best(one, 1), best(other, 1)) for _ in range(REPEATS)]  # in turn: the machine's other work hits both
        built_in, anew = (min(times) for times in zip(*pairs, strict=True))
        print(f"| {name} | {built_in:.3f} s | {anew:.3f} s | {anew / built_in:.2f} |", flush=True)
        assert anew < AT_MOST * built_in


if __name__ == "__main__":
    main()
