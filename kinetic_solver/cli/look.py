"""Look at a run or a scene: plot, describe, info."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from kinetic_solver.cli.app import AsJson, Overrides, Overwrite, RunPath, ScenePath, exit_codes, load, print_json, print_rows


def beside(run: Path, ending: str) -> Path:
    """The name of a picture of it. What has no name of its own is no file, and is refused when it is opened."""
    return run.with_suffix(ending) if run.name else run / f"run{ending}"


def plot(
    run: RunPath,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.png", help="Default: OUT.png.")] = None,
    times: Annotated[str | None, typer.Option(help="Times of w(v) and f(x, v), up to 12, as 0,1.5,3: nearest frames.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Draw density, mean velocity and temperature over (x, t), the velocity distribution, and f(x, v)."""
    with exit_codes():
        from kinetic_solver.analysis.plotting import save_overview
        from kinetic_solver.dataset import open_run, refuse_existing
        from kinetic_solver.errors import SceneError

        target = output or beside(run, ".png")
        try:
            chosen = [float(part) for part in times.split(",")] if times else None
        except ValueError:
            raise SceneError(f"--times {times!r}: expected numbers separated by commas") from None
        if chosen and not all(math.isfinite(time) for time in chosen):
            raise SceneError(f"--times {times!r}: expected finite numbers")
        with open_run(run) as dataset:
            refuse_existing(target, overwrite)  # after the run has been found to be one
            save_overview(dataset, target, chosen)
        print(f"wrote {target}")


def animate(
    run: RunPath,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.gif|mp4", help="Default: OUT.gif.")] = None,
    fps: Annotated[float | None, typer.Option(help="Pictures a second; by default the movie lasts some ten seconds.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Make a movie of f(x, v), with the density above and w(v) beside it: one picture for each frame of the file."""
    with exit_codes():
        from kinetic_solver.analysis.animation import save_animation
        from kinetic_solver.dataset import open_run

        target = output or beside(run, ".gif")
        with open_run(run) as dataset:
            count = save_animation(dataset, target, fps, overwrite, progress=True)
        print(f"wrote {target}: {count} pictures")


def describe(scene: ScenePath, overrides: Overrides = None, as_json: AsJson = False) -> None:
    """Print the equation, its groups, the homogeneous state, and the run that would be made."""
    with exit_codes():
        from kinetic_solver.analysis.describe import describe as sections
        from kinetic_solver.analysis.describe import expected_seconds
        from particles.files import holds_particles

        loaded = load(scene, overrides)
        of_particles = loaded.initial.file is not None and holds_particles(loaded.initial.file)
        found = sections(loaded, on_the_grid=not of_particles)
        if "particles" in loaded.model_fields_set or of_particles:
            from particles.plan import make_plan
            from particles.report import rows as rows_of_particles

            found.append(("Run as particles (--method particles)", rows_of_particles(make_plan(loaded))))
        if as_json:
            sections_by_title: dict[str, dict[str, str | float]] = {title: dict(rows) for title, rows in found}
            if not of_particles:
                sections_by_title["Run on the grid"]["seconds"] = expected_seconds(loaded)
            print_json(sections_by_title)
            return
        for title, rows in found:
            print(f"\n{title}")
            print_rows(rows)


def info(run: RunPath, as_json: AsJson = False) -> None:
    """Say what a run's file holds, and how well its budgets close."""
    with exit_codes():
        from kinetic_solver.analysis.info import facts, summary
        from kinetic_solver.dataset import open_run

        with open_run(run) as dataset:
            if as_json:
                print_json(facts(dataset))
                return
            for line in summary(dataset):
                print(line)
            print("            all of its keys: --json")
