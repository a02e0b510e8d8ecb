"""The command line. Thin, and lazy: nothing heavy is imported until a command runs."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from kinetic_solver.scene import Scene

OUTSIDE = 1e-3
"""Share of particles outside the window beyond which a run warns."""
FAILED, WRONG, UNFINISHED, DIFFER, INTERRUPTED = 1, 2, 3, 4, 130

app = typer.Typer(
    name="kinetic-solver",
    help="One-dimensional kinetic equations with friction, noise and collisions.",
    rich_markup_mode=None,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

ScenePath = Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)]
RunPath = Annotated[Path, typer.Argument(metavar="OUT.nc", show_default=False)]
Overrides = Annotated[list[str] | None, typer.Option("--set", metavar="a.b=value", help="Override a key of the scene.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing output file.")]


def main() -> None:
    """Entry point: errors become one line on stderr and an exit code."""
    import signal

    warnings.showwarning = _show_warning  # type: ignore[assignment]
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        code = typer.main.get_command(app)(standalone_mode=False)
    except (typer.Abort, KeyboardInterrupt):
        print("error: interrupted; the frames written are kept", file=sys.stderr)
        code = INTERRUPTED
    except Exception as error:
        # What is wrong with the command itself. The class is click's, wherever typer has it from.
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        print(message if "Usage:" in message else f"error: {' '.join(message.split())}", file=sys.stderr)
        code = WRONG
    sys.exit(code)


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def _show_warning(message: Warning | str, *_: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _fail(error: BaseException, code: int) -> typer.Exit:
    print(f"error: {error}", file=sys.stderr)
    return typer.Exit(code)


@contextmanager
def _exit_codes() -> Iterator[None]:
    """SceneError → 2, a run that cannot go on → 1, one that can be resumed → 3; one line each."""
    from kinetic_solver.errors import SceneError

    try:
        yield
    except _WalltimeOver as stop:
        print(stop, file=sys.stderr)
        raise typer.Exit(UNFINISHED) from None
    except SceneError as error:
        raise _fail(error, WRONG) from None
    except (RuntimeError, MemoryError, OSError) as error:
        raise _fail(error, FAILED) from None


def _load(path: Path, overrides: list[str] | None) -> Scene:
    from kinetic_solver.scene import Scene, parse_override

    return Scene.from_toml(path, dict(parse_override(text) for text in overrides or ()))


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"kinetic-solver {version('kinetic-solver')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
) -> None: ...


@app.command()
def run(
    scene: ScenePath,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Default: SCENE.nc.")] = None,
    method: Annotated[str, typer.Option(help="grid, exact (the closed form, where there is one), or particles.")] = "grid",
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    certified: Annotated[bool, typer.Option("--certify", help="Run again refined; add error bars and observed orders.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from where a run of particles was stopped.")] = False,
    max_walltime: Annotated[
        float | None, typer.Option(metavar="S", help="Stop particles after S seconds, at a frame, to be resumed; exit code 3.")
    ] = None,
) -> None:
    """Solve a scene and write a netCDF file."""
    with _exit_codes():
        from kinetic_solver.errors import SceneError

        if method not in _METHODS:
            raise SceneError(f"--method {method!r}: unknown; allowed: {', '.join(map(repr, _METHODS))}")
        loaded = _load(scene, overrides)
        target = output or Path(scene.stem + ".nc")
        if certified and method != "grid":
            raise SceneError(f"--certify: is for --method grid; {method!r} has no discretisation to refine")
        if (resume or max_walltime is not None) and method != "particles":
            raise SceneError("--resume, --max-walltime: are for --method particles; other methods start afresh with --overwrite")
        if max_walltime is not None and not max_walltime >= 0:
            raise SceneError(f"--max-walltime {max_walltime:g}: allowed: 0 or more seconds")
        if loaded.initial.file is not None and Path(loaded.initial.file).resolve() == target.resolve():
            raise SceneError(f"-o {target}: is the file that the run starts from; name another")
        if resume and overwrite:
            raise SceneError("--resume, --overwrite: allowed: one of them")
        if method == "particles":
            _run_particles(loaded, target, overwrite, resume, max_walltime)
        else:
            _METHODS[method](loaded, target, overwrite)
        if certified:
            _certify(loaded, target)
        print(f"{target} is complete" if resume else f"wrote {target}")


def _run_grid(scene: Scene, target: Path, overwrite: bool) -> None:
    from kinetic_solver.dataset import NetCDFRecorder
    from kinetic_solver.errors import SolverStopped
    from kinetic_solver.plan import make_plan
    from kinetic_solver.solver import integrate

    plan = make_plan(scene)
    recorder = NetCDFRecorder(target, plan.output, scene, overwrite=overwrite)
    try:
        with _progress() as progress:
            report = integrate(plan, recorder, progress)
    except BaseException as stop:
        reason = str(stop) if isinstance(stop, SolverStopped) else f"interrupted by {type(stop).__name__} {stop}".strip()
        recorder.close(stopped=reason)
        raise
    recorder.close(report=report.attributes())
    print(
        f"estimated error {report.error:.2g} of max f (accuracy.rtol = {scene.accuracy.rtol:g}); limited by {report.limited_by}"
    )


def _certify(scene: Scene, target: Path) -> None:
    from kinetic_solver.analysis.certification import certify
    from kinetic_solver.dataset import append, open_run

    with open_run(target) as run:
        found = certify(scene, run.load(), lambda text: print(text, file=sys.stderr))
    append(target, found)
    print(f"certified: {found.attrs['certified']}")


def _run_exact(scene: Scene, target: Path, overwrite: bool) -> None:
    from kinetic_solver import exact
    from kinetic_solver.dataset import write_dataset

    write_dataset(exact.solve(scene), target, overwrite)


def _run_particles(scene: Scene, target: Path, overwrite: bool, resume: bool = False, walltime: float | None = None) -> None:
    from time import monotonic

    from kinetic_solver.dataset import NetCDFRecorder
    from particles.checkpoint import Checkpoint, finished
    from particles.plan import make_plan
    from particles.records import coordinates, report, variables
    from particles.simulation import Simulation
    from particles.simulation import run as run_particles

    began = monotonic()
    plan = make_plan(scene)
    scene, said = plan.scene, report(plan)
    if resume and finished(target, scene):
        print("it has finished already")
        return
    checkpoint = Checkpoint(target, scene)
    state = checkpoint.load() if resume and target.exists() else None
    after = None if state is None else float(state["time"])
    table = variables(plan)
    recorder = NetCDFRecorder(target, plan.grid, scene, "particles", overwrite or resume, table, coordinates(plan), after)
    if state is None:
        checkpoint.remove()
    if "warning" in said:
        print(f"warning: {said['warning']}", file=sys.stderr)

    def after_frame(simulation: Simulation) -> None:
        late = walltime is not None and monotonic() - began > walltime and simulation.time < scene.run.end_time
        if checkpoint.due or late:
            checkpoint.save(simulation.state())
        if late:
            raise _WalltimeOver(f"stopped at t = {simulation.time:g} after {walltime:g} s; go on with --resume")

    try:
        with _progress() as progress:
            done = run_particles(plan, recorder, progress, after_frame, state)
    except BaseException as stop:
        text = str(stop)
        recorder.close(
            stopped=text if isinstance(stop, _WalltimeOver) else f"interrupted by {type(stop).__name__} {text}".strip()
        )
        raise
    recorder.close(report=said)
    checkpoint.remove()
    if done.outside > OUTSIDE:
        print(
            f"warning: up to {done.outside:.2g} of the particles are outside the velocity window and missing in f and w(v); "
            "widen grid.velocity_window",
            file=sys.stderr,
        )
    steps = done.number - (int(state["number"]) if state is not None else 0)
    particles = scene.particles.count * scene.particles.replicas
    speed = particles * steps / (monotonic() - began) / 1e6
    print(f"{particles} particles, {steps} steps, {speed:.3g} million particle-steps a second, start and output included")
    how = f"cells: {said['cells']}" if "cells" in said else f"overtakings: {done.candidates}, {said['overtakings']}"
    print(f"memory of the ensemble {plan.memory / 2**20:.0f} MiB; {done.collisions} collisions; {how}")


class _WalltimeOver(Exception):
    """The time given on the command line is over; a checkpoint is written."""


_METHODS: dict[str, Callable[[Scene, Path, bool], None]] = {
    "grid": _run_grid,
    "exact": _run_exact,
    "particles": _run_particles,
}


@contextmanager
def _progress() -> Iterator[Callable[[float, float], None]]:
    """A bar on a terminal; elsewhere a plain line with the time left, at most every ten seconds."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("t = {task.fields[time]:.4g}"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
        with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
            task = bar.add_task("run", total=1.0, time=0.0)
            yield lambda time, end: bar.update(task, completed=time / end, time=time)
        return
    from time import monotonic

    began = spoken = monotonic()

    def line(time: float, end: float) -> None:
        nonlocal spoken
        now = monotonic()
        if now - spoken >= 10 or time == end:
            spoken = now
            left = (now - began) / time * (end - time)
            print(f"t = {time:.6g} of {end:g}, {left:.0f} s left", file=sys.stderr)

    yield line


