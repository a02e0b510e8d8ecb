"""When loops are compiled: a run says so, once, and does not take it for its own time.

numba compiles a loop when it is first called, for a second or more, and keeps it for later processes; those that find it compile
nothing. Modules with loops call `watch` before the first of them can be called.
"""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

LINE = "compiling loops for this machine"


class Turn(Protocol):
    """As multiprocessing's locks are."""

    def acquire(self, block: bool) -> bool: ...


class _Watch:
    """What numba has said so far. It compiles under a lock: one thread at a time."""

    def __init__(self) -> None:
        self.aloud = False
        self.turn: Turn | None = None
        """Of several processes that listen, whose it is to speak; None of one alone."""
        self.depth = 0
        self.since = self.spent = 0.0

    def compiles(self) -> None:
        if self.aloud:
            self.aloud = False
            if self.turn is None or self.turn.acquire(block=False):
                with suppress(OSError):  # nobody reads any more: no reason to stop a run
                    print(LINE, file=sys.stderr)
        self.began()

    def began(self) -> None:
        if self.depth == 0:
            self.since = time.monotonic()
        self.depth += 1

    def ended(self) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.spent += time.monotonic() - self.since


_watch = _Watch()


@functools.cache
def watch() -> None:
    """Listen to numba's compiler, from now on."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, _: object) -> None:
            _watch.compiles()

        def on_end(self, _: object) -> None:
            _watch.ended()

    listener = Listener()
    # The first is of a function as a whole, the second of a pass over any function, a generalised ufunc among them.
    for kind in ("numba:compile", "numba:run_pass"):
        event.register(kind, listener)


@contextmanager
def getting_ready() -> Iterator[None]:
    """A context in which a kernel is made: compiled, which is said, or loaded, which is not. Its time is not a run's either."""
    _watch.began()
    try:
        yield
    finally:
        _watch.ended()


@contextmanager
def announcing() -> Iterator[None]:
    """A context in which the first compilation, if there is one, is said on stderr."""
    before, _watch.aloud = _watch.aloud, True
    try:
        yield
    finally:
        _watch.aloud = before


def announce_from_now_on(turn: Turn) -> None:
    """Likewise in all of this process, which is one of several: the first of them that compiles takes `turn`, and says it."""
    _watch.aloud, _watch.turn = True, turn


def monotonic() -> float:
    """Seconds of time.monotonic, without those in which loops were compiled or loaded."""
    return time.monotonic() - _watch.spent
