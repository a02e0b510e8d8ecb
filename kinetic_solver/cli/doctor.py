"""Whether this installation works."""

from __future__ import annotations

import typer

from kinetic_solver.cli.app import FAILED, AsJson, exit_codes, print_json


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
                width = max(len(label) for label, _ in rows)
                for label, text in rows:
                    print(f"  {label:<{width}}  {text}")
    if not healthy:
        raise typer.Exit(FAILED)
