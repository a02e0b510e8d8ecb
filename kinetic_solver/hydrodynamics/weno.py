"""The flux of the closure (3)-(5) between neighbouring points: finite differences of order 5 that capture shocks.

The state is U = (ρ, m, E), m = ρu, E = ½ρ(u² + θ), at n points of a period; its flux is F = (m, 2E, ½ρu³ + (3/2)ρuθ), gas
dynamics of adiabatic index 3, whose waves travel with u and u ± c, c = √(3θ). With α ≥ |u| + c everywhere F = (α/2)[(U + F/α) -
(U - F/α)]: the first bracket moves to the right only, the second to the left only. Each is reconstructed at the faces from the
side it comes from, wave by wave, by the weighted essentially non-oscillatory method of order 5 (C.-W. Shu and S. Osher 1989;
G.-S. Jiang and C.-W. Shu 1996; weights of R. Borges, M. Carmona, B. Costa and W. S. Don 2008), and limited so that density and
temperature stay positive (X. Zhang and C.-W. Shu 2012). Twin of the kernels, order and positivity:
tests/hydrodynamics/test_weno.py."""

from __future__ import annotations

import numba
import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.compiling import watch

watch()

SMOOTH = 1e-3
"""Variations below this share of the local density count as smooth: of the reconstructions of smooth extrema, waves of a few per
cent at 64 points are the most demanding (free_waves of tests/hydrodynamics/), and ripples this small at a jump harm nothing."""
KEPT = 1e-6
"""Share of its point's density and pressure that a limited face keeps: above rounding, below what any resolved profile has."""


@numba.njit(cache=True)
def weno5(a: float, b: float, c: float, d: float, e: float, least: float) -> float:
    """The value half a spacing beyond c of a function whose means over five cells are a … e, order 5 where it is smooth.

    `least` > 0: the square of what variation counts as none.
    """
    left = 13 / 12 * (a - 2 * b + c) ** 2 + 0.25 * (a - 4 * b + 3 * c) ** 2
    middle = 13 / 12 * (b - 2 * c + d) ** 2 + 0.25 * (b - d) ** 2
    right = 13 / 12 * (c - 2 * d + e) ** 2 + 0.25 * (3 * c - 4 * d + e) ** 2
    difference = abs(left - right)
    w0 = 0.1 * (1 + (difference / (left + least)) ** 2)
    w1 = 0.6 * (1 + (difference / (middle + least)) ** 2)
    w2 = 0.3 * (1 + (difference / (right + least)) ** 2)
    q0 = 2 * a - 7 * b + 11 * c
    q1 = -b + 5 * c + 2 * d
    q2 = 2 * c + 5 * d - e
    return (w0 * q0 + w1 * q1 + w2 * q2) / (6 * (w0 + w1 + w2))


@numba.njit(cache=True)
def _limit(mean: Array, face: Array, share: float) -> None:
    """Move `face` towards `mean` until it and what is left of the cell, (mean - share·face)/(1 - share), are physical.

    Density is linear and pressure, as a function of U, concave, so the bounds on the way are sufficient.
    """
    p_mean = 2 * mean[2] - mean[1] ** 2 / mean[0]
    way = 1.0
    for side in range(2):
        # side 0: the face itself; side 1: the rest of the cell
        reach = 1.0 if side == 0 else -share / (1 - share)
        rho = mean[0] + reach * (face[0] - mean[0])
        if rho < KEPT * mean[0]:
            way = min(way, (1 - KEPT) * mean[0] / (mean[0] - rho))
    for side in range(2):
        reach = way * (1.0 if side == 0 else -share / (1 - share))
        rho = mean[0] + reach * (face[0] - mean[0])
        m = mean[1] + reach * (face[1] - mean[1])
        p = 2 * (mean[2] + reach * (face[2] - mean[2])) - m * m / rho
        if p < KEPT * p_mean:
            way *= (1 - KEPT) * p_mean / (p_mean - p)
    for k in range(3):
        face[k] = mean[k] + way * (face[k] - mean[k])


@numba.njit(cache=True)
def divergence(state: Array, alpha: float, share: float, parts: Array, flux: Array, out: Array) -> None:
    """out = -∂F/∂x times dx, of `state` (3, n). `parts` (2, 3, n) and `flux` (3, n) are room to work in; flux[:, i] is F at i +
    1/2.

    `share` < 1 is α dt/dx of the longest Euler step that is to keep density and temperature positive. Conserves to rounding.
    """
    n = state.shape[1]
    for i in range(n):
        rho, m, e = state[0, i], state[1, i], state[2, i]
        u = m / rho
        f2 = u * (3 * e - m * u)  # ½ρu³ + (3/2)ρuθ = u(3E - ρu²)
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            parts[side, 0, i] = rho + sign * m / alpha
            parts[side, 1, i] = m + sign * 2 * e / alpha
            parts[side, 2, i] = e + sign * f2 / alpha
    wave, mean, face = np.empty((3, 5)), np.empty(3), np.empty(3)
    for i in range(n):
        right = (i + 1) % n
        rho = 0.5 * (state[0, i] + state[0, right])
        m = 0.5 * (state[1, i] + state[1, right])
        u = m / rho
        c2 = 3 * ((state[2, i] + state[2, right]) / rho - u * u)
        c = c2**0.5
        least = (SMOOTH * rho) ** 2
        for k in range(3):
            flux[k, i] = 0.0
        for side in range(2):
            for s in range(5):
                j = (i - 2 + s) % n if side == 0 else (i + 3 - s) % n
                y0, y1 = parts[side, 0, j], parts[side, 1, j]
                moved = y1 - u * y0
                heat = (parts[side, 2, j] - u * y1 + 0.5 * u * u * y0) / c2
                wave[0, s] = heat - 0.5 * moved / c
                wave[1, s] = y0 - 2 * heat
                wave[2, s] = heat + 0.5 * moved / c
            a = weno5(wave[0, 0], wave[0, 1], wave[0, 2], wave[0, 3], wave[0, 4], least)
            b = weno5(wave[1, 0], wave[1, 1], wave[1, 2], wave[1, 3], wave[1, 4], least)
            d = weno5(wave[2, 0], wave[2, 1], wave[2, 2], wave[2, 3], wave[2, 4], least)
            face[0] = a + b + d
            face[1] = u * face[0] + c * (d - a)
            face[2] = 0.5 * (a * (u - c) ** 2 + b * u * u + d * (u + c) ** 2)
            here = i if side == 0 else right
            for k in range(3):
                mean[k] = parts[side, k, here]
            _limit(mean, face, share)
            sign = 1.0 if side == 0 else -1.0
            for k in range(3):
                flux[k, i] += sign * 0.5 * alpha * face[k]
    for k in range(3):
        for i in range(n):
            out[k, i] = flux[k, i - 1] - flux[k, i]
