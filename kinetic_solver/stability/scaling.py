"""States of (12) without a scale of their own, whose shape in w = (v - u)/√θ depends on ε alone: free cooling, and white noise.

- Without friction and noise θ falls for ever and f keeps a fixed shape over w: 0 = -κ ∂(wf) + C[f], at S = ρ = θ = 1, with
  dθ/dt = -2κ Sρ θ^{3/2}.
- For R* → ∞ friction does nothing beside noise of a given power γσ and collisions: 0 = κ ∂²f + C[f], γσ = κ Sρ θ^{3/2}.

κ is the rate at which collisions take energy: (1 - ε²)/√π of a Maxwellian (Haff 1983). By galerkin.py's method.
Tests: tests/exact/test_scaling_states.py.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.stability.galerkin import DIGITS, StationaryInWaves, tail_end
from kinetic_solver.threads import one_blas_thread

MOST_ELASTIC = 0.9999
"""ε up to which a state is given. Towards 1 that of free cooling becomes two delta peaks: more of them take over a second."""
PEAK_WIDTH = 1.42
"""Of either peak of the cooling state, over ((1 - ε)/2)^{1/3}: it balances a drift of the second degree about the peak. Fitted
to a2 at ε = 0.9 and 0.98; it only makes the guess and its points."""
POINTS = 5.0
"""Points a width of the narrowest feature: converged to round-off of a2, 1e-10, at every ε tried."""
BETWEEN_PEAKS = 2.5
"""By how much half the period exceeds the window's reach: collisions of one peak with the other must not see images. Chosen: with
1.5 some ε above 0.99 failed."""
EDGE_LAYER = 0.1
"""Width of the absorbing layer at the edge of the cooling state's window, over half the window."""


@dataclass(frozen=True)
class ScalingState:
    """A fixed shape f(w), ∫f = ∫w²f = 1, ∫wf = 0."""

    restitution: float
    kurtosis_excess: float
    """a2 = ⟨w⁴⟩/3 - 1."""
    cooling_rate: float
    """κ: collisions change θ by -2κ Sρ θ^{3/2} a unit time."""
    rate_over_haff: float
    """κ over (1 - ε²)/√π, that of a Maxwellian."""
    collision_rate: float
    """⟨|w - w'|⟩: collisions per particle and unit time over Sρ√θ."""
    w: Array
    """Evenly spaced velocities, symmetric about 0."""
    f: Array
    """f(w) there: 0 to round-off at either end."""
    reach: float
    """|w| beyond which f is below 1e-19 of its largest value."""
    narrowest: float
    """The variance of a Gaussian as fine as f is anywhere: max f/max|f''|."""


@functools.lru_cache(maxsize=64)
def cooling_state(restitution: float) -> ScalingState:
    """The shape to which a gas of (12) without friction and noise cools: θ' = -2κ Sρ θ^{3/2}. a2 to 1e-9.

    Two-peaked from ε ≈ 0.8 on; its tail is exponential. Raises SceneError unless 0 ≤ ε ≤ 0.9999.
    """
    _check(restitution)
    width = min(1.0, PEAK_WIDTH * ((1 - restitution) / 2) ** (1 / 3))
    peak = math.sqrt(1 - width**2)
    # Between a Maxwellian and two delta peaks ±1, which lose √π/2 times as much.
    rate = _haff(restitution) * (width**2 + (1 - width**2) * math.sqrt(math.pi) / 2)
    reach = tail_end(restitution, 0.0, -rate, 1.0, 1.0, peaks=peak)
    half = reach + BETWEEN_PEAKS
    waves = StationaryInWaves(restitution, half, 2 * math.ceil(half / width * POINTS) + 1)
    # At ±half the outward drifts of two periods meet, and what round-off leaves there would stay: it is taken out.
    layer = half * np.exp(-(((half - np.abs(waves.w)) / (EDGE_LAYER * half)) ** 2))
    return _state(waves, -waves.drift - np.diag(layer), width, rate, reach)


@functools.lru_cache(maxsize=64)
def white_noise_state(restitution: float) -> ScalingState:
    """The homogeneous state of (12) for R* → ∞, where noise of the power γσ balances collisions: θ_h = (γσ/(κSρ))^{2/3}.

    a2 to 1e-9; homogeneous states differ from it by O(θ_h/σ). Raises SceneError unless 0 ≤ ε ≤ 0.9999.
    """
    _check(restitution)
    rate = _haff(restitution)
    reach = max(math.sqrt(2 * DIGITS), tail_end(restitution, rate, 0.0, 1.0, 1.0))
    half = math.sqrt(2) * reach
    waves = StationaryInWaves(restitution, half, 2 * math.ceil(half * POINTS) + 1)
    return _state(waves, waves.diffusion, 1.0, rate, reach)


def _check(restitution: float) -> None:
    if not 0 <= restitution <= MOST_ELASTIC:
        raise SceneError(
            f"collisions.restitution = {restitution!r}: elastic collisions of equal particles change nothing, and nearly elastic "
            f"ones leave two ever narrower peaks; allowed: 0 to {MOST_ELASTIC}"
        )


def _haff(restitution: float) -> float:
    return (1 - restitution**2) / math.sqrt(math.pi)


def _state(waves: StationaryInWaves, driving: Array, width: float, rate: float, reach: float) -> ScalingState:
    """From two Gaussians of this width, together of variance 1."""
    w, peak = waves.w, math.sqrt(1 - width**2)
    guess = np.exp(-(((w - peak) / width) ** 2) / 2) + np.exp(-(((w + peak) / width) ** 2) / 2)
    with one_blas_thread(with_scipy=False):
        f, kappa = waves.shape(guess / (guess.sum() * waves.dv), driving, rate)
    kurtosis = float(w**4 @ f) * waves.dv / 3 - 1
    e, narrowest = waves.restitution, float(f.max() / np.abs(waves.diffusion @ f).max())
    return ScalingState(e, kurtosis, kappa, kappa / _haff(e), waves.mean_distance(f), w, f, reach, narrowest)
