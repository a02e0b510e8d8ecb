"""Runs of some hundred relaxation times, in steps of many: benchmarks/long_runs.py, which goes to ten thousand."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.long_runs import CASES, measured, problems

END = {"(6)": 300.0, "(12)": 100.0}
"""In units of 1/γ, by operator."""


@pytest.mark.parametrize("case", [case for case, (method, *_) in CASES.items() if method != "exact"])
def test_a_long_run_stays_in_its_known_state(tmp_path: Path, case: str) -> None:
    found = measured(case, END[case.split(",")[0]], tmp_path / "run.nc")
    assert found["steps"] >= 200
    assert problems(case, found) == []
