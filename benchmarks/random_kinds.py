"""Seeded random scenes of many kinds, in random units: each meets its rtol, or is refused with a reason.

    python -m benchmarks.random_kinds [--scenes 200] [--log FILE] [--rtol 1e-3 1e-4 1e-6] [--operators none inelastic]
                                      [--longest 60] [--seconds 3600] [--tables docs/data] [--further]

Kinds: smooth, steps, thin and vacuum surroundings, waves of velocity and temperature, cold, hot, no noise, no friction, no
gravity, beams, pulses, nothing that depends on x; each without collisions, with (6) and with (12), S and ε over all their ranges,
units of length, time and number over twelve decades, and cadences from one frame to thirty. With --further: without collisions
and with (6), friction over six decades, strong noise, early frames, waves of high modes. References: the closed form; for (12)
the Fourier series of tests/reference/fourier_inelastic.py. Each scene is a line of JSON in the log, so that a run can be stopped
and gone on with; the tables of docs/accuracy.md are made from the log. Fails where an error exceeds rtol without a warning of the
run.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.random_kinds_scenes import draw_scene, operator_of
from benchmarks.random_kinds_tables import in_silence, tables, underrated, written
from benchmarks.random_scenes import FIELDS
from kinetic_solver import KineticError, Scene, exact, solve
from kinetic_solver.arrays import Array
from kinetic_solver.dataset.scaled import scales_of, velocity_axis
from kinetic_solver.initial import beams
from kinetic_solver.plan import cost, make_plan
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC
from kinetic_solver.solver.estimate import PARTS
from kinetic_solver.theory.ornstein_uhlenbeck import transition
from tests.reference.fourier_inelastic import OutOfReach
from tests.reference.fourier_inelastic import solve as fourier

TOLERANCES = (1e-3, 1e-4, 1e-6)
PLACES, VELOCITIES = 30, 32
"""Of the run's points, at which fields are held against the reference."""
REFERENCE = 1e-4
"""Of rtol, to the shortest waves of the reference: all that it leaves out together are some tens of times more."""
MOST_WORK = 2e10
"""Multiplications of a reference, about: ten seconds."""
JUMPS, AGREED = 4.0, 0.1
"""Modes of a density step where the reference begins, over those that are left at the first frame: collisions multiply its waves
before, and what is missed of their products falls as the third power. So it takes twice as many until that changes less than
this share of rtol."""