@app.command()
def plot(
    run: RunPath,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.png", help="Default: OUT.png.")] = None,
    times: Annotated[str | None, typer.Option(help="Times of the f(x, v) panels, as 0,1.5,3.")] = None,
) -> None:
    """Draw density over (x, t), the velocity distribution, and f(x, v)."""
    with _exit_codes():
        from kinetic_solver.analysis.plotting import save_overview
        from kinetic_solver.dataset import open_run
        from kinetic_solver.errors import SceneError

        try:
            chosen = [float(part) for part in times.split(",")] if times else None
        except ValueError:
            raise SceneError(f"--times {times!r}: expected numbers separated by commas") from None
        if chosen and not all(math.isfinite(time) for time in chosen):
            raise SceneError(f"--times {times!r}: expected finite numbers")
        target = output or run.with_suffix(".png")
        with open_run(run) as dataset:
            save_overview(dataset, target, chosen)
        print(f"wrote {target}")


@app.command()
def describe(scene: ScenePath, overrides: Overrides = None) -> None:
    """Print the equation, its groups, the homogeneous state, and the run that would be made."""
    with _exit_codes():
        from kinetic_solver.analysis.describe import describe as sections

        loaded = _load(scene, overrides)
        of_particles = loaded.initial.file is not None and _holds_particles(loaded.initial.file)
        found = sections(loaded, on_the_grid=not of_particles)
        if "particles" in loaded.model_fields_set or of_particles:
            from particles.plan import make_plan
            from particles.records import rows as rows_of_particles

            found.append(("Run as particles (--method particles)", rows_of_particles(make_plan(loaded))))
        for title, rows in found:
            print(f"\n{title}")
            width = max(len(label) for label, _ in rows)
            for label, text in rows:
                print(f"  {label:<{width}}  {text}")


