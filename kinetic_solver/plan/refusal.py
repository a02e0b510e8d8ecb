"""Refusals that say what would mend them: of the keys that a plan depends on, those that were tried and do.

Whatever a plan cannot meet is raised as `Refused`, with what is wrong and which keys might mend it. `explained` moves each of
these keys, alone, until a plan can be made that does not take long, and says how far. Test: tests/contracts/test_refusals.py.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from kinetic_solver import initial
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene

ARITHMETIC = (OverflowError, ZeroDivisionError, FloatingPointError)
"""What numbers raise that no double holds."""
NEAR = tuple(2.0**n for n in (1, 2, 4, 8, 16))
"""Factors by which a key is moved at first."""
FAR = tuple(2.0**n for n in range(32, 321, 32))
"""Further ones, up to 1e96, that are tried where they bring an extreme number nearer to 1."""
MOST_TRIED, PATIENCE = 60, 0.6
"""Scenes that a refusal tries, and seconds of the processor that it takes for them. Chosen: who waits for a refusal waits in
vain."""
EXTREME = 1e9
"""Numbers beyond it, or below one over it, are tried first. Chosen."""
COARSE = {"grid.nx": 101, "grid.nv": 128}
"""What else is tried: such a grid, given, whatever its accuracy."""
CLOSE = 1.2
"""How near the least change that helps is to be found, as a factor. Chosen."""
ENOUGH = 3
"""Keys that are named, of those that help. Chosen: with more a line is long, and a refusal slow."""


@dataclass(frozen=True)
class Remedy:
    """A key of a scene that may mend a refusal, moved up or down."""

    key: str
    way: Literal["more", "less"]


MORE_RTOL = Remedy("accuracy.rtol", "more")


class Refused(SceneError):
    """What is wrong with a scene, in words, the keys that may mend it, and what else would, also in words."""

    def __init__(self, problem: str, remedies: Sequence[Remedy] = (), besides: Sequence[str] = ()) -> None:
        super().__init__(problem)
        self.remedies, self.besides = tuple(remedies), tuple(besides)


OUT_OF_RANGE = (
    Remedy("initial.temperature", "more"),
    Remedy("initial.temperature", "less"),
    Remedy("collisions.cross_section", "less"),
    Remedy("run.end_time", "less"),
    Remedy("model.noise", "less"),
    Remedy("model.noise", "more"),
    Remedy("model.friction", "less"),
    Remedy("model.friction", "more"),
    Remedy("model.gravity", "less"),
    Remedy("initial.mean_velocity", "less"),
    Remedy("pipe.length", "less"),
    Remedy("pipe.length", "more"),
    Remedy("initial.density", "less"),
    MORE_RTOL,
)
"""All keys on which the size of a plan depends, in the order in which they are tried."""


def out_of_range(scene: Scene, error: Exception) -> Refused:
    """The refusal of numbers that no double holds."""
    groups = scene.groups
    return Refused(
        f"the scene's numbers are out of range ({error}): R* = {groups.collision_number:.3g}, L* = {groups.length:.3g}, "
        f"run.end_time = {scene.run.end_time:.3g}",
        OUT_OF_RANGE,
    )


def explained(scene: Scene, refused: Refused, works: Callable[[Scene], bool]) -> SceneError:
    """The refusal with its remedies: each was tried on the scene, and `works`."""
    allowed: list[str] = []
    left, until = itertools.count(MOST_TRIED, -1), time.process_time() + PATIENCE

    def counted(changed: Scene) -> bool:
        return next(left) > 0 and time.process_time() < until and works(changed)

    # Whatever the cause was thought to be, any key is better than none.
    others = [remedy for remedy in OUT_OF_RANGE if remedy not in refused.remedies]
    for remedy in (*_extremes_first(scene, refused.remedies), *_extremes_first(scene, others)):
        if len(allowed) == ENOUGH or (allowed and remedy in others):
            break
        if (value := _least_change(scene, remedy, counted)) is not None:
            keys = _together(scene, remedy, value)
            or_so = "nearer to 0" if value < 0 and remedy.way == "less" else remedy.way
            allowed.append(f"{' and '.join(keys)} = {value:.2g} or {or_so}")
    allowed += refused.besides
    with contextlib.suppress(SceneError, *ARITHMETIC):
        if not allowed and works(scene.replace(**COARSE)):
            allowed = [f"a given {' and '.join(COARSE)}"]
    return SceneError(f"{refused}; allowed: {', or '.join(allowed)}" if allowed else f"{refused}; no one key alone mends it")


def _extremes_first(scene: Scene, remedies: Sequence[Remedy]) -> list[Remedy]:
    """Those first that bring an extreme number nearer to 1: it is likely to be the one that is meant."""

    def usual(remedy: Remedy) -> bool:
        value = abs(_value(scene, remedy.key) or 1.0)
        return not (value > EXTREME if remedy.way == "less" else value < 1 / EXTREME)

    return sorted(remedies, key=usual)


def moved(scene: Scene, remedy: Remedy, value: float) -> Scene:
    """The scene with that value of a remedy's key, and with the frames that it then needs. Raises SceneError."""
    whole = isinstance(_given(scene, remedy.key), int)
    return scene.replace(**dict.fromkeys(_together(scene, remedy, value), int(value) if whole else value))


