"""How many threads the linear algebra takes."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

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


@functools.cache
def _controller() -> Any:
    # Looking for the loaded libraries takes milliseconds, so it is done once; NumPy's and SciPy's BLAS are among them by then.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
