"""Every benchmark imports what the package still has."""

from __future__ import annotations

from importlib import import_module

import pytest

from benchmarks.__main__ import LONG, NAMES


@pytest.mark.parametrize("name", [*NAMES, *LONG])
def test_imports_and_can_be_run(name: str) -> None:
    assert callable(import_module(f"benchmarks.{name}").main)
