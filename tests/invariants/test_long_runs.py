"""Runs of a hundred relaxation times: the beginning of what benchmarks/long_runs.py takes to ten thousand."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.long_runs import CASES, measured, problems

END = 100.0
"""In units of 1/γ."""


@pytest.mark.parametrize("case", [case for case, (method, *_) in CASES.items() if method != "exact"])
def test_a_long_run_stays_in_its_known_state(tmp_path: Path, case: str) -> None:
    found = measured(case, END, tmp_path / "run.nc")
    assert found["steps"] >= 200
    assert problems(case, found) == []
