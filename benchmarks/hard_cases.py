"""Hard cases by name: each meets its rtol, or says in one line why it does not.

`python -m benchmarks.hard_cases [rtol ...] [--only TEXT]` runs every case with everything chosen from rtol and prints a markdown
table: grid, the largest error over what rtol allows (docs/accuracy.md) of f, density, mean velocity and temperature over all
frames, the run's own estimate, seconds of a second run, mass drift, budget residuals, least f, and what the run said. Operator
(6) and no collisions are held against the closed form, which is itself checked against integrals over its f; operator (12)
against a refined run on a wider window, the law of momentum, which its collisions keep, and at
500/γ the stationary state. Fails where an answer is wrong and nothing says so, where numpy warns, and where a refusal is not one
line that names a key.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import argparse
import csv
import math
import re
import signal
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.random_scenes import interpolation
from kinetic_solver import Scene, SceneError, SolverStopped, exact, solve
from kinetic_solver.arrays import Array
from kinetic_solver.initial import start_state
from kinetic_solver.plan import make_plan
from kinetic_solver.plan.in_x import fast_odd
from kinetic_solver.scene import INELASTIC
from kinetic_solver.stability.homogeneous import homogeneous_state

TABLE = Path(__file__).parents[1] / "docs" / "data" / "hard_cases.csv"
LIMIT = 60.0
"""Seconds of the processor that a case may take."""
MOST_POSITIONS = 189
"""At which a run is held against the closed form."""
FIELDS = ("f", "density", "mean_velocity", "temperature")
KEY = re.compile(r"\b(model|collisions|pipe|initial|run|output|accuracy|grid)\.[a-z_]+")
"""What a refusal must name at least once."""

Tables = dict[str, dict[str, Any]]


class OutOfTimeError(Exception):
    """A call took longer than it may."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raises OutOfTimeError in the block after `seconds` of the processor, and again each second: compiled code may swallow the
    first."""

    def late(number: int, frame: FrameType | None) -> None:
        raise OutOfTimeError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


# The cases.

BASE: Tables = {
    "model": {"gravity": 1.0, "friction": 1.0, "noise": 1.0},
    "pipe": {"length": 8 * math.pi},
    "initial": {"density": 1.0, "modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]},
    "run": {"end_time": 2.0, "output_every": 1.0},
}
NEAR_VACUUM = {"modes": [{"mode": 1, "cos": 1 - 2e-10}]}
AT_REST = {"temperature": 1.0, "mean_velocity": 0.0}


def follow(cross_section: float) -> dict[str, Any]:
    return {"operator": "follow-the-leader", "cross_section": cross_section}


def inelastic(restitution: float, cross_section: float) -> dict[str, Any]:
    return {"operator": "inelastic", "restitution": restitution, "cross_section": cross_section}


def a_step(ratio: float) -> dict[str, Any]:
    return {"modes": [], "step": {"from": 0.2, "to": 0.5, "ratio": ratio}}


def until(end: float, frames: int = 2) -> dict[str, float]:
    return {"end_time": end, "output_every": end / frames}


def _cases() -> dict[str, Tables]:
    """What each case changes of BASE."""
    cases: dict[str, Tables] = {
        "(6), R* = 5": {"collisions": follow(5.0)},
        "(6), R* = 8": {"collisions": follow(8.0)},
        "(6), a step, ratio 3": {"collisions": follow(2.0), "initial": a_step(3.0)},
        "(6), a step, vacuum outside": {"collisions": follow(2.0), "initial": a_step(0.0)},
        "(6), near vacuum, R* = 1": {"collisions": follow(1.0), "initial": NEAR_VACUUM},
        "(6), near vacuum, R* = 5": {"collisions": follow(5.0), "initial": NEAR_VACUUM},
        "(12), near vacuum": {"collisions": inelastic(0.5, 1.0), "initial": NEAR_VACUUM},
        "(12), vacuum outside a step": {"collisions": inelastic(0.5, 1.0), "initial": a_step(0.0)},
        "(12), ε = 0, Sρ = 100": {"collisions": inelastic(0.0, 100.0)},
        "(12), ε = 0.999, Sρ = 1": {"collisions": inelastic(0.999, 1.0)},
        "(12), ε = 0.999, Sρ = 10": {"collisions": inelastic(0.999, 10.0)},
    }
    for name, operator in (("(6)", follow(2.0)), ("(12)", inelastic(0.5, 1.0)), ("none", follow(0.0))):
        every: dict[str, Tables] = {
            "frames 10/γ apart": {"run": until(20.0)},
            "time_step = 10/γ": {"run": until(20.0), "grid": {"time_step": 10.0}},
            "γ = 1e-8, started at rest": {"model": {"friction": 1e-8}, "initial": AT_REST},
            "γ = 1e-8, homogeneous u0": {"model": {"friction": 1e-8}},
            "γ = 0": {"model": {"friction": 0.0}, "initial": AT_REST},
            "g = 100, started at rest": {"model": {"gravity": 100.0}, "initial": {"mean_velocity": 0.0}},
            "g = 100": {"model": {"gravity": 100.0}},
            "σ = 1e-4 θ0": {"model": {"noise": 1e-4}, "initial": {"temperature": 1.0}},
            "σ = 0": {"model": {"noise": 0.0}, "initial": {"temperature": 1.0}},
            "θ0 = 5σ": {"initial": {"temperature": 5.0}},
            "θ0 = 0.01σ": {"initial": {"temperature": 0.01}},
            "t = 500/γ": {"run": until(500.0)},
            "L* = 0.1": {"pipe": {"length": 0.1}},
            "L* = 1000": {"pipe": {"length": 1000.0}},
        }
        cases |= {f"{name}, {label}": {"collisions": operator, **changes} for label, changes in every.items()}
    return cases


CASES = _cases()
VACUUM = ("vacuum outside",)
"""Where ρ = 0 there is no u and no θ: ρu and ρθ stand for them there."""


def hard_scene(name: str, rtol: float) -> Scene:
    """The scene of a case."""
    changes = CASES[name]
    table = {key: {**BASE.get(key, {}), **changes.get(key, {})} for key in BASE.keys() | changes.keys()}
    return Scene.model_validate({**table, "accuracy": {"rtol": rtol}})


# What a run is held against.


def chosen_positions(nx: int, most: int = MOST_POSITIONS) -> Array:
    """Indices of at most so many points, evenly spread."""
    return np.unique(np.linspace(0, nx - 1, min(nx, most)).round().astype(int))


def closed_form(scene: Scene, x: Array, v: Array, speed: float = 0.0) -> xr.Dataset:
    """The exact solution at the scene's frames at any points, seen from a frame in which the scene's own moves at `speed`."""
    frames = []
    for moment in scene.times():
        solution, place = exact.Solution(scene, float(moment)), np.mod(x - speed * moment, scene.pipe.length)
        rho, u, theta, _ = solution.moments(place)
        frames.append((solution.distribution(place, v - speed), rho, speed + u, theta))
    dims = {"f": ("time", "x", "v")} | dict.fromkeys(FIELDS[1:], ("time", "x"))
    data = {name: (dims[name], np.array([frame[i] for frame in frames])) for i, name in enumerate(FIELDS)}
    return xr.Dataset(data, coords={"time": scene.times(), "x": x, "v": v})


def closed_form_defect(scene: Scene) -> float:
    """How far the closed form is from itself at the end: its density, ρu and ρθ from integrals over its f at a few positions,
    and its mass from the sum over many; relative to the largest."""
    solution = exact.Solution(scene, scene.run.end_time)
    many = scene.pipe.length / 1575 * np.arange(1575)
    rho, u, theta, _ = solution.moments(many)
    defects = [abs(rho.mean() / scene.initial.density - 1)]
    for i in np.argsort(rho)[:: -(many.size // 4)]:
        reach = 12 * math.sqrt(float(theta[i])) + 2 * scene.cross_section * float(rho[i] * theta[i])
        v = u[i] + np.linspace(-reach, reach, 6001)
        f = solution.distribution(many[i : i + 1], v)[0]
        dv, w = v[1] - v[0], v - u[i]
        scale, thermal = float(rho.max()), math.sqrt(float(theta.max()))
        defects += [abs(f.sum() * dv - rho[i]) / scale, abs(f @ w) * dv / (scale * thermal)]
        defects.append(abs(f @ w**2 * dv - rho[i] * theta[i]) / (scale * thermal**2))
    return float(max(defects))


def without_friction(scene: Scene) -> tuple[Scene, float]:
    """The limit γ → 0 at the start's own acceleration g - γu0, in the frame of u0, and u0; for γ = 1e-8 as good as the scene
    itself to some 1e-7. The closed form needs ever more nodes where noise is that weak."""
    u0, theta0 = start_state(scene)
    model = scene.model.model_copy(update={"friction": 0.0, "gravity": scene.model.gravity - scene.model.friction * u0})
    start = scene.initial.model_copy(update={"mean_velocity": 0.0, "temperature": theta0})
    return scene.model_copy(update={"model": model, "initial": start}), u0


def distance_from_rest(scene: Scene, run: xr.Dataset) -> float:
    """How far the last frame is from the homogeneous stationary state: ρ, u and θ, over what rtol allows."""
    state = homogeneous_state(scene)
    assert state is not None
    last, rtol = run.isel(time=-1), scene.accuracy.rtol
    speed = max(abs(state.mean_velocity), math.sqrt(state.temperature))
    return max(
        float(abs(last["density"] / scene.initial.density - 1).max()) / rtol,
        float(abs(last["mean_velocity"] - state.mean_velocity).max()) / (speed * rtol),
        float(abs(last["temperature"] / state.temperature - 1).max()) / rtol,
    )


def refined(scene: Scene, run: xr.Dataset) -> xr.Dataset:
    """A run at a thirtieth of rtol, with 1.4 times the points in x and v on a wider window; in a moving frame, where the output
    has many more velocities than it takes, with all chosen from rtol. Brought to the run's points by trigonometric interpolation,
    which is exact for what both grids hold: f, ρ, ρu and ρ(u² + θ)."""
    nx, v, length = run.sizes["x"], run["v"].values, scene.pipe.length
    table = {**scene.model_dump(exclude_none=True, by_alias=True), "accuracy": {"rtol": max(1e-10, scene.accuracy.rtol / 30)}}
    if not make_plan(scene).reference_frame.moving:
        dv = float(v[1] - v[0])
        low, high = float(v[0]) - 0.1 * dv * v.size, float(v[-1]) + 0.1 * dv * v.size
        fast = 1 if nx == 1 else fast_odd(math.ceil(1.4 * nx))
        points = math.ceil(1.4 * (high - low) / dv)
        table["grid"] = {"nx": fast, "nv": points, "velocity_window": (low, high), "deposit": "quintic"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fine = solve(Scene.model_validate(table))
    w = fine["v"].values
    inside = (v > w[0]) & (v < w[-1])
    along_v = np.where(inside[:, None], interpolation(w - w[0], v - w[0], (w[-1] - w[0]) * w.size / (w.size - 1)), 0.0)
    along_x = interpolation(fine["x"].values, run["x"].values, length)
    rho, u, theta = (fine[name].values for name in FIELDS[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = float(np.nanmean(u))
        u = u - rest  # else u² rounds θ away in a fast flow
        rho, p, energy = (values @ along_x.T for values in (rho, rho * u, rho * (u**2 + theta)))
        fields = {"density": rho, "mean_velocity": p / rho + rest, "temperature": energy / rho - (p / rho) ** 2}
    f = along_x @ fine["f"].values @ along_v.T
    data = {"f": (run["f"].dims, f)} | {name: (run[name].dims, values) for name, values in fields.items()}
    return xr.Dataset(data, coords={name: run[name] for name in ("time", "x", "v")})


def ratios(run: xr.Dataset, truth: xr.Dataset, rtol: float, vacuum: bool = False) -> dict[str, float]:
    """Error over what rtol allows, the largest over the frames, each frame by its own maxima: f, density and temperature of
    theirs, mean velocity of max(|u|, √θ). With `vacuum`, of ρθ and ρu."""
    worst = dict.fromkeys(FIELDS, 0.0)
    for i in range(truth.sizes["time"]):
        ours, theirs = ({name: data[name].values[i] for name in FIELDS} for data in (run, truth))
        top = {name: float(np.abs(theirs[name]).max()) for name in ("f", "density")}
        if np.isnan(theirs["temperature"]).all():  # interpolated between points, some of which are missing
            theirs |= {name: ours[name] for name in ("mean_velocity", "temperature")}
        top["temperature"] = float(np.nanmax(theirs["temperature"]))
        top["mean_velocity"] = max(float(np.nanmax(np.abs(theirs["mean_velocity"]))), math.sqrt(top["temperature"]))
        if vacuum:
            for fields in (ours, theirs):
                for name in ("mean_velocity", "temperature"):
                    fields[name] = np.where(fields["density"] == 0, 0.0, fields["density"] * fields[name])
                    top[name] *= top["density"] if fields is theirs else 1.0
        for name in FIELDS:
            difference = np.abs(ours[name] - theirs[name])
            if name in ("mean_velocity", "temperature"):  # missing values are said to be missing
                difference = difference[(ours["density"] >= rtol * ours["density"].max()) & np.isfinite(theirs[name])]
            error = float(difference.max()) / (top[name] * rtol)
            worst[name] = max(worst[name], error if math.isfinite(error) else math.inf)
    return worst


def momentum_ratio(scene: Scene, run: xr.Dataset) -> float:
    """|P - P(t)| over rtol M max(|u|, √θ), P' = gM - γP: collisions of (12) keep momentum."""
    g, gamma = scene.model.gravity, scene.model.friction
    t, p, mass = run["time"].values, run["momentum"].values, float(run["mass"][0])
    gained = t if gamma == 0 else -np.expm1(-gamma * t) / gamma
    law = p[0] * np.exp(-gamma * t) + g * mass * gained
    scale = max(float(abs(run["mean_velocity"]).max()), math.sqrt(float(run["temperature"].max())))
    return float(np.abs(p - law).max()) / (mass * scale * scene.accuracy.rtol)


