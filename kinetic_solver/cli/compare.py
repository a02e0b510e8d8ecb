"""Lay two datasets over each other."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from kinetic_solver.cli.app import DIFFER, INCONCLUSIVE, AsJson, Numbers, Overwrite, exit_codes, print_json, refuse_picture


def compare(
    first: Annotated[Path, typer.Argument(metavar="A.nc", show_default=False)],
    second: Annotated[Path, typer.Argument(metavar="B.nc", show_default=False)],
    output: Numbers = None,
    figure: Annotated[bool, typer.Option("--figure", help="Draw the comparison as well.")] = False,
    level: Annotated[float, typer.Option(help="Rate at which two runs of the same scene may be said to differ.")] = 0.01,
    time: Annotated[float | None, typer.Option(help="Of particles whose file has no time.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Lay two datasets over each other: differences in standard errors. Exit code 4: they differ, 5: it cannot be judged."""
    with exit_codes():
        from kinetic_solver.compare import compare as lay_over
        from kinetic_solver.dataset import attributes, refuse_existing, write_dataset
        from kinetic_solver.errors import SceneError

        if not 0 < level < 1:
            raise SceneError(f"--level {level:g}: allowed: between 0 and 1")
        refuse_picture(output, first, second)
        if output is not None:
            refuse_existing(output, overwrite)
        target = output.with_suffix(".png") if output else Path(f"{first.stem}-{second.stem}.png")
        if figure:
            refuse_existing(target, overwrite)
        found = lay_over(first, second, level, time)
        if as_json:
            print_json(found.facts())
        else:
            print("\n".join(found.lines()))
        say = sys.stderr if as_json else sys.stdout
        if output is not None:
            dataset = found.dataset()
            dataset.attrs.update(attributes(found.scene, "comparison"))
            write_dataset(dataset, output, overwrite)
            print(f"wrote {output}", file=say)
        if figure:
            from kinetic_solver.analysis.comparison_figure import save_comparison

            save_comparison(found, target)
            print(f"wrote {target}", file=say)
    if found.differ:
        raise typer.Exit(DIFFER)
    if not found.conclusive:
        raise typer.Exit(INCONCLUSIVE)
