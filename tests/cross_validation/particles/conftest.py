"""For tests of particles: as many threads as a test sets, however few particles there are (tests/conftest.py sets one)."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _threads_for_few_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("particles.threads.SECONDS_OF_A_PARTICLE", 1.0)