def budget_residual(run: xr.Dataset, kind: str) -> float:
    """The residual of "momentum" or "energy" over the sum of what its terms brought and its first value, all taken positive."""
    terms = [run[name] for name in run.data_vars if str(name).startswith(f"{kind}_from_")]
    scale = sum((abs(term) for term in terms), abs(run[kind][0]))
    return float((abs(run[f"{kind}_residual"]) / scale.max()).max())


# A case, run.


@dataclass
class Outcome:
    """What came of a case."""

    grid: str = ""
    seconds: float = math.nan
    compiling: float = math.nan
    errors: dict[str, float] = field(default_factory=dict)
    """Over what rtol allows."""
    mass_drift: float = math.nan
    momentum_residual: float = math.nan
    energy_residual: float = math.nan
    minimum: float = math.nan
    """Of f over its maximum, in the frames after 0."""
    estimate: float = math.nan
    """The run's own estimate of f's error, over rtol."""
    truth: str = ""
    said: str = ""
    """The refusal, the stop, or the first warning."""
    refused: bool = False
    faults: list[str] = field(default_factory=list)
    """Wrong in silence, noise, a crash, a refusal that does not help."""

    @property
    def worst(self) -> tuple[float, str]:
        return max(((value, name) for name, value in self.errors.items()), default=(math.nan, ""))


