"""How far a run is, told to a person: a bar on a terminal and in a notebook, elsewhere a plain line now and then.

Lines are records of the logger `kinetic_solver.progress`, at the level INFO; where nobody listens to it they go to stderr.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer
from typing import TypeAlias

from kinetic_solver.compiling import announcing, monotonic

Progress: TypeAlias = Callable[[float, float], None]
"""Called as progress(time, end time), in the scene's unit of time, or as progress(how many, of how many)."""

SECONDS_BETWEEN_LINES = 10.0
"""Seldom enough for the log of a long run."""
SECONDS_IN_SILENCE = 5.0
"""After which a person is told that a run is starting; what is refused is refused before, in one line. Chosen."""

log = logging.getLogger(__name__)


@contextmanager
def telling(progress: bool | Progress | None, unit: str = "t") -> Iterator[Progress | None]:
    """What a run calls as it goes: nothing (False), the given callable, or what tells a person on stderr (True).

    A person is told that the run is starting before there is anything to tell of it, and that loops are compiled. `unit`: the
    word before the numbers.
    """
    if progress is False or progress is None:
        yield None
    elif progress is not True:
        yield progress
    else:
        with announcing(), _telling_a_person(unit) as told:
            yield told


@contextmanager
def _telling_a_person(unit: str) -> Iterator[Progress]:
    if sys.stderr.isatty() or _in_notebook_with_widgets():
        with _bar(unit) as shown:
            yield shown
    else:
        with _heard():
            waiting = Timer(SECONDS_IN_SILENCE, lambda: log.info("starting"))
            waiting.daemon = True
            waiting.start()
            try:
                yield _lines(unit, waiting.cancel)
            finally:
                waiting.cancel()


def _in_notebook_with_widgets() -> bool:
    """Where rich can draw a bar in a notebook. Without ipywidgets it cannot; lines then."""
    if "ipykernel" not in sys.modules:
        return False
    from importlib.util import find_spec

    return find_spec("ipywidgets") is not None


@contextmanager
def _bar(unit: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task("starting", total=None)  # without a total the bar pulses
        yield lambda done, end: bar.update(task, total=1.0, completed=done / end, description=f"{unit} = {done:.4g}")


@contextmanager
def _heard() -> Iterator[None]:
    """Who has set up logging at INFO has the lines there; for all others they go to stderr."""
    if log.isEnabledFor(logging.INFO) and log.hasHandlers():
        yield
        return
    handler, before = logging.StreamHandler(), (log.level, log.propagate)
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(before[0])
        log.propagate = before[1]


def _lines(unit: str, begun: Callable[[], None]) -> Progress:
    """A line at most every `SECONDS_BETWEEN_LINES`, and one at the end. A run that goes back, to be refined, says "again".

    `begun` is called before each of them.
    """
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
            begun()
            # Until the first step is done there is nothing to tell from.
            left = f", {(now - began) / (time - since) * (end - time):.0f} s left" if time > since else ""
            log.info("%s = %.6g of %g%s%s", unit, time, end, again, left)

    return line
