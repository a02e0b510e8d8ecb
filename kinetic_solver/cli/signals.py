"""Signals to a run: the one place that listens to them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinetic_solver.methods import Interruption

TO_STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU)
"""Write a checkpoint and stop: Ctrl-C, an end that somebody asks for, a terminal that is gone, processor time that is up."""
TO_KEEP = signal.SIGUSR1
"""Write a checkpoint and go on."""


@contextmanager
def listening(interruption: Interruption) -> Iterator[None]:
    """Signals become what is asked of a run. Before the run's first step there is nothing to keep: it stops at once, as it does
    at the second Ctrl-C. A signal that the process was started to ignore, as by nohup, stays ignored."""
    from kinetic_solver.errors import RunUnfinished

    def stop(number: int, _: Any) -> None:
        name = signal.Signals(number).name
        if not interruption.heeded:
            raise RunUnfinished(f"stopped by {name} at once, without a new checkpoint; run it again", name, kept=False)
        if interruption.stop is not None and number == signal.SIGINT:
            raise RunUnfinished(f"stopped by {name} at once, without a new checkpoint; resume it to go on", name)
        interruption.stop = interruption.stop or name

    def keep(*_: Any) -> None:
        interruption.keep = True

    before = {number: signal.getsignal(number) for number in (*TO_STOP, TO_KEEP)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, keep if number == TO_KEEP else stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