def refusal_faults(line: str) -> list[str]:
    """What is wrong with a message that is to be one line and to name a key."""
    found = [] if "\n" not in line else ["its message has several lines"]
    return found if KEY.search(line) else [*found, "its message names no key"]


def measure(name: str, rtol: float, limit: float = LIMIT, thorough: bool = True, positions: int = MOST_POSITIONS) -> Outcome:
    """Run a case and compare, with the closed form at so many positions. `thorough`: time a second run, without compilation, and
    check the closed form."""
    out = Outcome()
    scene = hard_scene(name, rtol)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            run = _run(scene, out, limit, repeat=thorough)
        except OutOfTimeError:
            out.said = f"more than {limit:.0f} s"
            return out
        except (SceneError, SolverStopped) as refusal:
            out.said, out.refused = str(refusal), True
            out.faults += refusal_faults(out.said)
            run = None
        except Exception as error:
            out.faults.append(f"{type(error).__name__}: {error}")
            return out
    for warning in caught:
        if issubclass(warning.category, UserWarning):
            out.said = out.said or str(warning.message)
        else:
            noise = f"{warning.category.__name__}: {warning.message}"
            out.faults += [] if noise in out.faults else [noise]
    if run is None:
        return out
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with limited(2 * limit):
                _compare(name, scene, run, out, thorough, positions)
        except OutOfTimeError:
            out.truth = "none in time"
        except Exception as error:
            out.truth = f"none: {type(error).__name__}: {error}"
    out.faults += sorted({f"in the truth: {warning.message}" for warning in caught})
    if not out.worst[0] <= 1 and out.errors and not out.said:
        out.faults.append("wrong in silence")
    if out.mass_drift > 1e-12:
        out.faults.append("mass drifts")
    return out


