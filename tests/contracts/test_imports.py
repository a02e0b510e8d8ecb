"""Who may import whom (docs/design.md): no circles, independent cross-checks; short files; a start without heavy packages.

Imports count wherever they stand: at the top, inside a function, or for type checking alone.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("kinetic_solver", "particles")

BASE = {"arrays", "compiling", "errors", "interpolation", "machine", "progress", "rounding", "threads", "when_xarray_comes"}
LAWS = BASE | {"laws"}
SCENE = LAWS | {"scene"}
SHARED = SCENE | {"theory", "grid", "stability", "dataset", "initial"}
"""What both sides of a cross-check may share."""
ALL = SHARED | {"operators", "stepping", "exact", "hydrodynamics", "particles", "plan", "solver", "compare"}
ALLOWED: dict[str, set[str]] = {
    **dict.fromkeys(BASE, BASE),
    "laws": BASE,
    "scene": SCENE,
    "theory": SCENE,
    "grid": SCENE,
    "stability": SCENE | {"theory"},
    "dataset": SCENE | {"grid"},
    "initial": SCENE | {"theory", "grid", "stability", "dataset"},
    "operators": SCENE - {"machine"} | {"theory", "grid"},
    "stepping": {"arrays", "errors", "rounding"},
    "exact": SHARED,
    "hydrodynamics": SHARED,
    "particles": SHARED,
    "plan": SHARED | {"operators", "stepping"},
    "solver": SHARED | {"operators", "stepping", "plan"},
    "compare": SHARED | {"exact", "particles"},
    "analysis": ALL,
    "methods": SHARED | {"exact", "hydrodynamics", "particles", "plan", "solver"},
    "sweeps": ALL | {"analysis", "methods"},
    "cli": ALL | {"analysis", "methods", "sweeps"},
}
"""Folder (or module) → what it may import, beside itself. `particles` is the package beside kinetic_solver."""
OF_THE_GRID_SOLVER = {"operators", "stepping", "plan", "solver"}


def sources() -> list[Path]:
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in sources()}


def folder_of(module: str) -> str:
    """ "kinetic_solver.dataset.files" → "dataset"; "particles.plan" → "particles"; "kinetic_solver" itself → ""."""
    parts = module.split(".")
    return parts[0] if parts[0] == "particles" else (parts[1] if len(parts) > 1 else "")


@cache
def imports(module: str) -> frozenset[str]:
    """The modules of ours that a module names in an import, at whatever depth; relative imports are not used here."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & MODULES.keys()
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: a relative import"
            for alias in node.names:
                below = f"{node.module}.{alias.name}"
                found |= {below if below in MODULES else str(node.module)} & MODULES.keys()
    return frozenset(found - {module})


@cache
def folder_imports(folder: str) -> frozenset[str]:
    """The other folders that a folder imports itself. The package kinetic_solver looks its names up lazily, above all folders."""
    names = {folder_of(there) for here in MODULES if folder_of(here) == folder for there in imports(here)}
    return frozenset(names - {folder})


def reached(folder: str) -> set[str]:
    """All folders that an import of this one can load."""
    found: set[str] = set()
    ahead = [folder]
    while ahead:
        for there in folder_imports(ahead.pop()) - found:
            found.add(there)
            ahead.append(there)
    return found


FOLDERS = sorted({folder_of(module) for module in MODULES} - {"", "__main__"})


def test_every_folder_has_its_place() -> None:
    assert set(FOLDERS) == ALLOWED.keys()


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_imports_what_is_below_it(folder: str) -> None:
    assert folder_imports(folder) <= ALLOWED[folder]


def test_no_circle_between_folders() -> None:
    assert [folder for folder in FOLDERS if folder in reached(folder)] == []


def test_the_allowed_imports_make_no_circle() -> None:
    """The table above orders the folders: each is allowed only what is allowed nothing of it."""
    for folder, allowed in ALLOWED.items():
        for below in allowed - BASE - {folder}:
            assert folder not in ALLOWED[below], f"{folder} and {below} may import each other"


@pytest.mark.parametrize("folder", ["exact", "stability", "hydrodynamics", "particles", "theory", "initial", "dataset", "scene"])
def test_cross_checks_never_reach_the_grid_solver(folder: str) -> None:
    assert not reached(folder) & OF_THE_GRID_SOLVER


def test_the_two_packages_make_no_circle() -> None:
    """Only folders above the particles import them, and none of these is among what the particles reach."""
    assert {folder for folder in FOLDERS if "particles" in folder_imports(folder)} <= {"compare", "analysis", "methods", "cli"}