def _together(scene: Scene, remedy: Remedy, value: float) -> list[str]:
    """The key, and run.end_time where it must not be less than that, or run.output_every where it must not be more."""
    keys = [remedy.key]
    if remedy.key == "run.output_every" and value > scene.run.end_time:
        keys.append("run.end_time")
    return keys


def _least_change(scene: Scene, remedy: Remedy, works: Callable[[Scene], bool]) -> float | None:
    """The least change of a key, about, with which it works; None where none was found."""
    start = _value(scene, remedy.key)
    if not start:
        return None

    def tried(value: float) -> bool:
        # What is written is what is tried: two digits, rounded away from what does not work.
        with contextlib.suppress(SceneError, *ARITHMETIC):
            return works(moved(scene, remedy, value))
        return False

    failed, up = [1.0], remedy.way == "more"
    for factor in _factors(scene, remedy, abs(start)):
        value = _rounded(start * (factor if up else 1 / factor), up)
        if tried(value):
            good, fails = factor, max(less for less in failed if less < factor)
            while good > CLOSE * fails:
                middle = math.sqrt(good * fails)
                if tried(between := _rounded(start * (middle if up else 1 / middle), up)):
                    good, value = middle, between
                else:
                    fails = middle
            return value
        failed.append(factor)
    return None


def _factors(scene: Scene, remedy: Remedy, start: float) -> Iterator[float]:
    most = 0.1 / start if remedy.key == "accuracy.rtol" else math.inf
    extreme = max(start, 1 / start) if (start > 1) == (remedy.way == "less") else 1.0
    if extreme > EXTREME and most == math.inf:
        yield extreme  # whether it is this key at all
    yield from (factor for factor in NEAR if factor < most)
    if 1.0 < most < math.inf:
        yield most
    else:
        yield from (factor for factor in FAR if factor < extreme)
        if 1.0 < extreme <= EXTREME:
            yield extreme


def _value(scene: Scene, key: str) -> float | None:
    """A key's value, or what stands in for it; None where there is none that could be moved."""
    value = _given(scene, key)
    if key == "run.output_every":
        return scene.output_every
    if value is None and key in ("initial.temperature", "initial.mean_velocity") and not scene.initial.beams:
        with contextlib.suppress(SceneError, *ARITHMETIC):
            mean, temperature = initial.start_state(scene)
            return temperature if key == "initial.temperature" else mean
    return float(value) if isinstance(value, float | int) else None


def _given(scene: Scene, key: str) -> Any:
    """What a scene says of a dotted key; None where it has no such table."""
    value: Any = scene
    for name in key.split("."):
        value = getattr(value, name, None)
    return value


def _rounded(value: float, up: bool) -> float:
    """In two digits, of no less than the value, or of no more."""
    if value == 0 or not math.isfinite(value):
        return value
    digit = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    away = math.ceil if up == (value > 0) else math.floor
    return float(f"{away(round(value / digit, 6)) * digit:.2g}")
