"""How many threads a loop takes: one where it is short, and the same bits at any number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
import pytest

from kinetic_solver.laws import law_of
from kinetic_solver.operators.collisions import follow_leader, pairs
from kinetic_solver.threads import numba_threads
from particles.threads import threads_for


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


def bumps(nx: int, nv: int) -> tuple[np.ndarray, np.ndarray]:
    v = np.linspace(-6.0, 7.0, nv)
    return v, np.exp(-((v - 0.4) ** 2) / 1.7) * (1 + 0.3 * np.cos(np.arange(nx))[:, None])


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


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize(("nx", "nv", "taken"), [(75, 35, 1), (129, 96, 1), (255, 128, 2)])
def test_a_rate_of_12_of_less_than_a_millisecond_takes_one(monkeypatch: pytest.MonkeyPatch, nx: int, nv: int, taken: int) -> None:
    law = law_of("inelastic", 0.9, 0.6)
    assert law is not None
    seen, rate = [], pairs._rate

    def watched(*arguments: Any) -> Any:
        seen.append(numba.get_num_threads())
        return rate(*arguments)

    monkeypatch.setattr(pairs, "_rate", watched)
    v, f = bumps(nx, nv)
    operator = pairs.PairCollisions(v, law, "quintic")
    found = operator.rate(f)
    assert seen == [taken]
    with numba_threads(1):
        assert np.array_equal(operator.rate(f), found)
    assert numba.get_num_threads() == 2


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize(("nx", "taken"), [(75, 1), (8000, 2)])
def test_a_substep_of_6_likewise(monkeypatch: pytest.MonkeyPatch, nx: int, taken: int) -> None:
    seen, substep = [], follow_leader._substep

    def watched(*arguments: Any) -> Any:
        seen.append(numba.get_num_threads())
        return substep(*arguments)

    monkeypatch.setattr(follow_leader, "_substep", watched)
    v, f = bumps(nx, 64)
    found = follow_leader.FollowLeader(v, 0.7)(f, 0.05)
    assert seen == [taken]
    with numba_threads(1):
        assert np.array_equal(follow_leader.FollowLeader(v, 0.7)(f, 0.05), found)
