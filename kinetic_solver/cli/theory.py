"""Linear theory, and the paper's figures: stability, figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinetic_solver.cli.app import Numbers, Overrides, Overwrite, exit_codes, load, refuse_picture

if TYPE_CHECKING:
    from kinetic_solver.scene import Scene


def stability(
    scene: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENE.toml | OUT.nc]", show_default=False, help="A scene, or a run to measure as well."),
    ] = None,
    output: Numbers = None,
    figure: Annotated[bool, typer.Option("--figure", help="Draw it as well. Without a scene: Fig. 1 of the paper.")] = False,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
) -> None:
    """Linear theory: the closure's critical density, the kinetic spectrum, transient growth, the noise of N particles."""
    with exit_codes():
        from kinetic_solver.dataset import refuse_existing
        from kinetic_solver.errors import SceneError

        if scene is None and not figure:
            raise SceneError("stability: nothing to do; allowed: a scene, a run's file, or --figure for Fig. 1 of the paper")
        refuse_picture(output, scene)
        if scene is None:
            _figure_1(output or Path("figure_1.nc"), overwrite)
            return
        run = scene if scene.suffix == ".nc" else None
        if run is not None and overrides:
            raise SceneError("--set: a run's file holds its scene; allowed: with SCENE.toml")
        target = output.with_suffix(".png") if output else Path(f"{scene.stem}-stability.png")
        if figure:
            refuse_existing(target, overwrite)
        loaded = _scene_of_run(run) if run is not None else load(scene, overrides)
        _stability(loaded, run, output, overwrite)
        if figure:
            from kinetic_solver.analysis.stability_figure import save_scene_figure

            save_scene_figure(loaded, target)
            print(f"wrote {target}")


def _scene_of_run(run: Path) -> Scene:
    from kinetic_solver.dataset import open_run, refuse_law, scene_of

    with open_run(run) as dataset:
        refuse_law(dataset)
        return scene_of(dataset, run)


def _stability(scene: Scene, run: Path | None, output: Path | None, overwrite: bool) -> None:
    from kinetic_solver.dataset import attributes, open_run, refuse_existing, write_dataset
    from kinetic_solver.stability.verdict import linear_theory, verdict

    if output is not None:
        refuse_existing(output, overwrite)
    theory = linear_theory(scene)
    sections = verdict(scene, theory)
    if run is not None:
        from kinetic_solver.analysis.measured_rates import measured_lines, measured_rates

        with open_run(run) as dataset:
            theory = theory.merge(measured_rates(dataset), join="outer", compat="override", combine_attrs="override")
        sections.append(("What the run did", measured_lines(theory)))
    for title, lines in sections:
        print(f"\n{title}")
        for line in lines:
            print(f"  {line}")
    if output is not None:
        theory.attrs.update(attributes(scene, "linear theory"))
        write_dataset(theory, output, overwrite)
        print(f"\nwrote {output}")


def _figure_1(target: Path, overwrite: bool) -> None:
    from kinetic_solver.analysis.figure_1 import save_figure_1
    from kinetic_solver.dataset import refuse_existing, write_dataset
    from kinetic_solver.stability import figure_1

    refuse_existing(target.with_suffix(".png"), overwrite)
    dataset = figure_1()
    write_dataset(dataset, target, overwrite)
    save_figure_1(dataset, target.with_suffix(".png"))
    print(f"wrote {target} and {target.with_suffix('.png')}")


def figure(
    number: Annotated[str, typer.Argument(metavar="2|3|closure", show_default=False)],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Default: figure_N.nc.")] = None,
    operator: Annotated[str, typer.Option(help="follow-the-leader (6), or inelastic (12).")] = "follow-the-leader",
    count: Annotated[int | None, typer.Option(help="Number of particles, 10000 by default; of 2 and 3.")] = None,
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 1,
    overwrite: Overwrite = False,
) -> None:
    """The paper's Figures 2 and 3: particles below and above the closure's critical density, at t = 0, 3, 500/γ. Or closure: one
    scene above it by the closure, more moments, the kinetic equation, and particles, few and many (a minute)."""
    with exit_codes():
        from kinetic_solver.dataset import refuse_existing
        from kinetic_solver.errors import SceneError

        if number not in ("2", "3", "closure"):
            raise SceneError(f"figure {number}: allowed: 2, 3 or closure")
        refuse_picture(output)
        target = output or Path(f"figure_{number}{'_inelastic' if operator == 'inelastic' else ''}.nc")
        refuse_existing(target, overwrite)
        refuse_existing(target.with_suffix(".png"), overwrite)
        if number == "closure":
            _figure_closure(target, operator, count, seed, overwrite)
        else:
            _figure_2_3(int(number), target, operator, count, seed, overwrite)
        print(f"wrote {target} and {target.with_suffix('.png')}")


def _figure_2_3(number: int, target: Path, operator: str, count: int | None, seed: int, overwrite: bool) -> None:
    from kinetic_solver.analysis.paper_figures import COUNT, figure_scene, save_snapshots, snapshots, summary
    from kinetic_solver.dataset import write_dataset

    dataset = snapshots(figure_scene(number, operator, COUNT if count is None else count, seed))
    write_dataset(dataset, target, overwrite)
    save_snapshots(dataset, target.with_suffix(".png"))
    print("\n".join(summary(dataset)))


def _figure_closure(target: Path, operator: str, count: int | None, seed: int, overwrite: bool) -> None:
    from kinetic_solver.analysis.closure_figure import (
        closure_scene,
        closure_summary,
        descriptions,
        refuse_options,
        save_closure_figure,
    )
    from kinetic_solver.dataset import write_dataset

    refuse_options(operator, count)
    dataset = descriptions(closure_scene(seed), lambda text: print(f"{text} …", flush=True))
    write_dataset(dataset, target, overwrite)
    save_closure_figure(dataset, target.with_suffix(".png"))
    print("\n".join(closure_summary(dataset)))
