"""docs/starts.md: every block runs, one after the other, in the order of the page."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "starts.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_every_block_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (scene,) = blocks("toml")
    Path("scene.toml").write_text(scene, encoding="utf-8")
    codes, names = blocks("python"), {}
    assert len(codes) >= 6
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        for code in codes:
            exec(compile(code, str(PAGE), "exec"), names)
