"""The command line: thin, and lazy: nothing heavy is imported until a command runs."""

from kinetic_solver.cli.app import app, main

__all__ = ["app", "main"]
