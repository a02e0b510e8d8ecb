"""Particles drawn from starts other than one Maxwellian, in standard errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver import Scene, exact
from particles import simulate

MakeScene = Callable[..., Scene]
BEAMS = [
    {"share": 0.35, "mean_velocity": -1.7, "temperature": 0.2},
    {"share": 0.65, "mean_velocity": 1.4, "temperature": 0.6},
]
PULSE = {"at": 0.9, "width": 0.06, "height": 2.5}


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_beams_and_a_pulse_against_the_closed_form(make_scene: MakeScene, seed: int) -> None:
    """f's marginal w(v), and the density's waves, at the start and later."""
    scene = make_scene(
        initial={"modes": [], "beams": BEAMS, "pulse": PULSE},
        run={"end_time": 0.6},
        particles={"count": 5000, "replicas": 12, "seed": seed},
    )
    run = simulate(scene)
    x = 9.0 / 64 * np.arange(64)
    truth = exact.solve(scene, x=x, v=run["v"].values)
    for frame in (0, 1):
        ours, stderr = run["velocity_distribution"].values[frame], run["velocity_distribution_stderr"].values[frame]
        seen = truth["velocity_distribution"].values[frame]
        counted = seen > 1e-3 * seen.max()
        # Counts in cells of width dv lie above or below a point value by dv²w''/24.
        dv = float(run["v"][1] - run["v"][0])
        smoothed = seen + np.gradient(np.gradient(seen, dv), dv) * dv**2 / 24
        z = (ours - smoothed)[counted] / stderr[counted]
        assert 0.4 < np.mean(z**2) < 2.2
        modes = np.fft.rfft(truth["density"].values[frame])[1:9] / 64 / 0.8
        ours_modes = run["density_mode_real"].values[frame] + 1j * run["density_mode_imag"].values[frame]
        mean, spread = ours_modes.mean(axis=0), ours_modes.std(axis=0, ddof=1) / np.sqrt(12)
        assert np.all(np.abs(mean - modes) < 5 * spread)
