"""Whether this installation works."""

from __future__ import annotations

import typer

from kinetic_solver.cli.app import FAILED, AsJson, exit_codes, print_json, print_rows


def doctor(as_json: AsJson = False) -> None:
    """Say what is installed, on how many threads it runs, and whether a small run gives the known answer. Exit code 1 if not."""
    with exit_codes():
        from kinetic_solver.analysis.doctor import report

        found, healthy = report()
        if as_json:
            print_json({**{title: dict(rows) for title, rows in found}, "healthy": healthy})
        else:
            for title, rows in found:
                print(f"\n{title}")
                print_rows(rows)
    if not healthy:
        raise typer.Exit(FAILED)
