"""How many threads linear algebra, loops over rows of f, and parallel loops take."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, ParamSpec, TypeVar

from kinetic_solver.errors import KineticError

SECONDS_OF_A_THREAD = 2e-3
"""Work that is worth a thread: to start and join one takes 0.1 ms, more where the cores are busy."""

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(with_scipy: bool = True) -> Any:
    """A context in which BLAS runs on one thread; numba's own threads are left alone.

    BLAS's threads wait busily for each other and for those of the loops: steps 30 times slower on two cores
    (docs/performance.md). It also makes results independent of the number of cores.

    SciPy has a BLAS of its own, which is loaded here so that it is among them. `with_scipy=False` is for what does without, and
    would wait a tenth of a second for it: if it is loaded it is among them all the same.
    """
    if with_scipy:
        import scipy.linalg  # noqa: F401
    return _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas")


def with_one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function, always on one BLAS thread: small matrices are slower on two, many times so where the cores are busy."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_blas_thread():
            return function(*args, **kwargs)

    return wrapped


_lost_threads = False


def _after_fork() -> None:
    global _lost_threads
    numba = sys.modules.get("numba")
    with suppress(ValueError):  # raised where no loop has run in parallel yet
        _lost_threads = _lost_threads or (numba is not None and numba.threading_layer() == "omp")


os.register_at_fork(after_in_child=_after_fork)


@contextmanager
def numba_threads(worth: int) -> Iterator[None]:
    """A context in which numba's loops take as many threads as they are worth, one or more, and no more than they would take.

    Threads wait for each other at the end of every loop: on cores that others use as well, for milliseconds. The results of the
    loops here are the same at any number.

    Raises KineticError in a process that was forked from one whose loops had run on GNU OpenMP, which would end it at the first.
    """
    import numba

    if _lost_threads:
        raise KineticError(
            "this process was forked from one that had used threads already, and GNU OpenMP does not survive that; allowed: "
            "processes started by spawn or forkserver, threads, or to fork before the first run"
        )
    allowed = numba.get_num_threads()
    numba.set_num_threads(max(1, min(allowed, worth)))
    try:
        yield
    finally:
        numba.set_num_threads(allowed)


@functools.cache
def _controller(with_scipy: bool) -> Any:
    # Looking for the loaded libraries takes milliseconds, so it is done once, and again when SciPy's has come.
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def over_rows(work: Callable[[slice], None], rows: int, seconds: float) -> None:
    """`work` on all rows, by parts in as many threads as numba may have, or fewer where it takes only so many seconds.

    `work` lets go of the interpreter's lock, as NumPy does, and what it makes of a row does not depend on the part it is in.
    """
    import numba

    threads = max(1, min(numba.get_num_threads(), rows, int(seconds / SECONDS_OF_A_THREAD)))
    if threads == 1:
        return work(slice(0, rows))
    from concurrent.futures import ThreadPoolExecutor

    # These threads last no longer than the call: a process that is forked later has no pool without its threads.
    with ThreadPoolExecutor(threads) as pool:
        parts = [slice(part * rows // threads, (part + 1) * rows // threads) for part in range(threads)]
        for done in [pool.submit(work, part) for part in parts]:
            done.result()
