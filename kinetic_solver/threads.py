"""How many threads the linear algebra takes."""

from __future__ import annotations

from typing import Any


def one_blas_thread() -> Any:
    """A context in which BLAS runs on one thread; numba's own threads are left alone.

    The parallel collision kernels leave OpenMP's threads spinning for a moment, and BLAS's threads, called next, would
    wait for the same cores: steps 30 times slower on two cores (docs/performance.md). It also makes results independent of
    the number of cores.
    """
    from threadpoolctl import threadpool_limits

    return threadpool_limits(limits=1, user_api="blas")
