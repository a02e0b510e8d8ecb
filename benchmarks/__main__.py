"""Benchmarks one after another. Each checks its answers, and the first that fails ends the series.

    python -m benchmarks [all]

`all` adds the statistical ones and the long runs: ten minutes each, clusters forty.
"""

from __future__ import annotations

import subprocess
import sys

NAMES = (
    "collision_operator",
    "own_laws",
    "linear_step",
    "transforms",
    "long_pipes",
    "work_precision",
    "time_steppers",
    "live_file",
    "accuracy_rules",
    "accuracy_cost",
    "random_scenes",
    "hard_cases",
    "density_steps",
    "linear_theory",
    "hydrodynamics",
    "heat_flux",
    "descriptions",
    "particles_speed",
    "time_to_accuracy",
    "sweeps",
)

LONG = ("particles_validation", "comparison", "clusters", "long_runs")

if __name__ == "__main__":
    for name in (*NAMES, *(LONG if sys.argv[1:] == ["all"] else ())):
        print(f"\n== {name}", flush=True)
        if code := subprocess.run([sys.executable, "-m", f"benchmarks.{name}"]).returncode:
            sys.exit(code)
