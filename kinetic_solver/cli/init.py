"""A scene to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinetic_solver.cli.app import Overwrite, exit_codes


def _names(incomplete: str) -> list[str]:
    from kinetic_solver.scene.shipped import names

    return [name for name in names() if name.startswith(incomplete)]


def init(
    scene: Annotated[
        Path | None, typer.Argument(metavar="[SCENE.toml]", show_default=False, help="Default: scene.toml, or NAME.toml.")
    ] = None,
    example: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="One of the scenes that come with this software: pipe, cooling, …",
            autocompletion=_names,
        ),
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Write the JSON schema of scenes instead, for editors: scene.schema.json.")
    ] = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a commented scene to start from."""
    with exit_codes(another_name="give another name"):
        from importlib.resources import files

        from kinetic_solver.dataset import refuse_existing
        from kinetic_solver.errors import SceneError
        from kinetic_solver.scene import shipped

        if schema and example is not None:
            raise SceneError("--schema, --example: both are given; allowed: one of them")
        package = files("kinetic_solver")
        if schema:
            target = scene or Path("scene.schema.json")
            text = package.joinpath("scene.schema.json").read_text(encoding="utf-8")
        elif example is not None:
            target, text = scene or Path(f"{example}.toml"), shipped(example).read_text(encoding="utf-8")
        else:
            target, text = scene or Path("scene.toml"), package.joinpath("template.toml").read_text(encoding="utf-8")
        refuse_existing(target, overwrite)
        if not target.parent.is_dir():
            raise SceneError(f"{target}: cannot be created (its folder does not exist)")
        target.write_text(text, encoding="utf-8")
        print(f"wrote {target}" if schema else f"wrote {target}; now: kinetic-solver run {target}")
