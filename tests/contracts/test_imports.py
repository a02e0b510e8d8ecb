"""Who may import whom (docs/design.md): nothing points back up, and the cross-checks share no numerics with the grid solver."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2] / "kinetic_solver"
LAYERS = [
    {"arrays", "threads"},
    {"scene"},
    {"stability", "fourier"},
    {"initial"},
    {"grid"},
    {"transport", "moments", "velocity", "collisions"},
    {"linear", "homogeneous", "stepping"},
    {"rules", "linearised", "frame"},
    {"plan", "regrid", "budgets"},
    {"monitor", "output", "representation", "estimate"},
    {"frames", "steppers"},
    {"run"},
    {"solver", "exact", "describe", "info", "plotting", "measured_rates", "compare"},
    {"certification", "snapshots"},
    {"cli"},
]
INDEPENDENT = {
    "exact": {"arrays", "scene", "initial", "homogeneous", "output", "grid"},
    "stability": {"scene", "arrays", "threads"},
}


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("kinetic_solver"):
            parts = node.module.split(".")
            found |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
    return found


def files(name: str) -> list[Path]:
    return sorted((ROOT / name).glob("*.py")) if (ROOT / name).is_dir() else [ROOT / f"{name}.py"]


def test_every_module_has_a_layer() -> None:
    names = {p.stem for p in ROOT.glob("*.py")} | {p.parent.name for p in ROOT.glob("*/__init__.py")}
    assert names - {"__init__", "__main__"} == set().union(*LAYERS)


@pytest.mark.parametrize("level", range(len(LAYERS)))
def test_imports_go_down_only(level: int) -> None:
    allowed = set().union(*LAYERS[: level + 1])
    for name in LAYERS[level]:
        for path in files(name):
            assert imports(path) <= allowed | {name}, path.name


@pytest.mark.parametrize("name", INDEPENDENT)
def test_cross_checks_are_independent(name: str) -> None:
    for path in files(name):
        assert imports(path) <= INDEPENDENT[name] | {name}


def test_the_particles_share_no_numerics_with_the_solver() -> None:
    allowed = {"arrays", "scene", "initial", "homogeneous", "output", "grid"}
    for path in (ROOT.parent / "particles").glob("*.py"):
        assert imports(path) <= allowed


def test_only_fourier_imports_pyfftw_and_only_output_writes_netcdf() -> None:
    for path in ROOT.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "import pyfftw" not in text or path.name == "fourier.py"
        assert "import netCDF4" not in text or path.name == "output.py"


def test_the_command_line_starts_without_heavy_packages() -> None:
    code = "import sys, kinetic_solver.cli; print([m for m in ('numpy', 'numba', 'xarray', 'scipy') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
