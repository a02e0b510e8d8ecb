"""The random scenes of random_kinds.py, each drawn from its seed: kinds and operators in turn, in random units."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinetic_solver import Scene
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC

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
FURTHER = ("friction", "weak", "early", "high")
"""Kinds apart, without pairs: friction from 1e-5 to 10 where lengths, temperatures and times are about 1; weak friction and noise
so strong that it acts; ends so early that f is hardly changed, from cold and hot starts; waves of high modes."""
DECADES = 6.0
"""Units are random powers of ten, up to this one and down to one over it."""


def draw_scene(seed: int, rtol: float, operator: str | None = None, further: bool = False) -> tuple[str, Scene]:
    """(kind, scene) of a seed; kinds and operators in turn, or of the kinds apart. `operator` instead of the seed's own."""
    if further:
        return _draw_further(seed, rtol)
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


def operator_of(seed: int, further: bool = False) -> str | None:
    """That a seed brings."""
    return OPERATORS[seed % 2] if further else OPERATORS[seed % len(OPERATORS)]


def _draw_further(seed: int, rtol: float) -> tuple[str, Scene]:
    draw = np.random.default_rng((2026, seed))
    kind, operator = FURTHER[seed // 2 % len(FURTHER)], operator_of(seed, further=True)
    friction, temperature = float(10 ** draw.uniform(-5, 1)), float(10 ** draw.uniform(-1.5, 1))
    noise, end, modes = 1.0, float(10 ** draw.uniform(-0.5, 0.7)), (1, 6)
    if kind == "weak":
        friction = float(10 ** draw.uniform(-5, -1))
        noise = min(float(10 ** draw.uniform(0, 3.5)), 0.3 / friction)
    elif kind == "early":
        friction = float(10 ** draw.uniform(-1, 1))
        temperature, end = float(10 ** draw.uniform(-2, 1)), float(10 ** draw.uniform(-4, -0.5)) / friction
    elif kind == "high":
        modes, end = (8, 80), float(10 ** draw.uniform(-1.5, 0.3))
    number = float(10 ** draw.uniform(-4, 0.3))
    amplitude, phase = float(draw.uniform(0.05, 0.9)), float(draw.uniform(0, 2 * math.pi))
    mode = {"mode": int(draw.integers(*modes)), "cos": amplitude * math.cos(phase), "sin": amplitude * math.sin(phase)}
    table: dict[str, Any] = {
        "model": {"gravity": float(draw.uniform(-1, 1)), "friction": friction, "noise": noise},
        "pipe": {"length": float(10 ** draw.uniform(0.3, 1.5))},
        "initial": {
            "density": float(2 ** draw.uniform(-1, 1)),
            "mean_velocity": float(draw.uniform(-2, 2)),
            "temperature": temperature,
            "modes": [mode],
        },
        "run": {"end_time": end, "output_every": end / int(draw.choice([1, 1, 2, 5, 20]))},
        "accuracy": {"rtol": rtol},
        "output": {"budgets": False},
    }
    if operator is not None:
        # R_t is at most about a few, whatever friction and noise are.
        most = math.sqrt(max(temperature, noise)) * min(end, 1 / friction)
        table["collisions"] = {"operator": operator, "cross_section": number / table["initial"]["density"] / max(1.0, most)}
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