def _holds_particles(path: str) -> bool:
    import xarray as xr

    from particles.files import particle_names

    try:
        with xr.open_dataset(path) as dataset:
            return particle_names(dataset) is not None and "f" not in dataset
    except (OSError, ValueError):
        return False


@app.command()
def stability(
    scene: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENE.toml | OUT.nc]", show_default=False, help="A scene, or a run to measure as well."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Write the numbers as a dataset too.")
    ] = None,
    figure: Annotated[bool, typer.Option("--figure", help="Draw it as well. Without a scene: Fig. 1 of the paper.")] = False,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
) -> None:
    """Linear theory: the closure's critical density, the kinetic spectrum, transient growth, the noise of N particles."""
    with _exit_codes():
        from kinetic_solver.errors import SceneError

        if scene is None:
            if not figure:
                raise SceneError("stability: nothing to do; allowed: a scene, a run's file, or --figure for Fig. 1 of the paper")
            _figure_1(output or Path("figure_1.nc"), overwrite)
            return
        if output is not None and output.suffix == ".png":
            raise SceneError(f"-o {output}: is for the dataset; allowed: a name that does not end in .png (--figure makes that)")
        run = scene if scene.suffix == ".nc" else None
        if run is not None and overrides:
            raise SceneError("--set: a run's file holds its scene; allowed: with SCENE.toml")
        loaded = _scene_of(run) if run is not None else _load(scene, overrides)
        _stability(loaded, run, output, overwrite)
        if figure:
            from kinetic_solver.analysis.stability_figure import save_scene_figure

            target = output.with_suffix(".png") if output else Path(f"{scene.stem}-stability.png")
            save_scene_figure(loaded, target)
            print(f"wrote {target}")


def _scene_of(run: Path) -> Scene:
    from kinetic_solver.dataset import open_run
    from kinetic_solver.scene import Scene

    with open_run(run) as dataset:
        return Scene.model_validate_json(dataset.attrs["scene"])


