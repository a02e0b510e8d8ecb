"""What all commands share: the application, its entry point, exit codes, options, and errors in one line."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from kinetic_solver.scene import Scene

FAILED, WRONG, UNFINISHED, DIFFER, INCONCLUSIVE, INTERRUPTED = 1, 2, 3, 4, 5, 130
"""Exit codes: failed while running; scene or command wrong; stopped early with a checkpoint; compare: the two differ, or cannot
be judged; Ctrl-C."""

OBJECTS = 100_000
"""New objects between two looks for circles of them that nobody needs any more. Python's own 700 make it look 100 times while
modules are loaded, which have none: 0.01 s of a run of (6), and with 20 000 three times, 5 ms each. Chosen: what (6) loads are
70 000, and of a run's own objects so many are ten MB."""

app = typer.Typer(
    name="kinetic-solver",
    help="One-dimensional kinetic equations with friction, noise and collisions.",
    rich_markup_mode=None,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)

ScenePath = Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)]
RunPath = Annotated[Path, typer.Argument(metavar="OUT.nc", show_default=False)]
Numbers = Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.nc", help="Write the numbers as a dataset too.")]
Overrides = Annotated[list[str] | None, typer.Option("--set", metavar="a.b=value", help="Override a key of the scene.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing output file.")]


METHOD_NAMES = ("grid", "exact", "particles", "hydrodynamics")
"""Keys of `kinetic_solver.methods.METHODS`, which are not to be imported while a shell completes a line."""


def completes(*words: str) -> Callable[[str], list[str]]:
    """For a shell: those of the words that begin as what is typed. The name of the argument is typer's."""
    return lambda incomplete: [word for word in words if word.startswith(incomplete)]


AsJson = Annotated[bool, typer.Option("--json", help="For other programs, as JSON.")]


def print_json(facts: Any) -> None:
    """One JSON text; what is no number is null."""
    import json

    print(json.dumps(_without_nan(facts), ensure_ascii=False, indent=1, allow_nan=False))


def print_rows(rows: Iterable[tuple[str, str]]) -> None:
    """Labels and texts, in two columns."""
    listed = list(rows)
    width = max((len(label) for label, _ in listed), default=0)
    for label, text in listed:
        print(f"  {label:<{width}}  {text}")


def _without_nan(facts: Any) -> Any:
    if isinstance(facts, dict):
        return {str(key): _without_nan(value) for key, value in facts.items()}
    if isinstance(facts, list | tuple):
        return [_without_nan(value) for value in facts]
    if hasattr(facts, "item"):
        facts = facts.item()
    return None if isinstance(facts, float) and not abs(facts) < float("inf") else facts


def main() -> None:
    """Entry point: errors become one line on stderr and an exit code."""
    import gc
    import os
    import signal

    gc.set_threshold(OBJECTS)
    warnings.showwarning = show_warning  # type: ignore[assignment]
    signal.signal(signal.SIGTERM, _interrupt)
    os.environ["MPLBACKEND"] = "agg"  # pictures are files here, whatever else the environment says
    # A search of all installed packages for plugins of pydantic, which would have nothing to add here.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is no reason to fail
    try:
        code = typer.main.get_command(app)(standalone_mode=False)
    except (typer.Abort, KeyboardInterrupt):
        print("error: interrupted", file=sys.stderr)
        code = INTERRUPTED
    except Exception as error:
        # What is wrong with the command itself. The class is click's, wherever typer has it from.
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()
        print(message if "Usage:" in message else f"error: {' '.join(message.split())[:LONGEST_LINE]}", file=sys.stderr)
        code = WRONG
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the interpreter, at its end, can flush
    gc.freeze()  # the process ends: the interpreter need not look for circles among all that was loaded, 0.04 s
    sys.exit(code)


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def show_warning(message: Warning | str, category: type[Warning], *_: Any) -> None:
    if issubclass(category, DeprecationWarning):
        return  # one package's word to the authors of another: nothing that who runs a command could mend
    print(f"warning: {message}", file=sys.stderr)


@contextmanager
def exit_codes(another_name: str = "name another file with -o") -> Iterator[None]:
    """Errors as one line and an exit code: SceneError → 2, a run stopped early → 3, any other that is expected → 1.

    The library speaks of no flags; this is where its errors learn them. `another_name` says how a command names another file.
    """
    from kinetic_solver.errors import KineticError, OutputExistsError, RunUnfinished, SceneError

    try:
        yield
    except RunUnfinished as stop:
        print(f"{stop} (--resume)" if stop.kept else stop, file=sys.stderr)
        raise typer.Exit(INTERRUPTED if stop.by == "SIGINT" else UNFINISHED) from None
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    except OutputExistsError as error:
        raise _fail(f"{error.path}: exists already; use --overwrite to replace it, or {another_name}", WRONG) from None
    except SceneError as error:
        raise _fail(error, WRONG) from None
    except BrokenPipeError:
        raise typer.Exit(0) from None  # whoever reads has had enough
    except (KineticError, RuntimeError, MemoryError, OSError) as error:
        raise _fail(error, FAILED) from None


def _fail(error: BaseException | str, code: int) -> typer.Exit:
    print(f"error: {error}", file=sys.stderr)
    return typer.Exit(code)


def load(path: Path, overrides: list[str] | None) -> Scene:
    """The scene, with what `--set` says."""
    from kinetic_solver.errors import SceneError
    from kinetic_solver.scene import Scene, parse_override

    if path.is_file():
        with path.open("rb") as file:
            start = file.read(4)
        if start.startswith(b"CDF") or start == b"\x89HDF":
            raise SceneError(f"{path}: this is a run, and no scene in TOML; allowed: info {path}, or plot {path}")
    return Scene.from_toml(path, dict(parse_override(text) for text in overrides or ()))


LONGEST_LINE = 500
"""Characters of what is said about a wrong command: it may repeat megabytes that were given."""
PICTURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".ps", ".eps", ".tif", ".tiff", ".webp")


def refuse_picture(output: Path | None, *read: Path | None) -> None:
    """Raises SceneError where `-o` names a picture, whose name follows from the dataset's, or a file that is read."""
    from kinetic_solver.errors import SceneError

    if output is None:
        return
    if not output.name:
        raise SceneError(f"-o {output}: is a folder; allowed: the name of a file")
    if (ending := output.suffix.lower()) in PICTURES:
        raise SceneError(f"-o {output}: is for the dataset; allowed: a name that does not end in {ending} (pictures have that)")
    if any(path is not None and output.resolve() == path.resolve() for path in read):
        raise SceneError(f"-o {output}: is a file that this command reads; allowed: another name")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"kinetic-solver {version('kinetic-solver')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
) -> None: ...
