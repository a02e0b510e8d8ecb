"""Velocity moments of f at any time after a state of F, in closed form: without F, the kernel in v, or f itself at that time.

F exp(Rx), R = Sρ̄, is carried by a free Ornstein-Uhlenbeck process (operators/linearised/grid.py). Over h it displaces a particle
of velocity v by X and leaves it with V, jointly Gaussian (theory/ornstein_uhlenbeck.py), so that with κ = k - iR

    ∫v^n F̂_k(v, h) dv = Σ_v F̂_k(v) E[exp(-iκX) V^n | v] dv,

and the expectation is exp(-iκ(mean X) - κ² var X/2) times the n-th moment of a normal V whose mean is moved by -iκ cov(X, V).
What is left are four sums over v for each k. Test: tests/exact/test_linearised_grid.py.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.linear import FADED
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MOMENTS = 4
"""Of v^0 … v^3: what momentum, energy, and their rates by operator (6) take."""
BLOCK = 2**15
"""Complex numbers that are worked on at a time, 512 KiB: they stay in the second-level cache, and where nx·nv is less, several
times share the calls. Chosen."""


def moments_after(
    grid: PhaseSpaceGrid,
    model: Model,
    cross_section: float,
    modes: NDArray[np.complex128],
    mean: float,
    times: Sequence[float],
    blurs: Sequence[float],
) -> Array | None:
    """∫v^n f dv at each x after each time, (times, 4, nx); None where they are no numbers, or of no positive exp(SΦ).

    `modes`: the Fourier modes along x of F's periodic part, (nx//2 + 1, nv), up to a constant factor. `mean`: the mean density.
    `blurs`: F is blurred in x by Gaussians of these variances first. Spectrally accurate in dv and dx; round-off as in the
    global gauge. What noise damps below rounding is left out.
    """
    # Of `Transition`, each (times, 1)
    e, drift_times, pushed, shifts, noise, covariance, spread = np.array([transition(model, h) for h in times]).T[:, :, None]
    growth, k, v = cross_section * mean, grid.wavenumbers, grid.v
    damping = k**2 * (spread + np.array(blurs)[:, None]) / 2
    kept = np.sum(damping <= FADED, axis=1)
    if grid.nx % 2 == 0 and grid.nx > 1:
        kept = np.minimum(kept, k.size - 1)  # the Nyquist cosine has no displacement on the grid
    powers = (v ** np.arange(MOMENTS)[:, None]).T
    with np.errstate(all="ignore"):
        sums = np.zeros((len(times), k.size, MOMENTS), dtype=np.complex128)
        together = max(1, BLOCK // modes.size)
        for first in range(0, len(times), together):
            block = slice(first, first + together)
            count = int(kept[block].max())
            sums[block, :count] = _sums(modes[:count], k, v, powers, growth, drift_times[block])
        # exp(-iκ(mean X)) without the factors that do not depend on k, and what moves the mean of V
        sums *= np.exp(1j * k * (growth * spread - shifts) - damping)[:, :, None]
        i_kappa = growth + 1j * k
        moved = pushed - i_kappa * covariance
        s0, s1, s2, s3 = sums[..., 0], e * sums[..., 1], e**2 * sums[..., 2], e**3 * sums[..., 3]
        # The moments of ev + moved, as in Pascal's triangle, and of the noise beside it
        once, twice = s1 + moved * s0, s2 + moved * s1
        squared = twice + moved * once
        found = np.empty((len(times), MOMENTS, k.size), dtype=np.complex128)
        found[:, 0], found[:, 1], found[:, 2] = s0, once, squared + noise * s0
        found[:, 3] = s3 + moved * (s2 + twice + squared) + 3 * noise * once
        # E = exp(SΦ) = W exp(Rx) obeys E_x = S∫F dv
        gauge = np.fft.irfft(cross_section * s0 / i_kappa, n=grid.nx, axis=1)
        moments = np.fft.irfft(found, n=grid.nx, axis=2) / gauge[:, None]
        moments *= mean / moments[:, :1].mean(axis=2, keepdims=True)
    if not ((gauge.min(axis=1) > 0).all() and np.isfinite(moments).all()):
        return None
    return np.asarray(moments)


def _sums(
    modes: NDArray[np.complex128], k: Array, v: Array, powers: Array, growth: float, drift_times: Array
) -> NDArray[np.complex128]:
    """Σ_v F̂_k(v) exp(-iκ drift_time v) v^n, (times, modes, 4), up to a constant factor for each time; drift_times (times, 1)."""
    weight = -growth * drift_times * v
    # exp(-ik drift_time v) of all k from that of the first by doubling: exponentials of all of them would take longest here.
    shear = np.empty((len(drift_times), *modes.shape), dtype=np.complex128)
    shear[:, :1] = 1.0
    power = np.exp(-1j * (k[1] if len(modes) > 1 else 0.0) * drift_times * v)[:, None]
    filled = 1
    while filled < len(modes):
        more = min(filled, len(modes) - filled)
        np.multiply(shear[:, :more], power, out=shear[:, filled : filled + more])
        filled, power = filled + more, power * power
    shear *= modes
    weighted = np.exp(weight - weight.max(axis=1, keepdims=True))[:, :, None] * powers
    return np.asarray(shear @ weighted.astype(np.complex128))
