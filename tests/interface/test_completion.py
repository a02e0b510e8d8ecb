"""A shell that completes a line, as after `kinetic-solver --install-completion`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kinetic_solver.cli.app import METHOD_NAMES
from kinetic_solver.methods import METHODS

CALL = "import sys; sys.argv[0] = 'kinetic-solver'; from kinetic_solver.cli import main; main()"


def shell(*arguments: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", CALL, *arguments], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("kinetic-solver an", ["animate"]),
        ("kinetic-solver s", ["sweep", "stability"]),
        ("kinetic-solver run --method ", ["grid", "exact", "particles", "hydrodynamics"]),
        ("kinetic-solver sweep --method h", ["hydrodynamics"]),
        ("kinetic-solver init --example c", ["closure", "cooling"]),
    ],
)
def test_words(line: str, expected: list[str]) -> None:
    words = line.split()
    place = len(words) if line.endswith(" ") else len(words) - 1
    found = shell(_KINETIC_SOLVER_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=str(place))
    assert found.split() == expected


def test_what_a_shell_is_told() -> None:
    """Which shell it is, is found from its processes; here it is named."""
    told = shell(_KINETIC_SOLVER_COMPLETE="source_bash")
    assert "complete -o default -F _kinetic_solver_completion kinetic-solver" in told


def test_the_names_of_methods() -> None:
    assert set(METHOD_NAMES) == METHODS.keys()


def test_completion_loads_nothing_heavy(tmp_path: Path) -> None:
    code = "import os\nos.environ.update(_KINETIC_SOLVER_COMPLETE='complete_bash', COMP_WORDS='kinetic-solver run --method ', "
    code += f"COMP_CWORD='3')\n{CALL.replace('; main()', '')}\ntry:\n    main()\nexcept SystemExit: pass\n"
    code += "print([name for name in ('numpy', 'numba', 'xarray', 'scipy', 'matplotlib') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
