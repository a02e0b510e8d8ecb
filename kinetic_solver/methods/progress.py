"""How far a run is, told to a person: a bar on a terminal, elsewhere a plain line now and then."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeAlias

from kinetic_solver.compiling import monotonic

Progress: TypeAlias = Callable[[float, float], None]
"""Called as progress(time, end time), in the scene's unit of time."""

SECONDS_BETWEEN_LINES = 10.0
"""Seldom enough for the log of a long run."""


@contextmanager
def telling(progress: bool | Progress) -> Iterator[Progress | None]:
    """What a run calls as it goes: nothing (False), the given callable, or what tells a person on stderr (True)."""
    if progress is False:
        yield None
    elif progress is not True:
        yield progress
    elif sys.stderr.isatty():
        with _bar() as shown:
            yield shown
    else:
        yield _lines()


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("t = {task.fields[time]:.4g}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task("run", total=1.0, time=0.0)
        yield lambda time, end: bar.update(task, completed=time / end, time=time)


def _lines() -> Progress:
    """A line at most every `SECONDS_BETWEEN_LINES`, and one at the end. A run that goes back, to be refined, says "again"."""
    began = spoken = monotonic()
    since = last = 0.0
    again = ""

    def line(time: float, end: float) -> None:
        nonlocal began, spoken, since, last, again
        now = monotonic()
        if time < last:
            began, since, again = now, time, " again"
        last = time
        if now - spoken >= SECONDS_BETWEEN_LINES or time == end:
            spoken = now
            # Until the first step is done there is nothing to tell from.
            left = f", {(now - began) / (time - since) * (end - time):.0f} s left" if time > since else ""
            with suppress(OSError):  # nobody reads any more: no reason to stop a run
                print(f"t = {time:.6g} of {end:g}{again}{left}", file=sys.stderr)

    return line
