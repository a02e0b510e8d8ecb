"""Random scenes of every kind, in random units, meet their rtol, and no estimate is below the error: benchmarks/random_kinds.py.

Without collisions and with (6) against the closed form; with (12) against Fourier series (tests/reference/fourier_inelastic.py).
"""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.random_kinds import attempt
from benchmarks.random_kinds_scenes import KINDS, OPERATORS
from benchmarks.random_kinds_tables import underrated
from kinetic_solver.scene import INELASTIC

RTOL = 1e-3
ROUND = len(KINDS) * len(OPERATORS)
"""Seeds, after which every kind has had every operator."""
CLOSED = [seed for seed in range(ROUND) if OPERATORS[seed % len(OPERATORS)] != INELASTIC]
WITH_PAIRS = [5, 17, 23, 35]
"""Cold, waves, beams, without gravity: those that take less than a second, their references too."""
WEAK = [(5, 1e-4), (23, 1e-4), (26, 1e-4), (50, 1e-3), (50, 1e-4)]
"""Seeds and rtol of (12), few collisions in few steps, where errors once exceeded what was told, up to four times."""
HARD_TO_RATE = [(16, 1e-3), (88, 1e-4), (112, 1e-3), (121, 1e-3), (148, 1e-6), (283, 1e-6), (310, 1e-6)]
"""Seeds and rtol whose errors come of what is easily overlooked: the highest waves in x together (16), a start of few of them
(148), the kernel's points (88), waves in v between the points (112, 121, 283, 310)."""
APART = [9, 17, 72, 10, 67, 107, 115, 4, 29, 53, 61, 7, 71, 31]
"""Of the kinds apart, those whose references take less than a tenth of a second."""
LONGEST = 0.5
"""Seconds that a run may be foretold to take, here."""


def check(line: dict[str, Any]) -> None:
    """Right, or refused by a key, or said."""
    if "refused" in line:
        assert "allowed" in line["refused"], line
        return
    assert max(line["errors"].values()) <= 1 or line["said"], line
    assert not underrated([line]), line


@pytest.mark.parametrize("seed", CLOSED)
def test_against_the_closed_form(seed: int) -> None:
    line = attempt(seed, RTOL, longest=LONGEST)
    if "too_long" not in line:
        check(line)


@pytest.mark.parametrize(("seed", "rtol"), HARD_TO_RATE)
def test_estimates_are_no_less_than_errors(seed: int, rtol: float) -> None:
    line = attempt(seed, rtol)
    assert line["errors"]["f"] <= line["estimate"] <= 1, line


@pytest.mark.parametrize(("seed", "rtol"), WEAK)
def test_estimates_of_few_steps(seed: int, rtol: float) -> None:
    """From the error, but for what the series may be off, to 60 times that."""
    line = attempt(seed, rtol)
    assert 1 / 60 < line["errors"]["f"] / line["estimate"] < 1, line
    assert line["estimate"] <= 1, line


@pytest.mark.parametrize(("seed", "rtol"), [*((seed, 1e-4) for seed in APART), (15, 1e-6)])
def test_weak_friction_early_ends_and_high_modes(seed: int, rtol: float) -> None:
    line = attempt(seed, rtol, longest=LONGEST, further=True)
    if "too_long" not in line:
        check(line)


@pytest.mark.parametrize("seed", WITH_PAIRS)
def test_operator_12_against_fourier_series(seed: int) -> None:
    line = attempt(seed, RTOL, longest=LONGEST)
    assert line["operator"] == INELASTIC
    check(line)
