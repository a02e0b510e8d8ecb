"""Changes of grid: exact for what both grids hold, and no change of mass; the output's interpolation against a known f."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.plan.moving_frame import Place
from kinetic_solver.solver.regrid import ToOutput, regrid, resize, window_in_cells

EPS = np.finfo(float).eps
GRID = PhaseSpaceGrid(nx=15, nv=48, length=9.0, low=-6.0, high=7.2)
"""dv = 0.275."""


def waves(count: int, highest: int, shift: float = 0.0) -> np.ndarray:
    """A sum of waves up to `highest` on `count` points of a period, moved by `shift` periods."""
    phase = 2 * np.pi * (np.arange(count) / count - shift)
    return 0.7 + sum(math.cos(3.0 * n) * np.cos(n * phase) + math.sin(5.0 * n) * np.sin(n * phase) for n in range(1, highest + 1))


def gaussian(grid: PhaseSpaceGrid, place: Place | None = None) -> np.ndarray:
    """Two Gaussians in v with three modes in x, far from GRID's edges (9 standard deviations), in the laboratory at `place`."""
    place = place or Place(0.0, 0.0, 0.0, 1.0)
    phase, w = 2 * np.pi * (grid.x - place.position) / grid.length, (grid.v - place.velocity) / place.scale
    first, second = 1 + 0.5 * np.cos(phase) + 0.2 * np.sin(3 * phase), 0.6 - 0.4 * np.sin(2 * phase)
    return (np.outer(first, np.exp(-((w - 0.4) ** 2) / 1.1)) + np.outer(second, np.exp(-((w + 0.1) ** 2) / 0.8))) / place.scale


def mass(grid: PhaseSpaceGrid, f: np.ndarray) -> np.ndarray:
    """Over velocities, at every x."""
    return f.sum(axis=1) * grid.dv


@pytest.mark.parametrize("shift", [0.0, 0.13, -0.4])
@pytest.mark.parametrize("count", [9, 10, 15, 16, 17, 32, 33])
@pytest.mark.parametrize("n", [9, 10, 15, 16])
def test_resize_is_exact_for_waves_below_both_limits(n: int, count: int, shift: float) -> None:
    """Odd and even, up and down, moved and not; along either axis."""
    highest = (min(n, count) - 1) // 2
    line, expected = waves(n, highest), waves(count, highest, shift)
    assert resize(line, count, shift=shift) == pytest.approx(expected, abs=1e-13)
    plane = np.stack([line, 2 * line], axis=1)
    assert resize(plane, count, axis=0, shift=shift) == pytest.approx(np.stack([expected, 2 * expected], axis=1), abs=1e-13)
    assert resize(plane.T, count, axis=1, shift=shift) == pytest.approx(np.stack([expected, 2 * expected]), abs=1e-13)


def test_resize_of_the_shortest_wave() -> None:
    """The cosine of n/2 waves on even n stays itself at the old points on any denser grid, and comes back from it."""
    line = waves(8, 3) + 0.6 * (-1.0) ** np.arange(8)
    assert resize(line, 16)[::2] == pytest.approx(line, abs=1e-14)
    assert resize(line, 24)[::3] == pytest.approx(line, abs=1e-14)
    assert resize(waves(16, 4), 8) == pytest.approx(waves(16, 4)[::2], abs=1e-14)


@given(st.integers(1, 40), st.integers(1, 40), st.floats(-1, 1), st.integers(0, 2**32 - 1))
@settings(max_examples=150)
def test_resize_keeps_means_and_comes_back(n: int, count: int, shift: float, seed: int) -> None:
    """Of any values; up and down again without a shift is the identity."""
    values = np.random.default_rng(seed).normal(size=(n, 3))
    assert resize(values, count, shift=shift).mean(axis=0) == pytest.approx(values.mean(axis=0), abs=1e-14)
    more = max(n, count)
    assert resize(resize(values, more), n) == pytest.approx(values, abs=1e-13)


@st.composite
def changed_grids(draw: st.DrawFn) -> PhaseSpaceGrid:
    """A window of whole cells of GRID's, cropped or extended on either side, and any numbers of points."""
    below, above = draw(st.integers(-12, 20)), draw(st.integers(-12, 20))
    low, high = GRID.low - below * GRID.dv, GRID.high + above * GRID.dv
    cells = GRID.nv + below + above
    nv = draw(st.one_of(st.just(cells), st.integers(8, 120)))
    return PhaseSpaceGrid(draw(st.integers(1, 40)), nv, GRID.length, low, high)


