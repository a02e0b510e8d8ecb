"""A small draw of benchmarks/kills.py: runs that are killed lose nothing, and go on to the bits of one that was not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.kills import SCENES

ROOT = Path(__file__).parents[2]
TRIALS = 2


@pytest.mark.parametrize("method", SCENES)
def test_killed_runs_lose_nothing(tmp_path: Path, method: str) -> None:
    command = [sys.executable, "-m", "benchmarks.kills", "--count", str(TRIALS), "--folder", str(tmp_path), "--method", method]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    found = [json.loads(line) for line in (tmp_path / f"{method}.jsonl").read_text().splitlines()]
    assert len(found) == TRIALS
    assert sum(len(one["kills"]) for one in found) > 0
