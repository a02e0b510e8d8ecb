"""Stationary states of (12), by the Fourier-Galerkin method of theory/collisions_in_waves.py and Newton's method.

It shares nothing with the grid solver's pairs of cells. Its window's edge f reaches at exp(-`DIGITS`).
Tests: tests/linear_theory/test_inelastic.py, tests/exact/test_homogeneous.py, tests/exact/test_scaling_states.py.
"""

from __future__ import annotations

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.theory.collisions_in_waves import CollisionsInWaves

DIGITS = 44.0
"""ln of the largest f over f at the window's edge: exp(-44) = 8e-20 is below round-off."""
NEWTON_STEPS = 30
"""At most: 14 were needed at the most, at ε = 0.9999 without noise and friction (tests/exact/test_scaling_states.py)."""
LOOKED_AT, HALVINGS = 400, 40
"""Velocities at which the tail is looked at, and steps of the bisection there. Chosen."""
LAST_STEP = 1e-8
"""Newton's step over max f after which another changes nothing: each squares the error. Round-off leaves 1e-11."""


class StationaryInWaves(CollisionsInWaves):
    """That, and what stays under it."""

    def __init__(self, restitution: float, half: float, count: int) -> None:
        super().__init__(restitution, half, count)
        derivative = (self.to_points * (1j * self.xi) @ self.to_waves).real
        self.drift = derivative * self.w
        """f → ∂(wf)/∂w, on points."""
        self.diffusion = derivative @ derivative
        """f → ∂²f/∂w²."""

    def stationary(self, f: Array, linear: Array, collisions: float) -> Array:
        """The even f with 0 = linear f + collisions · C[f] and ∫f = 1, by Newton's method from this one. Raises SceneError."""
        return self._newton(f, linear, collisions, None)[0]

    def shape(self, f: Array, driving: Array, strength: float) -> tuple[Array, float]:
        """The even f and μ with 0 = μ driving f + C[f] and ∫f = ∫w²f = 1, likewise, from this f and this μ."""
        return self._newton(f, driving, 1.0, strength)

    def _newton(self, f: Array, driving: Array, collisions: float, strength: float | None) -> tuple[Array, float]:
        """In waves n ≥ 0 of even functions, which are real. Nothing but friction would hold the mean of others at 0.

        The equation of wave 0 is 0 = 0, mass being conserved: ∫f = 1 takes its place.
        """
        middle = self.count // 2
        driving = _folded((self.to_waves[middle:] @ driving @ self.to_points).real)
        quadratic, pairs = collisions * self.quadratic[middle:], self.pairs[middle:]
        energy = _folded(self.dv * (self.w**2 @ self.to_points).real)
        waves = (self.to_waves @ f).real[middle:]
        mu = 1.0 if strength is None else strength
        for _ in range(NEWTON_STEPS):
            both = np.concatenate([waves[:0:-1], waves])
            products = quadratic * both[pairs]
            jacobian = mu * driving + _folded(2 * products)
            residual = mu * (driving @ waves) + products @ both
            jacobian[0], residual[0] = 0.0, waves[0] - 1 / (2 * self.half)
            jacobian[0, 0] = 1.0
            if strength is not None:
                column = (driving @ waves)[:, None]
                column[0] = 0.0
                jacobian = np.block([[jacobian, column], [energy[None], np.zeros((1, 1))]])
                residual = np.append(residual, energy @ waves - 1)
            step = np.linalg.solve(jacobian, -residual)
            waves = waves + step[: waves.size]
            mu += 0.0 if strength is None else step[-1]
            if np.abs(step[: waves.size]).max() < LAST_STEP * np.abs(waves).max():
                return (self.to_points @ np.concatenate([waves[:0:-1], waves])).real, float(mu)
        raise SceneError(
            f"collisions.restitution = {self.restitution!r}: no stationary state was found; allowed: a given initial.temperature"
        )


def _folded(columns: Array) -> Array:
    """Of waves l ≥ 0, which carry -l with them, from all waves: the last axis."""
    middle = columns.shape[-1] // 2
    result = columns[..., middle:].copy()
    result[..., 1:] += columns[..., middle - 1 :: -1] if middle else 0.0
    return result


def tail_end(
    restitution: float,
    diffusion: float,
    friction: float,
    collisions: float,
    width: float,
    digits: float = DIGITS,
    peaks: float = 0.0,
) -> float:
    """w > 0 at which the tail exp(-Q) of 0 = friction ∂(wf) + diffusion ∂²f + collisions · C[f] has Q = `digits`.

    With q = Q' a fast particle, which meets others at ±`peaks`, leaves at the rate r = w ∓ peaks and one faster by αr takes its
    place, exp(-αrq) as many: diffusion q² - friction wq = collisions ⟨r (1 - exp(-αrq))⟩. Loss alone would make the tail of
    nearly elastic particles too fat. `width`, about √θ, is the unit in which w is looked for.
    """
    alpha, farthest = (1 - restitution) / 2, 8 * width
    while True:
        w = np.linspace(peaks, farthest, LOOKED_AT)
        apart = np.array([w - peaks, w + peaks])
        low = np.zeros_like(w)
        if diffusion > 0:
            high = (friction * w + np.sqrt((friction * w) ** 2 + 4 * diffusion * collisions * w)) / (2 * diffusion)
        else:
            high = np.full_like(w, collisions / -friction)
        for _ in range(HALVINGS):
            q = (low + high) / 2
            replaced = collisions * (apart * -np.expm1(-alpha * apart * q)).mean(axis=0)
            above = diffusion * q**2 - friction * w * q >= replaced
            low, high = np.where(above, low, q), np.where(above, q, high)
        fallen = np.concatenate([[0.0], np.cumsum((q[1:] + q[:-1]) / 2 * np.diff(w))])
        if fallen[-1] >= digits:
            return float(np.interp(digits, fallen, w))
        farthest *= 2