def test_steps_in_time_know_no_physics() -> None:
    assert reached("stepping") <= {"arrays", "errors", "rounding"}


def circles(modules: list[str]) -> Iterator[list[str]]:
    """Modules that import one another in a ring, one ring for each module from which there is a way back to it."""
    for start in modules:
        ways = [[start]]
        seen: set[str] = set()
        while ways:
            way = ways.pop()
            for there in imports(way[-1]):
                if there == start:
                    yield [*way, there]
                    ways.clear()
                    break
                if there in modules and there not in seen:
                    seen.add(there)
                    ways.append([*way, there])


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_circle_between_the_modules_of_a_folder(folder: str) -> None:
    """A package's __init__ collects names from its modules; they do not import it."""
    assert list(circles([module for module in MODULES if folder_of(module) == folder])) == []


# -- the shape of files


LONGEST = 300
"""Lines of a file: more than one concept fits in."""


def allowed_to_be_long() -> set[str]:
    """The list under the heading "Files over 300 lines" in docs/design.md."""
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    section = text.partition("\n## Files over 300 lines\n")[2].partition("\n## ")[0]
    return set(re.findall(r"^- `(\S+\.py)`", section, re.MULTILINE))


def test_no_file_is_longer_than_docs_design_says() -> None:
    """And none stays in that list that is no longer long."""
    long = {str(p.relative_to(ROOT)) for p in sources() if len(p.read_text(encoding="utf-8").splitlines()) > LONGEST}
    assert long == allowed_to_be_long()


def test_pyfftw_and_netcdf_have_one_place_each() -> None:
    """operators/fourier.py alone imports pyfftw; dataset/ alone writes netCDF, and opens it."""
    for module, path in MODULES.items():
        text = path.read_text(encoding="utf-8")
        assert "import pyfftw" not in text or module == "kinetic_solver.operators.fourier"
        if folder_of(module) != "dataset":
            for word in ("import netCDF4", ".to_netcdf(", "xr.open_dataset("):
                assert word not in text, f"{module}: {word}"


# -- start-up: what is not imported, rather than how long it takes

HEAVY = ("numpy", "numba", "xarray", "scipy", "matplotlib", "netCDF4", "pyfftw", "rich.progress", "particles")


def loaded(code: str) -> list[str]:
    code = f"import sys\n{code}\nprint([m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found: list[str] = ast.literal_eval(done.stderr.splitlines()[-1])
    return found


@pytest.mark.parametrize("module", ["kinetic_solver", "kinetic_solver.cli", "kinetic_solver.errors", "particles"])
def test_imports_load_nothing_heavy(module: str) -> None:
    assert loaded(f"import {module}") in ([], ["particles"])


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["--version"]], ids=" ".join)
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = f"sys.argv = ['kinetic-solver', *{arguments}]\ntry:\n    import kinetic_solver.__main__\nexcept SystemExit: pass"
    assert loaded(code) == []


@pytest.mark.parametrize("scene", ["pipe", "small", "kramers"])
def test_a_run_of_exact_steps_loads_neither_compiler_nor_scipy(scene: str, tmp_path: Path) -> None:
    """What (6) and no collisions need: arrays, their Fourier transforms, and files."""
    arguments = ["run", str(ROOT / "scenes" / f"{scene}.toml"), "-o", str(tmp_path / "run.nc"), "--set", "run.end_time=1.0"]
    code = f"sys.argv = ['kinetic-solver', *{arguments}]\ntry:\n    import kinetic_solver.__main__\nexcept SystemExit: pass"
    assert loaded(code) == ["numpy", "netCDF4", "pyfftw"]
    assert (tmp_path / "run.nc").exists()


def test_scipy_comes_whole_after_pyfftw() -> None:
    """fourier.py keeps pyfftw from loading scipy.fftpack, and nobody else."""
    code = "from kinetic_solver.operators.fourier import RealTransform\nRealTransform(8, 3)\nimport scipy.fftpack"
    assert loaded(f"{code}\nscipy.fftpack.fft([1.0, 2.0])") == ["numpy", "scipy", "pyfftw"]


def test_a_scene_is_checked_without_compilers_and_files() -> None:
    scene = "{'pipe': {'length': 1.0}, 'run': {'end_time': 1.0}}"
    assert loaded(f"from kinetic_solver import Scene; Scene.model_validate({scene})") == ["numpy"]
