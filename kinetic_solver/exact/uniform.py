"""What arrives at places from a start whose beams have one mean velocity and temperature each, whatever the density.

The weight of a starting point y is exp(SΦ0(y)) N(x - y; m, X), m and X mean and variance of the displacement. The linear part
Sρ̄y of SΦ0 moves the Gaussian ahead by Sρ̄X, and what is left are positive terms in which nothing large cancels:

    exp(SΦ0(y)) N(x - y; m, X) = exp(Sρ̄(x - m) + (Sρ̄)²X/2) exp(S(Φ0(y) - ρ̄y)) N(ζ; 0, X),   y = x - m + Sρ̄X - ζ.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.exact.mixture import SIGMAS, Mixture
from kinetic_solver.exact.panels import ORDER, Panels, check
from kinetic_solver.exact.setting import Setting, jumps

AT_ONCE = 1_000_000
"""Terms, of all places together. Chosen: they fit into a few caches' worth of memory."""


def mixtures(at: Setting, x: Array, precise: bool) -> Iterator[Mixture]:
    """Of the places in turn, several at once. `precise`: for f, not only moments."""
    if at.scene.initial.step is not None:
        for place in x.tolist():
            yield _mixture(at, np.array([place]), [_between_jumps(at, place, beam, precise) for beam in at.beams])
        return
    nodes = [_even(at, beam, precise) for beam in at.beams]
    chunk = max(1, AT_ONCE // sum(zeta.size for zeta, _, _ in nodes))
    for first in range(0, x.size, chunk):
        yield _mixture(at, x[first : first + chunk], nodes)


def count(at: Setting, precise: bool) -> float:
    """Nodes of a place, or about as many."""
    total = 0.0
    for _, _, theta in at.beams:
        behind, ahead = _reach(at, theta)
        total += (behind + ahead) / at.spacing(theta, precise)
    return total


Nodes = tuple[Array, Array, Array | None]
"""ζ, the rule's weights, and, with jumps, a ζ of the same panel that is far from both of its ends."""


def _mixture(at: Setting, x: Array, nodes: list[Nodes]) -> Mixture:
    k, growth = at.spread, at.growth
    logs, weights, means, variances = [], [], [], []
    for (share, u, theta), (zeta, rule, inside) in zip(at.beams, nodes, strict=True):
        xx, xv, vv = (float(value) for value in at.covariance(np.asarray(theta)))
        ahead = u * k.drift_time - growth * xx
        origin = (x - k.displacement_shift)[:, None]
        y = origin - (ahead + zeta)
        rho = initial.density(at.scene, y if inside is None else origin - (ahead + inside))
        logs.append(at.waves(y) + (at.tilt(u, theta) - zeta**2 / (2 * xx)))
        weights.append((rho, share * rule / math.sqrt(2 * math.pi * xx)))
        means.append(at.apart(u, theta) + xv / xx * zeta)
        variances.append(np.full(zeta.size, vv))
    log = np.concatenate(logs, axis=1)
    top = log.max(axis=1, keepdims=True)
    kernel = np.exp(log - top) * np.concatenate([np.broadcast_to(rule, rho.shape) for rho, rule in weights], axis=1)
    scale = kernel.sum(axis=1, keepdims=True)
    rho = np.concatenate([rho for rho, _ in weights], axis=1)
    return Mixture(kernel * rho / scale, at.base, np.concatenate(means), np.concatenate(variances), (top + np.log(scale))[:, 0])


def _reach(at: Setting, theta: float) -> tuple[float, float]:
    """How far ζ goes below 0 and above, where terms are below exp(-SIGMAS²/2) of the largest: SΦ0 - Sρ̄y rises by no more than
    its swing, nor faster than its steepest slope ahead (ζ < 0) and behind."""
    width = math.sqrt(float(at.covariance(np.asarray(theta))[0]))
    most = width * math.sqrt(SIGMAS**2 + 2 * at.swing)
    faster, slower = (width * slope for slope in at.steepness)
    return (
        min(most, width * (faster + math.sqrt(faster**2 + SIGMAS**2))),
        min(most, width * (slower + math.sqrt(slower**2 + SIGMAS**2))),
    )


def _even(at: Setting, beam: tuple[float, float, float], precise: bool) -> Nodes:
    """The trapezoidal rule, spectrally accurate: the integrand is smooth and vanishes at both ends."""
    below, above = _reach(at, beam[2])
    spacing = at.spacing(beam[2], precise)
    first, last = -math.ceil(below / spacing), math.ceil(above / spacing)
    check(last - first, at.time)
    zeta = spacing * np.arange(first, last + 1)
    return zeta, np.full(zeta.size, spacing), None


def _between_jumps(at: Setting, place: float, beam: tuple[float, float, float], precise: bool) -> Nodes:
    """Gauss-Legendre panels that end at the jumps of the density."""
    _, u, theta = beam
    below, above = _reach(at, theta)
    k = at.spread
    ahead = u * k.drift_time - at.growth * float(at.covariance(np.asarray(theta))[0])
    origin = place - k.displacement_shift - ahead
    # Taken from the place first: a place on a jump has it exactly there.
    at_jumps = place - jumps(at.scene, origin - above, origin + below) - k.displacement_shift - ahead
    even = max(1, math.ceil((below + above) / (10 * at.spacing(theta, precise))))
    check(ORDER * even, at.time)
    edges = np.concatenate([np.linspace(-below, above, even + 1), np.clip(at_jumps, -below, above)])
    panels = Panels.between(edges[None, :])
    return panels.nodes.ravel(), panels.weights.ravel(), np.repeat(panels.centre, ORDER)
