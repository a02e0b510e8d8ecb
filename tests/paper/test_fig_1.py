"""The paper's Fig. 1: the critical density of its closure over the mode number, as numbers, as a picture, by the command."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from kinetic_solver.analysis.figure_1 import save_figure_1
from kinetic_solver.stability import critical_collision_number, figure_1

Command, Draw = Callable[..., subprocess.CompletedProcess[str]], Callable[..., Figure]


def test_the_numbers() -> None:
    """Falls with n to the paper's 12000, and its modes are those of the pipe."""
    figure = figure_1(length=5.0, modes=[1, 2, 10, 200])
    rho = figure["critical_density"].values
    assert (np.diff(rho) < 0).all()
    assert rho[-1] == pytest.approx(12_000, rel=1e-4)
    expected = critical_collision_number(2 * math.pi * 2 / 5.0)
    assert float(figure["critical_collision_number"].sel(mode=2)) == pytest.approx(expected)


def test_the_picture(draw: Draw) -> None:
    """ρ_c falls towards 12000; the right axis is R*_c, 7√3/9 there; L* and S's units are in the picture."""
    figure = draw(save_figure_1, figure_1(length=13.0, modes=range(1, 21)))
    (axes,) = figure.axes
    (drawn,) = (np.asarray(line.get_ydata()) for line in axes.get_lines() if line.get_marker() == "o")
    assert (np.diff(drawn) < 0).all()
    assert drawn[-1] == pytest.approx(12_000, rel=2e-3)
    (right,) = axes.child_axes
    assert right.get_ylim()[1] / axes.get_ylim()[1] == pytest.approx(7 * math.sqrt(3) / 9 / 12_000, rel=1e-9)
    caption = figure.get_supxlabel()
    assert all(part in caption for part in ("linearly stable at every density", "L* = 13", "γ/(12000 √σ)"))


def test_the_command(command: Command, tmp_path: Path) -> None:
    done = command("stability", "--figure", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "figure_1.png").stat().st_size > 20_000
    with xr.open_dataset(tmp_path / "figure_1.nc") as figure:
        rho = figure["critical_density"].values
        assert (np.diff(rho) < 0).all()
        assert 12_000 < rho[-1] < 12_200