def looked_at(run: xr.Dataset) -> xr.Dataset:
    """Some of the run's points, evenly over both: uniform in x over the period, in v with both ends."""
    nx, axis = run.sizes["x"], velocity_axis(run)
    cells = run.sizes[axis] - 1
    along_x = max((n for n in range(1, nx + 1) if nx % n == 0 and nx // n >= PLACES / 2), default=1)
    along_v = max((n for n in range(1, cells + 1) if cells % n == 0 and cells // n >= VELOCITIES / 2), default=1)
    return run.isel({"x": slice(None, None, along_x), axis: slice(None, None, along_v)})


def reference(scene: Scene, run: xr.Dataset) -> xr.Dataset:
    """The fields at the run's points, by the closed form or by Fourier series. Raises OutOfReach."""
    if scene.operator != INELASTIC:
        with np.errstate(all="ignore"):  # in a vacuum there is no mean velocity
            return exact.solve(scene, x=run["x"].values, v=run["v"].values)
    modes = modes_of(scene)
    truth, apart = _by_fourier(scene, run, modes), math.inf if scene.initial.step is not None else 0.0
    while apart > AGREED:
        modes *= 2
        coarser, truth = truth, _by_fourier(scene, run, modes)
        apart = max(errors(coarser.where(np.isfinite(run["temperature"])), truth, scene.accuracy.rtol).values())
    return truth


def _by_fourier(scene: Scene, run: xr.Dataset, modes: int) -> xr.Dataset:
    """From so many modes in x on."""
    x, v = run["x"].values, run[velocity_axis(run)].values
    coldest = float(run["temperature"].min())
    found = fourier(scene, REFERENCE * scene.accuracy.rtol, modes, coldest, MOST_WORK)
    rho, u, theta = found.moments(x)
    scale, origin = np.ones(found.times.size), np.zeros(found.times.size)
    if velocity_axis(run) != "v":  # of a gas that cools: f times s over (v - u)/s
        scale, origin = (np.asarray(of_time.values) for of_time in scales_of(run["f"]))
    frames = [
        replace(found, f=found.f[n : n + 1]).at(x, mean + s * v)[0] * s
        for n, (s, mean) in enumerate(zip(scale, origin, strict=True))
    ]
    fields: dict[str, tuple[tuple[str, ...], Array]] = {
        "f": (run["f"].dims, np.array(frames)),
        "density": (("time", "x"), rho),
        "mean_velocity": (("time", "x"), u),
        "temperature": (("time", "x"), theta),
    }
    return xr.Dataset(fields)


def modes_of(scene: Scene) -> int:
    """Where the reference begins: it takes more until they are enough."""
    start, first = scene.initial, float(scene.times()[1])
    if start.pulse is not None:
        return math.ceil(0.8 / start.pulse.width)
    if start.step is not None:
        # A jump's waves die with the displacement that is left once the velocity is known.
        step, theta = transition(scene.model, first), min(theta for _, _, theta in beams(scene))
        variance = theta * step.decay**2 + step.velocity_variance
        covariance = theta * step.drift_time * step.decay + step.covariance
        left = theta * step.drift_time**2 + step.displacement_variance - covariance**2 / variance
        k = JUMPS * math.sqrt(2 * math.log(1 / (REFERENCE * scene.accuracy.rtol)) / left)
        return math.ceil(k * scene.pipe.length / (2 * math.pi))
    return 6 * max((m.mode for m in (*start.modes, *start.velocity_modes, *start.temperature_modes)), default=1)


def errors(run: xr.Dataset, truth: xr.Dataset, rtol: float) -> dict[str, float]:
    """The largest error/rtol by field in the frames after 0, each relative to its own maxima; where fields are missing values
    there is no error."""
    worst = dict.fromkeys(FIELDS, 0.0)
    for n in range(1, run.sizes["time"]):
        now, there = run.isel(time=n), truth.isel(time=n)
        given = np.isfinite(now["temperature"].values)
        theta = float(np.abs(there["temperature"].values[given]).max(initial=0.0))
        speed = max(float(np.abs(there["mean_velocity"].values[given]).max(initial=0.0)), math.sqrt(theta))
        tops = {
            "f": float(there["f"].max()),
            "density": float(there["density"].max()),
            "mean_velocity": speed,
            "temperature": theta,
        }
        for name, top in tops.items():
            difference = np.abs(now[name].values - there[name].values)
            if name in ("mean_velocity", "temperature"):
                difference = difference[given]
            worst[name] = max(worst[name], float(difference.max(initial=0.0)) / (top * rtol))
    return worst


def attempt(
    seed: int, rtol: float, operator: str | None = None, longest: float = math.inf, further: bool = False
) -> dict[str, Any]:
    """One line of the log; a scene that is foretold to take longer than `longest` seconds is not run."""
    kind, scene = draw_scene(seed, rtol, operator, further)
    line: dict[str, Any] = {"seed": seed, "rtol": rtol, "kind": kind, "operator": scene.operator or "none"}
    line |= {"number": scene.groups.collision_number, "length": scene.groups.length, "restitution": scene.restitution}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        began = time.process_time()
        try:
            line["foretold"] = cost(make_plan(scene)).seconds
            if line["foretold"] > longest:
                return line | {"too_long": True}
            line["planned"] = time.process_time() - began
            began = time.process_time()
            run = solve(scene)
        except KineticError as error:
            return line | {"refused": str(error), "seconds": time.process_time() - began}
        line["seconds"] = time.process_time() - began
    line["said"] = [str(one.message)[:200] for one in said if "rtol" in str(one.message) or "missing" in str(one.message)]
    line["estimate"] = float(run["error_estimate"].max()) / rtol
    line["parts"] = {name: float(run[name].max()) / rtol for name in PARTS}
    line["grids"] = run.attrs.get("grids", "")[:80]
    began = time.process_time()
    shown = looked_at(run)
    try:
        truth = reference(scene, shown)
    except OutOfReach as why:
        return line | {"no_reference": str(why)}
    return line | {"errors": errors(shown, truth, rtol), "reference_seconds": time.process_time() - began}


def scenes_to_do(
    count: int, tolerances: Sequence[float], operators: Sequence[str], done: set[tuple[int, float]], further: bool = False
) -> Iterator[tuple[int, float]]:
    for rtol in tolerances:
        for seed in range(count):
            if (operator_of(seed, further) or "none") in operators and (seed, rtol) not in done:
                yield seed, rtol


def read(log: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--rtol", type=float, nargs="*", default=TOLERANCES)
    parser.add_argument("--operators", nargs="*", default=["none", FOLLOW_LEADER, INELASTIC])
    parser.add_argument("--log", type=Path, default=Path("random_kinds.jsonl"))
    parser.add_argument("--longest", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--tables", type=Path, help="a folder for them")
    parser.add_argument("--further", action="store_true", help="the kinds apart")
    given = parser.parse_args()
    np.seterr(all="ignore")
    done = {(line["seed"], line["rtol"]) for line in read(given.log)}
    until = time.monotonic() + given.seconds
    with given.log.open("a") as log:
        for seed, rtol in scenes_to_do(given.scenes, given.rtol, given.operators, done, given.further):
            if time.monotonic() > until:
                break
            line = attempt(seed, rtol, longest=given.longest, further=given.further)
            print(json.dumps(line), file=log, flush=True)
            worst = max(line["errors"].values()) if "errors" in line else math.nan
            print(f"{seed} {rtol:.0e} {line['kind']} {line['operator']}: {worst:.2g} {line.get('refused', '')[:100]}", flush=True)
    lines = read(given.log)
    for name, rows in (found := tables(lines)).items():
        print(f"\n{name}", *("| " + " | ".join(row) + " |" for row in rows), sep="\n")
    if given.tables is not None:
        written(found, given.tables, "random_further" if given.further else "random_kinds")
    for line in underrated(lines):
        print("error of f above its estimate:", json.dumps(line))
    for line in (bad := in_silence(lines)):
        print("above rtol in silence:", json.dumps(line))
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
