"""How many threads a loop over particles takes: one where it is short."""

from __future__ import annotations

import numba
import pytest

from particles.threads import over_particles


def test_a_thread_for_each_200_000_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    """And no more than numba may have, and no more than there are blocks or cells."""
    monkeypatch.setattr(numba, "get_num_threads", lambda: 3)
    for count, rows, expected in ((399_999, 64, 1), (400_000, 64, 2), (600_000, 64, 3), (10**8, 64, 3), (10**8, 2, 2)):
        parts: list[slice] = []
        over_particles(parts.append, count, rows)
        assert len(parts) == expected
        assert sorted(i for part in parts for i in range(rows)[part]) == list(range(rows))
    parts = []
    over_particles(parts.append, 400_001)
    assert sorted((part.start, part.stop) for part in parts) == [(0, 200_000), (200_000, 400_001)]
