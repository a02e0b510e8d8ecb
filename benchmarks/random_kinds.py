"""Seeded random scenes of many kinds, in random units: each meets its rtol, or is refused with a reason.

    python -m benchmarks.random_kinds [--scenes 200] [--log FILE] [--rtol 1e-3 1e-4 1e-6] [--operators none inelastic]
                                      [--longest 60] [--seconds 3600]

Kinds: smooth, steps, thin and vacuum surroundings, waves of velocity and temperature, cold, hot, no noise, no friction, no
gravity, beams, pulses, nothing that depends on x; each without collisions, with (6) and with (12), S and ε over all their ranges,
units of length, time and number over twelve decades, and cadences from one frame to thirty. References: the closed form; for (12)
the Fourier series of tests/reference/fourier_inelastic.py. Each scene is a line of JSON in the log, so that a run can be stopped
and gone on with; the table is made from the log. Fails where an error exceeds rtol without a warning of the run.
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

OPERATORS = (None, FOLLOW_LEADER, INELASTIC)
KINDS = (
    "smooth",
    "step",
    "thin",
    "vacuum",
    "waves",
    "cold",
    "hot",
    "noiseless",
    "frictionless",
    "weightless",
    "beams",
    "pulse",
    "homogeneous",
)
TOLERANCES = (1e-3, 1e-4, 1e-6)
PLACES, VELOCITIES = 30, 32
"""Of the run's points, at which fields are held against the reference."""
REFERENCE = 0.001
"""Of rtol, to the shortest waves of the reference: all that it leaves out together are some ten times more."""
JUMPS = 8.0
"""Modes of a density step in the reference, over those that are left at the first frame: collisions multiply its waves before,
and what is missed of their products falls as the third power. With 1 the reference was 20 times further off than the runs, with
3 up to ten times."""
DECADES = 6.0
"""Units are random powers of ten, up to this one and down to one over it."""


def draw_scene(seed: int, rtol: float, operator: str | None = None) -> tuple[str, Scene]:
    """(kind, scene) of a seed; kinds and operators in turn. `operator` instead of the seed's own."""
    draw = np.random.default_rng((2024, seed))
    kind = KINDS[seed % len(KINDS)]
    operator = operator or OPERATORS[seed % len(OPERATORS)]
    friction, noise, gravity = 1.0, 1.0, float(draw.uniform(-2, 2))
    temperature, speed = float(2 ** draw.uniform(-1, 1)), gravity + float(draw.uniform(-1, 1))
    length, end = math.exp(draw.uniform(0, math.log(60))), float(math.exp(draw.uniform(math.log(0.3), math.log(5))))
    restitution = float(draw.choice([0.0, 0.5, 0.9, 0.999, 0.99999, draw.uniform(0, 1)]))
    number = float(10 ** draw.uniform(-3, 0.65)) if operator == FOLLOW_LEADER else float(10 ** draw.uniform(-6, 2))
    if kind == "cold":
        temperature = float(10 ** draw.uniform(-2, -1))
    elif kind == "hot":
        temperature = float(draw.uniform(4, 15))
    elif kind == "noiseless":
        noise = 0.0
    elif kind == "frictionless":
        friction, noise = 0.0, 1.0
    elif kind == "weightless":
        gravity = 0.0
    # Without noise collisions alone mix, and free motion folds f ever more finely.
    still = kind in ("noiseless", "frictionless")
    end = min(end, 2.0) if still or kind in ("cold", "hot") else end
    if kind == "noiseless" and operator == INELASTIC:
        end = min(end, 0.7)  # a gas that cools far is out of the reference's reach
    initial: dict[str, Any] = {"density": float(2 ** draw.uniform(-1, 1)), "mean_velocity": speed, "temperature": temperature}
    initial |= _profile(kind, draw)
    if kind == "beams":
        share = float(draw.uniform(0.2, 0.8))
        apart = float(draw.uniform(1, 3))
        del initial["mean_velocity"], initial["temperature"]
        initial["beams"] = [
            {"share": share, "mean_velocity": speed - apart, "temperature": float(draw.uniform(0.3, 1))},
            {"share": 1 - share, "mean_velocity": speed + apart, "temperature": float(draw.uniform(0.3, 1))},
        ]
    if kind == "waves":
        initial["velocity_modes"] = [_mode(draw, 0.7)]
        initial["temperature_modes"] = [_mode(draw, 0.5)]
    table: dict[str, Any] = {
        "model": {"gravity": gravity, "friction": friction, "noise": noise},
        "pipe": {"length": length},
        "initial": initial,
        "run": {
            "end_time": end,
            "output_every": end / int(draw.choice([1, 1, 3] if "step" in initial else [1, 1, 1, 3, 10, 30])),
        },
        "accuracy": {"rtol": rtol},
        "output": {"budgets": bool(draw.uniform() < 0.3)},
    }
    if operator is not None:
        table["collisions"] = {"operator": operator, "cross_section": number / initial["density"]}
        if operator == INELASTIC:
            table["collisions"]["restitution"] = restitution
    units = (float(10 ** draw.uniform(-DECADES, DECADES)) for _ in range(3))
    return kind, Scene.model_validate(in_units(table, *units))


