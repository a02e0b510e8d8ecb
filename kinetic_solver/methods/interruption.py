"""What is asked of a run from outside while it goes, and who answers: after every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Any

from kinetic_solver.dataset import Checkpoint, NetCDFRecorder
from kinetic_solver.errors import RunUnfinished

SHARE = 20
"""At least so many times as long as it took to write the last checkpoint lie between two: they take a twentieth of a run's time
at most."""


@dataclass
class Interruption:
    """Set by a signal handler or another thread; a run looks at it after every step."""

    stop: str | None = None
    """Who wants the run to stop with a checkpoint: the name of a signal, say."""
    keep: bool = False
    """Whether it is to write a checkpoint and go on."""
    answer: Callable[[str], None] = lambda text: None
    """Is told, in a line, of a checkpoint that was asked for, and of a resumed run that finds none."""
    heeded: bool = False
    """True while a run looks here: from its first step to its last."""


PATIENCE = 5.0
"""Seconds that a stop waits for a state that is fit to be kept: schedulers kill half a minute after they have asked. Chosen."""


class Keeper:
    """Keeps the checkpoints of a run, and stops it where its time is over or somebody wants it."""

    def __init__(
        self,
        checkpoint: Checkpoint,
        recorder: NetCDFRecorder,
        max_walltime: float | None,
        interruption: Interruption,
        began: float,
    ) -> None:
        """`began`: the monotonic clock when the run began, from which `max_walltime` counts, in seconds."""
        self._checkpoint, self._recorder = checkpoint, recorder
        self._max_walltime, self._interruption, self._began = max_walltime, interruption, began
        self._last, self._took = began, 0.0
        self._refused: float | None = None
        """Since when a stop has been asked for, while the run had no state to keep."""

    def look(self, time: float, state: Callable[[], Any | None]) -> None:
        """After a step to this time. `state` makes the tree that a checkpoint holds, or None where the next step is to be asked.

        Raises RunUnfinished, the checkpoint written.
        """
        asked, now = self._interruption, monotonic()
        asked.heeded = True
        self._recorder.settle()
        late = self._max_walltime is not None and now - self._began > self._max_walltime
        stop = late or asked.stop is not None
        if not (stop or asked.keep or now - self._last >= SHARE * self._took):
            return
        found = state()
        reason = f"after {self._max_walltime:g} s" if asked.stop is None and late else f"by {asked.stop}"
        if found is None:
            self._refused = (self._refused or now) if stop else None
            if self._refused is not None and now - self._refused >= PATIENCE:
                self._recorder.sync()
                raise RunUnfinished(
                    f"stopped at t = {time:g} {reason}, looking for a grid that holds f; resumed, it goes on from the checkpoint "
                    "before, or begins again",
                    asked.stop,
                )
            return
        self._recorder.sync()  # a checkpoint speaks of the frames before it
        self._checkpoint.save(time, found)
        self._last = monotonic()
        self._took = self._last - now
        if asked.keep:
            asked.keep = False
            asked.answer(f"checkpoint written at t = {time:g}")
        if stop:
            raise RunUnfinished(f"stopped at t = {time:g} {reason}; resume it to go on", asked.stop)

    def look_before(self) -> None:
        """Before the first frame, where that is long in coming and there is nothing to keep. Raises RunUnfinished."""
        stop = self._interruption.stop
        if stop is not None:
            raise RunUnfinished(f"stopped by {stop} before the first frame, without a checkpoint; run it again", stop, kept=False)
        if self._max_walltime is not None and monotonic() - self._began > self._max_walltime:
            raise RunUnfinished(
                f"stopped after {self._max_walltime:g} s, before the first frame, without a checkpoint; "
                "run it again with more time",
                kept=False,
            )

    def finish(self) -> None:
        """The run has come to its end, and its file is complete."""
        self._interruption.heeded = False
        self._checkpoint.remove()