def _run(scene: Scene, out: Outcome, limit: float, repeat: bool) -> xr.Dataset:
    began = time.process_time()
    with limited(limit):
        grid = make_plan(scene).grid
        out.grid = f"{grid.nx} × {grid.nv}"
        run = solve(scene)
    out.seconds = first = time.process_time() - began
    if repeat and first < limit / 3:
        began = time.process_time()
        run = solve(scene)
        out.seconds = time.process_time() - began
        out.compiling = max(0.0, first - out.seconds)
    return run


def _compare(name: str, scene: Scene, run: xr.Dataset, out: Outcome, thorough: bool, positions: int) -> None:
    rtol, vacuum = scene.accuracy.rtol, any(word in name for word in VACUUM)
    mass = run["mass"].values
    out.mass_drift = float(np.abs(mass / mass[0] - 1).max())
    out.minimum = float(run["minimum_of_f"][1:].min())
    if "error_estimate" in run:
        out.estimate = float(run["error_estimate"].max()) / rtol
    if scene.output.budgets is not False:
        out.momentum_residual, out.energy_residual = budget_residual(run, "momentum"), budget_residual(run, "energy")
    if scene.operator == INELASTIC:
        out.errors["momentum"] = momentum_ratio(scene, run)
        if scene.run.end_time * scene.model.friction > 100:
            out.errors["stationary_state"], out.truth = distance_from_rest(scene, run), "stationary state"
            return
        truth, out.truth = refined(scene, run), "refined"
        if scene.initial.step is not None:  # shown as it is at time 0, which no interpolation in x carries over
            run, truth = run.isel(time=slice(1, None)), truth.isel(time=slice(1, None))
    else:
        speed = 0.0
        if 0 < scene.model.friction < 1e-6:
            if rtol < 1e-6:
                out.truth = "none: the limit γ → 0 is good to 1e-7 only"
                return
            scene, speed = without_friction(scene)
        run = run.isel(x=chosen_positions(run.sizes["x"], positions))
        truth = closed_form(scene, run["x"].values, run["v"].values, speed)
        out.truth = "closed form"
        if thorough and (defect := closed_form_defect(scene)) > 0.1 * rtol:
            out.faults.append(f"the closed form contradicts itself by {defect:.1e}")
    out.errors |= ratios(run, truth, rtol, vacuum)


