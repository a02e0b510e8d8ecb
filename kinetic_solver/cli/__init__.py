"""The command line: thin, and lazy: nothing heavy is imported until a command runs."""

from kinetic_solver.cli import compare, doctor, init, look, run, sweep, theory
from kinetic_solver.cli.app import app, main

# In the order in which --help lists them.
for command in (
    run.run,
    sweep.sweep,
    look.plot,
    look.animate,
    look.describe,
    theory.stability,
    compare.compare,
    theory.figure,
    look.info,
    init.init,
    doctor.doctor,
):
    app.command()(command)

__all__ = ["app", "main"]
