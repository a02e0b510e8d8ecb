"""How many threads a loop takes: one where it is short, and the same bits at any number."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import pytest

from kinetic_solver.threads import numba_threads
from particles.threads import threads_for


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
def test_as_many_as_they_are_worth_and_no_more_than_allowed() -> None:
    for worth, taken in ((0, 1), (1, 1), (2, 2), (50, 2)):
        with numba_threads(worth):
            assert numba.get_num_threads() == taken
        assert numba.get_num_threads() == 2
    with threads_for(399_999):
        assert numba.get_num_threads() == 1
    with threads_for(400_000):
        assert numba.get_num_threads() == 2