def row(name: str, rtol: float, out: Outcome) -> str:
    """One line of the table."""
    value, which = out.worst
    error = f"{value:.2g} ({which.replace('_', ' ')})" if out.errors else "–"

    def number(value: float, form: str = ".0e") -> str:
        return "–" if math.isnan(value) else format(value, form)

    budgets = f"{number(out.momentum_residual)}, {number(out.energy_residual)}"
    notes = "; ".join([*(f"**{fault}**" for fault in out.faults), *filter(None, [out.said])])
    if out.truth.startswith("none"):
        notes = "; ".join(filter(None, [notes, f"truth {out.truth}"]))
    cells = (
        *(name, f"{rtol:.0e}", out.grid, error, number(out.estimate, ".1g"), number(out.seconds, ".2f"), number(out.mass_drift)),
        *(budgets, number(out.minimum), notes),
    )
    return "| " + " | ".join(cell.replace("|", "∣") for cell in cells) + " |"


def keep(name: str, rtol: float, out: Outcome) -> None:
    """The row of docs/accuracy.md, in its place among the others."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    _, _, grid, error, _, seconds, drift, budgets, minimum, said = (
        cell.strip() for cell in row(name, rtol, out)[2:-2].split(" | ")
    )
    new = [name, f"{rtol:.0e}", grid, said if error == "–" else error, seconds, drift, budgets, minimum]
    rows = [new if old[:2] == new[:2] else old for old in rows]
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *(rows if new in rows else [*rows, new])])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rtol", nargs="*", type=float, default=[1e-3, 1e-6])
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name contains this")
    arguments = parser.parse_args()
    print("| case | rtol | grid | error/rtol | estimate/rtol | s | mass drift | budgets p, E | min f | said |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    count = 0
    for name in CASES:
        if arguments.only in name:
            for rtol in arguments.rtol:
                out = measure(name, rtol)
                count += bool(out.faults)
                print(row(name, rtol, out), flush=True)
                keep(name, rtol, out)
    print(f"\n{count} faulty")
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main())
