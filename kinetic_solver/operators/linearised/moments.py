"""Velocity moments of f at any time after a state of F, in closed form: without F, the kernel in v, or f itself at that time.

F exp(Rx), R = Sρ̄, is carried by a free Ornstein-Uhlenbeck process (operators/linearised/grid.py). Over h it displaces a particle
of velocity v by X and leaves it with V, jointly Gaussian (theory/ornstein_uhlenbeck.py), so that with κ = k - iR

    ∫v^n F̂_k(v, h) dv = Σ_v F̂_k(v) E[exp(-iκX) V^n | v] dv,

and the expectation is exp(-iκ(mean X) - κ² var X/2) times the n-th moment of a normal V whose mean is moved by -iκ cov(X, V).
What is left are four sums over v for each k. Test: tests/exact/test_linearised_grid.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.linear import FADED
from kinetic_solver.scene import Model
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MOMENTS = 4
"""Of v^0 … v^3: what momentum, energy, and their rates by operator (6) take."""


def moments_after(
    grid: PhaseSpaceGrid, model: Model, cross_section: float, modes: NDArray[np.complex128], mean: float, h: float, blur: float
) -> Array | None:
    """∫v^n f dv at each x after h, shape (4, nx); None where they come out as no numbers, or of no positive exp(SΦ).

    `modes`: the Fourier modes along x of F's periodic part, (nx//2 + 1, nv), up to a constant factor. `mean`: the mean density.
    `blur`: F is blurred in x by a Gaussian of this variance first. Spectrally accurate in dv and dx; round-off as in the global
    gauge. Relative to the largest wave, what noise leaves of the others may be below rounding: these are left out.
    """
    step, growth, k, v = transition(model, h), cross_section * mean, grid.wavenumbers, grid.v
    damping = k**2 * (step.displacement_variance + blur) / 2
    kept = int(np.searchsorted(damping, FADED, side="right"))
    if grid.nx % 2 == 0 and grid.nx > 1:
        kept = min(kept, k.size - 1)  # the Nyquist cosine, which has no displacement on the grid
    with np.errstate(all="ignore"):
        # exp(-iκ(mean X)), the part that depends on v; constant factors do not matter
        weight = -growth * step.drift_time * v
        powers = np.exp(weight - weight.max()) * v ** np.arange(MOMENTS)[:, None]
        shear = np.ones((kept, v.size), dtype=np.complex128)
        if kept > 1:
            shear[1:] = np.exp(-1j * k[1] * step.drift_time * v)
        np.multiply.accumulate(shear, axis=0, out=shear)
        shear *= modes[:kept]
        sums = shear @ powers.T.astype(np.complex128)
        uniform = -1j * k[:kept] * (step.displacement_shift - growth * step.displacement_variance) - damping[:kept]
        sums *= np.exp(uniform)[:, None]
        e, noise = step.decay, step.velocity_variance
        mean_v = step.velocity_shift - (1j * k[:kept] + growth) * step.covariance
        s0, s1, s2, s3 = sums.T
        found = np.zeros((MOMENTS, k.size), dtype=np.complex128)
        found[0, :kept] = s0
        found[1, :kept] = e * s1 + mean_v * s0
        found[2, :kept] = e**2 * s2 + 2 * e * mean_v * s1 + (mean_v**2 + noise) * s0
        found[3, :kept] = (
            e**3 * s3 + 3 * e**2 * mean_v * s2 + 3 * e * (mean_v**2 + noise) * s1 + (mean_v**2 + 3 * noise) * mean_v * s0
        )
        # E = exp(SΦ) = W exp(Rx) obeys E_x = S∫F dv
        gauge = np.fft.irfft(cross_section * found[0] / (growth + 1j * k), n=grid.nx)
        moments = np.fft.irfft(found, n=grid.nx, axis=1) / gauge
        moments *= mean / moments[0].mean()
    if not (gauge.min() * gauge.max() > 0 and np.isfinite(moments).all()):
        return None
    return np.asarray(moments)
