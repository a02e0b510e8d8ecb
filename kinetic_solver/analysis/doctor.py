"""What this installation is made of, and whether it gives right answers: the first thing to send with a question."""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata
from time import perf_counter

from kinetic_solver.errors import KineticError
from kinetic_solver.machine import physical_memory
from kinetic_solver.scene import Scene

Row = tuple[str, str]

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "pyfftw",
    "xarray",
    "netCDF4",
    "pydantic",
    "typer",
    "matplotlib",
    "distributed",
)
CHECKED = Scene.model_validate(
    {
        "model": {"gravity": 0.7, "friction": 1.3, "noise": 0.6},
        "collisions": {"operator": "follow-the-leader", "cross_section": 0.8},
        "pipe": {"length": 7.0},
        "initial": {"density": 1.1, "modes": [{"mode": 1, "cos": 0.3}]},
        "run": {"end_time": 0.5},
        "particles": {"count": 20_000, "replicas": 4},
    }
)
"""Runs in a second by every method that is checked, and has a closed form."""
SIGMAS = 6.0
"""Standard errors of four replicas within which the particles' energy must be. Chosen; the seed is fixed: chance has no say."""


def report() -> tuple[list[tuple[str, list[Row]]], bool]:
    """Sections of (label, text), and whether all checks passed."""
    checks, healthy = _checks()
    return [("Versions", _versions()), ("Machine", _machine()), ("Self-test", checks)], healthy


def _versions() -> list[Row]:
    rows = [("kinetic-solver", metadata.version("kinetic-solver")), ("python", f"{platform.python_version()}, {sys.executable}")]
    for name in PACKAGES:
        try:
            rows.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            rows.append((name, "not installed"))
    return rows


def _machine() -> list[Row]:
    import numba
    import scipy.linalg  # noqa: F401 (its BLAS is listed)
    from threadpoolctl import threadpool_info

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    blas = {f"{pool['internal_api']} {pool['version']}, {pool['num_threads']} threads" for pool in threadpool_info()
            if pool["user_api"] == "blas"}  # fmt: skip
    given = os.environ.get("NUMBA_CACHE_DIR")
    return [
        ("system", f"{platform.system()} {platform.release()}, {platform.machine()}"),
        ("cores", f"{cores} for this process, {os.cpu_count()} in all"),
        ("memory", f"{physical_memory() / 2**30:.3g} GiB"),
        ("numba", f"{numba.get_num_threads()} threads"),
        ("BLAS", "; ".join(sorted(blas)) or "none found"),
        ("FFT", "FFTW, by pyfftw"),
        ("compiled code", f"kept in {given}" if given else "kept beside the package, or in the user's cache"),
    ]


def _checks() -> tuple[list[Row], bool]:
    """The closed form against the grid, in exact steps and with operator (6) in high order, and against the particles."""
    import numpy as np

    from kinetic_solver import exact
    from kinetic_solver.solver import solve
    from particles.simulation import simulate

    truth, rtol, rows, healthy = exact.solve(CHECKED), CHECKED.accuracy.rtol, [], True
    for stepping in ("exact", "extrapolated"):
        began = perf_counter()
        try:
            run = solve(CHECKED.replace(**{"grid.stepping": stepping}))
            error = float(np.abs(run["f"] - exact.solve(CHECKED, run["x"], run["v"])["f"]).max() / truth["f"].max())
            good, text = error <= rtol, f"error {error:.1e} of max f; allowed {rtol:.0e}"
        except KineticError as problem:
            good, text = False, str(problem)
        rows.append((f"grid, {stepping} steps", f"{'passed' if good else 'FAILED'}: {text}, {perf_counter() - began:.2g} s"))
        healthy &= good
    began = perf_counter()
    run = simulate(CHECKED)
    difference = abs(float(run["energy"][-1] - truth["energy"][-1])) / float(run["energy_stderr"][-1])
    good = difference < SIGMAS
    text = f"energy {difference:.2g} standard errors from the closed form; allowed {SIGMAS:g}, {perf_counter() - began:.2g} s"
    rows.append(("particles", f"{'passed' if good else 'FAILED'}: {text}"))
    return rows, healthy and good
