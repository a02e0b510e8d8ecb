"""All benchmarks, one after another. Each checks its answers, and the first that fails ends the series."""

from __future__ import annotations

import subprocess
import sys

NAMES = (
    "collision_operator",
    "linear_step",
    "work_precision",
    "time_steppers",
    "live_file",
    "accuracy_rules",
    "accuracy_cost",
    "random_scenes",
    "hard_cases",
    "linear_theory",
    "particles_speed",
    "particles_validation",
    "comparison",
    "time_to_accuracy",
    "clusters",
)

if __name__ == "__main__":
    for name in NAMES:
        print(f"\n== {name}", flush=True)
        if code := subprocess.run([sys.executable, "-m", f"benchmarks.{name}"]).returncode:
            sys.exit(code)
