"""Many scenes at once."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from kinetic_solver.cli.app import METHOD_NAMES, ScenePath, completes, exit_codes, load


def sweep(
    scene: ScenePath,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="A folder, to be made or gone on with.")],
    settings: Annotated[
        list[str],
        typer.Option("--set", metavar="a.b=VALUES", help="0.2:3:16 for 16 values from 0.2 to 3; 1,2,5 for these; or one value."),
    ],
    method: Annotated[
        str,
        typer.Option(help="As of run: grid, exact, particles, or hydrodynamics.", autocompletion=completes(*METHOD_NAMES)),
    ] = "grid",
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask.distributed cluster that sees the folder.")
    ] = None,
) -> None:
    """Run a scene for every combination of values, one file a point, and write DIR/sweep.nc with all of them."""
    with exit_codes():
        from kinetic_solver.errors import SceneError
        from kinetic_solver.sweeps import parse_values
        from kinetic_solver.sweeps import sweep as over_points

        given = dict(parse_values(text) for text in settings)
        values = {key: value for key, value in given.items() if isinstance(value, list) and not _is_one(key, settings)}
        if not values:
            raise SceneError(f"--set {settings[0]}: is one value; allowed: at least one key with several, as 0.2:3:16 or 1,2,5")
        base = load(scene, None).replace(**{key: value for key, value in given.items() if key not in values})
        with _executor(scheduler) as executor:
            found = over_points(base, values, output, method, executor, lambda text: print(text, file=sys.stderr))
        failed = int((found["error"] != "").sum())
        print(f"wrote {output / 'sweep.nc'}: {found['error'].size} points" + (f", {failed} failed: see error" if failed else ""))


def _is_one(key: str, settings: list[str]) -> bool:
    """Whether the list is one value, in TOML's brackets."""
    last = [text.partition("=")[2] for text in settings if text.partition("=")[0].strip() == key][-1]
    return last.strip().startswith("[")


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Any]:
    if scheduler is None:
        yield None
        return
    from kinetic_solver.errors import KineticError, SceneError

    try:
        from distributed import Client
    except ImportError:
        raise SceneError("--scheduler: needs the package distributed; install kinetic-solver[distributed]") from None
    try:
        client = Client(scheduler, timeout=20)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise KineticError(f"--scheduler {scheduler}: there is no cluster to be reached ({reason})") from None
    with client:
        yield client.get_executor()