@given(changed_grids(), st.integers(0, 2**32 - 1))
@settings(max_examples=150)
def test_regrid_keeps_the_mass(new: PhaseSpaceGrid, seed: int) -> None:
    """Of every x, to round-off, whatever f is, and whatever it loses: cropped, extended, refined, coarsened."""
    f = np.random.default_rng(seed).uniform(0, 1, (GRID.nx, GRID.nv))
    moved = regrid(f, GRID, new)
    assert moved.shape == (new.nx, new.nv)
    assert mass(new, moved) == pytest.approx(resize(mass(GRID, f), new.nx), rel=1e-13)
    at_every_x = dataclasses.replace(new, nx=GRID.nx)
    assert mass(at_every_x, regrid(f, GRID, at_every_x)) == pytest.approx(mass(GRID, f), rel=1e-13)


@pytest.mark.parametrize(
    "new",
    [
        GRID,
        dataclasses.replace(GRID, nx=27),
        dataclasses.replace(GRID, nx=9),
        dataclasses.replace(GRID, nv=64),
        dataclasses.replace(GRID, nv=72),
        dataclasses.replace(GRID, nv=37),
        window_in_cells(GRID, -9.0, 12.0),
        window_in_cells(GRID, -5.7, 6.5),
        dataclasses.replace(window_in_cells(GRID, -5.7, 9.0), nx=21, nv=81),
    ],
)
def test_regrid_of_a_resolved_gaussian(new: PhaseSpaceGrid) -> None:
    """Point values on the new grid. The narrower Gaussian, θ = 0.4, has the spectrum exp(-0.2 q²): 5e-12 at GRID's π/dv, 2e-7
    at that of nv = 37."""
    error = np.abs(regrid(gaussian(GRID), GRID, new) - gaussian(new)).max()
    assert error < (1e-6 if new.nv == 37 else 1e-11)


def test_cropped_cells_are_added_to_the_last_that_stay() -> None:
    f = np.arange(1.0, 9.0)[None].repeat(2, axis=0)
    old = PhaseSpaceGrid(2, 8, 1.0, 0.0, 8.0)
    assert regrid(f, old, PhaseSpaceGrid(2, 4, 1.0, 2.0, 6.0))[1] == pytest.approx([1 + 2 + 3, 4, 5, 6 + 7 + 8], rel=1e-15)
    assert regrid(f, old, PhaseSpaceGrid(2, 9, 1.0, 1.0, 10.0))[0] == pytest.approx([1 + 2, 3, 4, 5, 6, 7, 8, 0, 0], rel=1e-15)


@given(st.floats(-15, -0.5), st.floats(0.5, 15))
@settings(max_examples=100)
def test_window_in_cells(low: float, high: float) -> None:
    """Same dv, holds what was asked, by less than a cell more on either side, with faces on the old grid's lattice."""
    new = window_in_cells(GRID, low, high)
    assert new.dv == pytest.approx(GRID.dv, rel=1e-13)
    slack = 1e-8 * GRID.dv
    assert low - GRID.dv - slack < new.low <= low + slack
    assert high - slack <= new.high < high + GRID.dv + slack
    assert new.nx == GRID.nx
    cells = (GRID.low - new.low) / GRID.dv
    assert cells == pytest.approx(round(cells), abs=1e-9)


def test_to_output_is_the_same_array_where_nothing_moves() -> None:
    f = gaussian(GRID)
    assert ToOutput(GRID, dataclasses.replace(GRID))(f, Place(0.3, 0.0, 0.0, 1.0)) is f


@pytest.mark.parametrize("place", [Place(1.0, 0.0, 0.0, 1.0), Place(1.0, 2.3, -1.7, 1.0), Place(1.0, -31.4, 5.0, 0.4)])
def test_to_output_against_a_known_f(place: Place) -> None:
    """F(x - X, (v - U)/λ)/λ of a resolved Gaussian F at points that are not the solver's, more of them in x as in v; 0 outside
    what the solver holds, where a periodic interpolant would go on."""
    target = PhaseSpaceGrid(21, 150, GRID.length, -14.0, 19.0)
    found, truth = ToOutput(GRID, target)(gaussian(GRID), place), gaussian(target, place)
    assert np.abs(found - truth).max() < 1e-11 * truth.max()
    w = (target.v - place.velocity) / place.scale
    outside = (w < GRID.low) | (w > GRID.high)
    assert outside.any()
    assert not found[:, outside].any()


def test_to_output_keeps_the_mass_over_x() -> None:
    place = Place(1.0, 2.3, 0.0, 1.0)
    field = mass(GRID, gaussian(GRID))
    moved = ToOutput(GRID, dataclasses.replace(GRID, nx=33)).along_x(field, place)
    assert moved.mean() == pytest.approx(field.mean(), rel=4 * EPS)