def _stability(scene: Scene, run: Path | None, output: Path | None, overwrite: bool) -> None:
    from kinetic_solver.dataset import attributes, open_run, write_dataset
    from kinetic_solver.stability.verdict import linear_theory, verdict

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
    from kinetic_solver.dataset import write_dataset
    from kinetic_solver.stability import figure_1

    dataset = figure_1()
    write_dataset(dataset, target, overwrite)
    save_figure_1(dataset, target.with_suffix(".png"))
    print(f"wrote {target} and {target.with_suffix('.png')}")


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="A.nc", show_default=False)],
    second: Annotated[Path, typer.Argument(metavar="B.nc", show_default=False)],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Write the numbers as a dataset too.")
    ] = None,
    figure: Annotated[bool, typer.Option("--figure", help="Draw the comparison as well.")] = False,
    level: Annotated[float, typer.Option(help="Rate at which two runs of the same scene may be said to differ.")] = 0.01,
    time: Annotated[float | None, typer.Option(help="Of particles whose file has no time.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Lay two datasets over each other: differences in standard errors. Exit code 4 if they differ."""
    with _exit_codes():
        from kinetic_solver.compare import compare as lay_over
        from kinetic_solver.dataset import attributes, write_dataset
        from kinetic_solver.errors import SceneError

        if not 0 < level < 1:
            raise SceneError(f"--level {level:g}: allowed: between 0 and 1")
        if output is not None and output.suffix == ".png":
            raise SceneError(f"-o {output}: is for the dataset; allowed: a name that does not end in .png (--figure makes that)")
        if output is not None and output.resolve() in (first.resolve(), second.resolve()):
            raise SceneError(f"-o {output}: is one of the files to compare; name another")
        if output is not None and output.exists() and not overwrite:
            raise SceneError(f"{output}: exists already; use --overwrite to replace it, or name another file with -o")
        found = lay_over(first, second, level, time)
        print("\n".join(found.lines()))
        if output is not None:
            dataset = found.dataset()
            dataset.attrs.update(attributes(found.scene, "comparison"))
            write_dataset(dataset, output, overwrite)
            print(f"wrote {output}")
        if figure:
            from kinetic_solver.analysis.comparison_figure import save_comparison

            target = output.with_suffix(".png") if output else Path(f"{first.stem}-{second.stem}.png")
            save_comparison(found, target)
            print(f"wrote {target}")
    if found.differ:
        raise typer.Exit(DIFFER)


@app.command()
def figure(
    number: Annotated[int, typer.Argument(metavar="2|3", show_default=False)],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Default: figure_N.nc.")] = None,
    operator: Annotated[str, typer.Option(help="follow-the-leader (6), or inelastic (12).")] = "follow-the-leader",
    count: Annotated[int, typer.Option(help="Number of particles.")] = 10_000,
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 1,
    overwrite: Overwrite = False,
) -> None:
    """The paper's Figures 2 and 3: particles below and above the closure's critical density, at t = 0, 3, 500/γ."""
    with _exit_codes():
        from pydantic import ValidationError

        from kinetic_solver.analysis.paper_figures import figure_scene, save_snapshots, snapshots, summary
        from kinetic_solver.dataset import write_dataset
        from kinetic_solver.errors import SceneError
        from kinetic_solver.scene import one_line

        if output is not None and output.suffix == ".png":
            raise SceneError(f"-o {output}: is for the dataset; allowed: a name that does not end in .png (the picture has that)")
        target = output or Path(f"figure_{number}{'_inelastic' if operator == 'inelastic' else ''}.nc")
        if target.exists() and not overwrite:
            raise SceneError(f"{target}: exists already; use --overwrite to replace it, or name another file with -o")
        try:
            chosen = figure_scene(number, operator, count, seed)
        except ValidationError as error:
            raise SceneError(one_line(error)) from None
        dataset = snapshots(chosen)
        write_dataset(dataset, target, overwrite)
        save_snapshots(dataset, target.with_suffix(".png"))
        print("\n".join(summary(dataset)))
        print(f"wrote {target} and {target.with_suffix('.png')}")


@app.command()
def info(run: RunPath) -> None:
    """Say what a run's file holds, and how well its budgets close."""
    with _exit_codes():
        from kinetic_solver.analysis.info import summary
        from kinetic_solver.dataset import open_run

        with open_run(run) as dataset:
            for line in summary(dataset):
                print(line)


@app.command()
def init(scene: Annotated[Path, typer.Argument(metavar="SCENE.toml")] = Path("scene.toml"), overwrite: Overwrite = False) -> None:
    """Write a commented scene to start from."""
    with _exit_codes():
        from importlib.resources import files

        from kinetic_solver.errors import SceneError

        if scene.exists() and not overwrite:
            raise SceneError(f"{scene}: exists already; use --overwrite to replace it")
        if not scene.parent.is_dir():
            raise SceneError(f"{scene}: cannot be created (its folder does not exist)")
        scene.write_text(files("kinetic_solver").joinpath("template.toml").read_text(encoding="utf-8"), encoding="utf-8")
        print(f"wrote {scene}; now: kinetic-solver run {scene}")
