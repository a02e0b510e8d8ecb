"""Every command that README and docs print is one: its name and its options exist. What they do is tested elsewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from kinetic_solver.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PRINTED = re.compile(r"(?:^|`)kinetic-solver ([^`\n]*)", re.MULTILINE)


def commands() -> list[tuple[str, str]]:
    return [(page.name, line.partition(" #")[0].strip()) for page in PAGES for line in PRINTED.findall(page.read_text("utf-8"))]


def complaint(line: str) -> str:
    """What the parser says against the command; empty if nothing. Optional parts stand in brackets, alternatives beside `|`."""
    words = shlex.split(re.sub(r"[\[\]…]", " ", line))
    words = [word.partition("|")[0] for word in words if word != "|"]
    group = typer.main.get_command(app)
    try:
        context = group.make_context("kinetic-solver", list(words), resilient_parsing=True)
        if words[0].startswith("-"):
            return ""
        name, command, rest = group.resolve_command(context, words)  # type: ignore[attr-defined]
        own = command.make_context(name, [], parent=context, resilient_parsing=True)
        own.resilient_parsing = False
        command.make_parser(own).parse_args(list(rest))
    except Exception as error:  # of click's, which typer may carry under another name
        return f"{type(error).__name__}: {error}"
    return ""


def test_there_are_commands() -> None:
    assert len(commands()) > 50


@pytest.mark.parametrize(("page", "line"), commands())
def test_it_is_a_command(page: str, line: str) -> None:
    assert complaint(line) == "", f"{page}: kinetic-solver {line}"


@pytest.mark.parametrize("line", ["solve scene.toml", "run scene.toml --turbo", "plot out.nc --times"])
def test_what_is_none_is_found(line: str) -> None:
    assert complaint(line) != ""