def _mode(draw: np.random.Generator, most: float) -> dict[str, Any]:
    amplitude, phase = draw.uniform(0, most), draw.uniform(0, 2 * math.pi)
    return {
        "mode": int(draw.integers(1, 4)),
        "cos": float(amplitude * math.cos(phase)),
        "sin": float(amplitude * math.sin(phase)),
    }


def _profile(kind: str, draw: np.random.Generator) -> dict[str, Any]:
    """The density over x."""
    start = float(draw.uniform(0, 0.5))
    between = {"from": start, "to": start + float(draw.uniform(0.2, 0.5))}
    if kind == "homogeneous":
        return {}
    if kind == "step":
        return {"step": {**between, "ratio": float(10 ** draw.uniform(-1, 1))}}
    if kind == "thin":
        return {"step": {**between, "ratio": float(10 ** draw.uniform(-5, -1))}}
    if kind == "vacuum":
        return {"step": {**between, "ratio": 0.0}}
    if kind == "pulse":
        return {"pulse": {"at": start, "width": float(draw.uniform(0.02, 0.1)), "height": float(10 ** draw.uniform(-1, 1.5))}}
    modes = draw.choice(np.arange(1, 5), size=int(draw.integers(1, 4)), replace=False)
    shares, phases = draw.dirichlet(np.ones(modes.size)) * draw.uniform(0.1, 0.9), draw.uniform(0, 2 * math.pi, modes.size)
    return {
        "modes": [
            {"mode": int(n), "cos": float(a * math.cos(p)), "sin": float(a * math.sin(p))}
            for n, a, p in zip(modes, shares, phases, strict=True)
        ]
    }


def in_units(table: dict[str, Any], length: float, time: float, number: float) -> dict[str, Any]:
    """A scene's tables, its length, time and number of particles multiplied by these: the same physics."""
    speed = length / time
    factors = {
        "model": {"gravity": speed / time, "friction": 1 / time, "noise": speed**2},
        "collisions": {"cross_section": 1 / number},
        "pipe": {"length": length},
        "initial": {"density": number / length, "mean_velocity": speed, "temperature": speed**2},
        "run": {"end_time": time, "output_every": time},
        "grid": {"time_step": time},
    }
    new = {name: dict(keys) for name, keys in table.items()}
    for name, keys in factors.items():
        for key, factor in keys.items():
            if new.get(name, {}).get(key) is not None:
                new[name][key] *= factor
    new["initial"].setdefault("density", number / length)
    waves = new["initial"].get("velocity_modes", ())
    if waves:
        new["initial"]["velocity_modes"] = [{**m, "cos": m["cos"] * speed, "sin": m["sin"] * speed} for m in waves]
    if "beams" in new["initial"]:
        new["initial"]["beams"] = [
            {**b, "mean_velocity": b["mean_velocity"] * speed, "temperature": b["temperature"] * speed**2}
            for b in new["initial"]["beams"]
        ]
    return new


