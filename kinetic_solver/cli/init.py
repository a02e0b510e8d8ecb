"""A scene to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinetic_solver.cli.app import Overwrite, exit_codes


def init(scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")] = Path("scene.toml"), overwrite: Overwrite = False) -> None:
    """Write a commented scene to start from."""
    with exit_codes(another_name="give another name"):
        from importlib.resources import files

        from kinetic_solver.dataset import refuse_existing
        from kinetic_solver.errors import SceneError

        refuse_existing(scene, overwrite)
        if not scene.parent.is_dir():
            raise SceneError(f"{scene}: cannot be created (its folder does not exist)")
        scene.write_text(files("kinetic_solver").joinpath("template.toml").read_text(encoding="utf-8"), encoding="utf-8")
        print(f"wrote {scene}; now: kinetic-solver run {scene}")
