"""Solve a scene."""

from __future__ import annotations

import sys
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

import typer

from kinetic_solver.cli.app import (
    METHOD_NAMES,
    Overrides,
    Overwrite,
    ScenePath,
    completes,
    exit_codes,
    load,
    print_rows,
    refuse_picture,
)

if TYPE_CHECKING:
    from kinetic_solver.scene import Scene


def run(
    scene: ScenePath,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Default: SCENE.nc.")] = None,
    method: Annotated[
        str,
        typer.Option(
            help="grid, exact (the closed form, where there is one), particles, or hydrodynamics (the paper's closure).",
            autocompletion=completes(*METHOD_NAMES),
        ),
    ] = "grid",
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    certified: Annotated[bool, typer.Option("--certify", help="Run again refined; add error bars and observed orders.")] = False,
    file_format: Annotated[
        str,
        typer.Option(
            "--format",
            help="classic, or netcdf4: compressed, once the run has finished.",
            autocompletion=completes("classic", "netcdf4"),
        ),
    ] = "classic",
    resume: Annotated[bool, typer.Option("--resume", help="Go on from where the run was stopped.")] = False,
    max_walltime: Annotated[
        float | None, typer.Option(metavar="S", help="Stop after S seconds with a checkpoint, to be resumed; exit code 3.")
    ] = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Say first what the run will use, and why.")] = False,
) -> None:
    """Solve a scene and write a netCDF file. SIGTERM and Ctrl-C stop it with a checkpoint, SIGUSR1 writes one."""
    with exit_codes():
        from kinetic_solver.cli.signals import listening
        from kinetic_solver.dataset import compress
        from kinetic_solver.errors import SceneError
        from kinetic_solver.methods import METHODS, Interruption, run_to_file

        refuse_picture(output, scene)
        if file_format not in ("classic", "netcdf4"):
            raise SceneError(f"--format {file_format}: allowed: classic or netcdf4")
        if quiet and verbose:
            raise SceneError("--quiet, --verbose: both are given; allowed: one of them")
        if quiet:
            warnings.simplefilter("ignore")
        loaded = load(scene, overrides)
        target = output or Path(scene.stem + ".nc")
        if certified and method != "grid" and method in METHODS:
            raise SceneError(f"--certify: is for --method grid; {method!r} has no discretisation to refine")
        if verbose:
            _tell_plan(loaded, method)
        asked = Interruption(answer=partial(_say, quiet, sys.stderr))
        with listening(asked):
            done = run_to_file(loaded, target, method, overwrite, resume, max_walltime, progress=not quiet, interruption=asked)
        _say(quiet, sys.stdout, *done.lines)
        if certified:
            _certify(loaded, target, quiet)
        if file_format == "netcdf4":
            compress(target)
        _say(quiet, sys.stdout, f"{target} is complete" if resume else f"wrote {target}")


def _say(quiet: bool, file: TextIO, *lines: str) -> None:
    for line in () if quiet else lines:
        print(line, file=file)


def _tell_plan(scene: Scene, method: str) -> None:
    from kinetic_solver.analysis.plans import rows_of_plan

    print_rows(rows_of_plan(scene, method))


def _certify(scene: Scene, target: Path, quiet: bool) -> None:
    from kinetic_solver.analysis.certification import certify
    from kinetic_solver.dataset import append, open_run

    with open_run(target) as written:
        found = certify(scene, written.load(), partial(_say, quiet, sys.stderr))
    append(target, found)
    _say(quiet, sys.stdout, f"certified: {found.attrs['certified']}")