def looked_at(run: xr.Dataset) -> xr.Dataset:
    """Some of the run's points, evenly over both: uniform in x over the period, in v with both ends."""
    nx, axis = run.sizes["x"], velocity_axis(run)
    cells = run.sizes[axis] - 1
    along_x = max((n for n in range(1, nx + 1) if nx % n == 0 and nx // n >= PLACES / 2), default=1)
    along_v = max((n for n in range(1, cells + 1) if cells % n == 0 and cells // n >= VELOCITIES / 2), default=1)
    return run.isel({"x": slice(None, None, along_x), axis: slice(None, None, along_v)})


def reference(scene: Scene, run: xr.Dataset) -> xr.Dataset:
    """The fields at the run's points, by the closed form or by Fourier series. Raises OutOfReach."""
    x, v = run["x"].values, run[velocity_axis(run)].values
    if scene.operator != INELASTIC:
        with np.errstate(all="ignore"):  # in a vacuum there is no mean velocity
            return exact.solve(scene, x=x, v=v)
    found = fourier(scene, REFERENCE * scene.accuracy.rtol, modes_of(scene), float(run["temperature"].min()))
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


def attempt(seed: int, rtol: float, operator: str | None = None, longest: float = math.inf) -> dict[str, Any]:
    """One line of the log; a scene that is foretold to take longer than `longest` seconds is not run."""
    kind, scene = draw_scene(seed, rtol, operator)
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
    count: int, tolerances: Sequence[float], operators: Sequence[str], done: set[tuple[int, float]]
) -> Iterator[tuple[int, float]]:
    for rtol in tolerances:
        for seed in range(count):
            if (OPERATORS[seed % len(OPERATORS)] or "none") in operators and (seed, rtol) not in done:
                yield seed, rtol


def read(log: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


def table(lines: list[dict[str, Any]]) -> str:
    """By kind and operator: worst error/rtol, error/estimate, seconds, how good the foretold time was, refusals."""
    rows = ["| kind | runs | refused | not run | error/rtol, worst and median | error/estimate of f | s, most | foretold/taken |"]
    rows.append("|---|---|---|---|---|---|---|---|")
    names = [
        *((kind, "kind", kind) for kind in KINDS),
        *((str(name or "none"), "operator", str(name or "none")) for name in OPERATORS),
    ]
    for title, key, value in [*names, ("all", "", "")]:
        of_it = [line for line in lines if not key or line[key] == value]
        known = [line for line in of_it if "errors" in line]
        if not known:
            continue
        worst = np.array([max(line["errors"].values()) for line in known])
        shares = np.array([line["errors"]["f"] / max(line["estimate"], 1e-300) for line in known])
        took = [line for line in of_it if "seconds" in line and "refused" not in line]
        ratio = np.array([line["foretold"] / line["seconds"] for line in took])
        refused, longer = (sum(word in line for line in of_it) for word in ("refused", "too_long"))
        rows.append(
            f"| {title} | {len(of_it)} | {refused} | {longer} | {worst.max():.2g}, {np.median(worst):.2g} "
            f"| {shares.min():.1g} to "
            f"{shares.max():.2g} | {max(line['seconds'] for line in took):.2g} | {ratio.min():.2g} to {ratio.max():.2g} |"
        )
    return "\n".join(rows)


def in_silence(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those whose error exceeds rtol, while neither a warning nor the estimate says so."""
    return [line for line in lines if "errors" in line and max(line["errors"].values()) > 1 and not line["said"]]


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--rtol", type=float, nargs="*", default=TOLERANCES)
    parser.add_argument("--operators", nargs="*", default=[name or "none" for name in OPERATORS])
    parser.add_argument("--log", type=Path, default=Path("random_kinds.jsonl"))
    parser.add_argument("--longest", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=3600.0)
    given = parser.parse_args()
    np.seterr(all="ignore")
    done = {(line["seed"], line["rtol"]) for line in read(given.log)}
    until = time.monotonic() + given.seconds
    with given.log.open("a") as log:
        for seed, rtol in scenes_to_do(given.scenes, given.rtol, given.operators, done):
            if time.monotonic() > until:
                break
            line = attempt(seed, rtol, longest=given.longest)
            print(json.dumps(line), file=log, flush=True)
            worst = max(line["errors"].values()) if "errors" in line else math.nan
            print(f"{seed} {rtol:.0e} {line['kind']} {line['operator']}: {worst:.2g} {line.get('refused', '')[:100]}", flush=True)
    lines = read(given.log)
    print(table(lines))
    for line in (bad := in_silence(lines)):
        print("above rtol in silence:", json.dumps(line))
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
