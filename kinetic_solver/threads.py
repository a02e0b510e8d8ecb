"""How many threads linear algebra takes, and loops over rows of f or over particles."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock
from typing import Any, ParamSpec, TypeVar

SECONDS_OF_A_THREAD = 2e-3
"""Work that is worth a thread: to start and join one takes 0.1 ms, more where the cores are busy."""

P = ParamSpec("P")
R = TypeVar("R")


@contextmanager
def one_blas_thread(with_scipy: bool = True) -> Iterator[None]:
    """A context in which BLAS runs on one thread; numba's own threads are left alone.

    BLAS's threads wait busily for each other and for those of the loops: steps 30 times slower on two cores
    (docs/performance.md). It also makes results independent of the number of cores.

    The number of BLAS's threads is the process's: of several threads that are in such contexts the last one to leave sets it back
    (tests/faults/test_threads.py).

    SciPy has a BLAS of its own, which is loaded here so that it is among them. `with_scipy=False` is for what does without, and
    would wait a tenth of a second for it: if it is loaded it is among them all the same.
    """
    if with_scipy:
        import scipy.linalg  # noqa: F401
    _limits.enter()
    try:
        yield
    finally:
        _limits.leave()


class _Limits:
    """BLAS on one thread for as long as anybody is within."""

    def __init__(self) -> None:
        self._lock, self._within = Lock(), 0
        self._before: dict[str, tuple[Any, int]] = {}
        """By file: the library, and its number of threads when the first one came."""

    def enter(self) -> None:
        with self._lock:
            for library in _blas("scipy.linalg" in sys.modules):
                if library.filepath not in self._before:  # the first one within, or SciPy's has come since
                    self._before[library.filepath] = library, library.get_num_threads()
                    _set_threads(library, 1)
            self._within += 1

    def leave(self) -> None:
        with self._lock:
            self._within -= 1
            if self._within == 0:
                for library, count in self._before.values():
                    _set_threads(library, count)
                self._before.clear()


def _set_threads(library: Any, count: int) -> None:
    # Since its version 3.7 threadpoolctl lets one thread alone set OpenBLAS's number, and passes over the others in silence,
    # until that thread gives it free. Who comes first here need not be who leaves last.
    free = getattr(library, "clear_controlling_thread", None)
    if free is not None:
        free(force=True)
    library.set_num_threads(count)
    if free is not None:
        free(force=True)


_limits = _Limits()


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function, always on one BLAS thread: small matrices are slower on two, many times so where the cores are busy."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_blas_thread():
            return function(*args, **kwargs)

    return wrapped


@functools.cache
def _blas(with_scipy: bool) -> list[Any]:
    # Looking for the loaded libraries takes milliseconds, so it is done once, and again when SciPy's has come.
    from threadpoolctl import ThreadpoolController

    return [library for library in ThreadpoolController().lib_controllers if library.user_api == "blas"]


_alone = ContextVar("loops take one thread", default=False)


@contextmanager
def one_thread_of_loops() -> Iterator[None]:
    """A context in which loops, here and in what is called, take one thread: for one of many runs at a time."""
    before = _alone.set(True)
    try:
        yield
    finally:
        _alone.reset(before)


def over_rows(work: Callable[[slice], None], rows: int, seconds: float) -> None:
    """`work` on all rows, by parts in as many threads as numba may have, or fewer where it takes only so many seconds.

    `work` lets go of the interpreter's lock, as NumPy does, and what it makes of a row does not depend on the part it is in.
    """
    threads = 1 if _alone.get() else min(rows, int(seconds / SECONDS_OF_A_THREAD))
    if threads > 1:
        import numba

        threads = min(threads, numba.get_num_threads())
    if threads <= 1:
        return work(slice(0, rows))
    from concurrent.futures import ThreadPoolExecutor

    first, *others = (slice(part * rows // threads, (part + 1) * rows // threads) for part in range(threads))
    # These threads last no longer than the call: a process that is forked later has no pool without its threads.
    with ThreadPoolExecutor(threads - 1) as pool:
        running = [pool.submit(work, part) for part in others]
        work(first)
        for done in running:
            done.result()
