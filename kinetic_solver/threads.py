"""How many threads linear algebra and parallel loops take."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, ParamSpec, TypeVar

from kinetic_solver.errors import KineticError

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread() -> Any:
    """A context in which BLAS runs on one thread; numba's own threads are left alone.

    The parallel collision kernels leave OpenMP's threads spinning for a moment, and BLAS's threads, called next, would
    wait for the same cores: steps 30 times slower on two cores (docs/performance.md). It also makes results independent of
    the number of cores.
    """
    return _controller().limit(limits=1, user_api="blas")


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
def _controller() -> Any:
    # Looking for the loaded libraries takes milliseconds, so it is done once; NumPy's and SciPy's BLAS are among them by then.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
