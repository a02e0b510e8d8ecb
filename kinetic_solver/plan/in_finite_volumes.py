"""How fine dv must be for finite volumes in v (operators/velocity/finite_volume.py).

The rule of measured.py is for Gaussians of variance σ. At order p finite volumes damp a wave exp(iqv) by σγq², but for a share
c(q dv)^p of that: within t the wave errs by c(q dv)^p σγq²t, until noise has damped it away. A Gaussian of variance θ to which
free motion has given the wave κ has E(κ + z/√θ)^(p+2), z normal, in the place of q^(p+2). So a cold start asks for points as fine
as it is, and waves along x for points as fine as what they turn into. Both are over once σγt comes to 1/(p/θ + κ²).
Test: tests/convergence/test_weak_friction.py.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from kinetic_solver.plan import in_t, kernel_sums, measured
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import DROPPED, Waves
from kinetic_solver.scene import DriftDiffusionScheme
from kinetic_solver.stability.homogeneous import homogeneous_state


def spacing(scales: Scales, waves: Waves, name: DriftDiffusionScheme, step: float | None = None) -> float:
    """The dv at which their error is RULE_SHARE of rtol; `step` is the longest, of an exact one."""
    coefficient, order = measured.FINITE_VOLUME_ERROR[name]
    coefficient *= tail_weight(scales) * min(1.0, measured.SATURATED * scales.scene.model.friction * scales.end)
    off = _off_equilibrium(scales) if order == 8 else 1.0
    coefficient *= max(off, finer(scales, waves, order, step))
    return math.sqrt(scales.scene.model.noise) * (measured.RULE_SHARE * scales.rtol / coefficient) ** (1 / order)


def steepest(scales: Scales, edges: tuple[float, float]) -> float:
    """The dv at which they keep order 8 in the whole window."""
    model = scales.scene.model
    farthest = max(abs(edge - model.gravity / model.friction) for edge in edges)
    return measured.STEEPEST_FACE * model.noise / farthest


def tail_weight(scales: Scales) -> float:
    """By how much the error grows with what (6), or a law that slows pairs down, amplifies."""
    r = scales.amplification if scales.amplifies else abs(scales.slows) * scales.amplification if scales.slows else 1.0
    strong, exponent = measured.STRONG_AMPLIFICATION
    return (1 + r**2 + r**3) * in_t.grown(exponent * max(0.0, r - strong))


def finer(scales: Scales, waves: Waves, order: int, step: float | None) -> float:
    """How many times the error of a wave or of a Gaussian of the start is that of a Gaussian of variance σ."""
    model = scales.scene.model
    h = min(step or scales.end, scales.end)
    k, digits = waves.in_play
    amplitude = scales.rtol / DROPPED * np.exp(digits) * np.where(k > 0, 2.0, 1.0)
    acting = model.noise * model.friction * scales.end
    usual = math.prod(range(1, order + 2, 2)) * model.noise ** -(order / 2 + 1) * min(acting, model.noise / order)
    worst = 0.0
    for sums in itertools.chain(*kernel_sums.before_kernels(scales, waves, k, kernel_sums.links(scales, h), h)):
        lasting = np.minimum(acting, 1 / (order / sums.broad + sums.wave**2))
        error = amplitude * np.exp(-sums.lost) * _moment(sums.wave * np.sqrt(sums.broad), order + 2)
        worst = max(worst, float((error * sums.broad ** -(order / 2 + 1) * lasting).max()))
    return worst / usual


def _moment(mean: np.ndarray, n: int) -> np.ndarray:
    """E(mean + z)^n, n even."""
    terms = ((j, math.prod(range(1, 2 * j, 2))) for j in range(n // 2 + 1))
    return np.asarray(sum(math.comb(n, 2 * j) * odd * mean ** (n - 2 * j) for j, odd in terms))


def _off_equilibrium(scales: Scales) -> float:
    """Differences of order 8 are taken of f/M, M the Maxwellian of variance σ: by how much more they err where f is hotter, or
    displaced."""
    model, scene = scales.scene.model, scales.scene
    state = homogeneous_state(scene) if scales.amplifies else None
    mean = state.mean_velocity if state is not None else model.gravity / model.friction
    u = scales.mean_velocity
    displaced = max(abs(float(u.min()) - mean), abs(float(u.max()) - mean)) / math.sqrt(model.noise)
    return max(1.0, scales.theta_max / model.noise) ** 3 * math.exp(min(displaced, measured.MOST_DISPLACED))
