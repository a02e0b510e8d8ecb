"""Steps in time of the closure: order 3, positive by construction, friction and noise in closed form.

The method is the strong-stability-preserving integrating-factor method of order 3 whose abscissas do not decrease
(eSSPRK⁺(3,3); L. Isherwood, Z. J. Grant and S. Gottlieb 2018): the closed form only goes forwards, and all else is convex
combinations of Euler steps of length 4h/3. Order and positivity: tests/hydrodynamics/test_closure.py."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.budgets import sample
from kinetic_solver.hydrodynamics.gas import Gas, collide, fastest
from kinetic_solver.hydrodynamics.weno import divergence

LONGEST_EULER = 4 / 3
"""Of the Euler steps that a step consists of, over its length."""
RUNAWAY = 100.0
"""Waves faster than this many times those of the start and of a gas at rest at temperature σ: of collisions that heat what they
slow, and slow what is hot, without bound (docs/hydrodynamics_details.md). No scene that settles has come near."""
COURANT = 0.8
"""α dt/dx of the longest Euler step. Above 1 nothing is positive; the rest is for waves that become faster within a step."""


class _TooLong(Exception):
    """Signals that a step would not be positive."""


class ClosureSteps:
    """Advances U = (ρ, ρu, E), shape (3, n), on a period, in a frame of its own velocity."""

    def __init__(self, gas: Gas, dx: float, longest: float, refined: float = 1.0) -> None:
        """No step is longer than `longest`, nor than 1/`refined` of what collisions allow at most."""
        self.gas, self.dx, self.longest, self.refined = gas, dx, longest, refined
        self.steps = 0
        self.integral = np.zeros(4)
        """Of `budgets.sample` over all steps so far."""
        self.within: tuple[Array, float] | None = None
        """(state in the frame, time) after a step that is not the last of `advance`."""
        self._bound = math.inf
        self._coefficients = (gas.drag, gas.usual_drag, gas.cooling, gas.usual_cooling)

    def advance(self, state: Array, start: float, end: float, after_step: Callable[[], None] = lambda: None) -> Array:
        """The state at `end`. The frame's velocity is chosen so that it moves by whole cells; the result is in the laboratory.

        `after_step` is called after every step, and may raise: with `restore` the same call goes on from there.
        Raises SolverStopped where the state is lost.
        """
        # Seen from where the gas is at rest on average, or nearly: from a frame that moves by whole cells
        drift = self.gas.drift(float(state[1].sum() / state[0].sum()), end - start)
        cells = round(drift / self.dx)
        frame = cells * self.dx / (end - start)
        resumed = self.within is not None
        moved, now = self.within or (_boosted(state, -frame), start)
        if start == 0 and not resumed:
            self._bound = RUNAWAY * max(self._fastest(moved, now)[0], math.sqrt(3 * self.gas.noise))
        while now < end:
            speed, rate = self._fastest(moved, now)
            step = min(self.longest, 1 / (speed / (COURANT * self.dx) + self.refined * rate) / LONGEST_EULER)
            if speed > self._bound:
                raise SolverStopped(
                    f"t = {now:.6g}: waves of speed {speed:.3g}: the closure runs away (shocks heat what collisions drive); "
                    "end before that (run.end_time), or lower initial.density"
                )
            count = math.ceil((end - now) / step * (1 - 1e-12))
            while True:
                try:
                    moved, brought = self._step(moved, (end - now) / count, frame, now)
                    break
                except _TooLong:  # waves became faster within the step
                    count *= 2
            now = end if count == 1 else now + (end - now) / count
            self.steps += 1
            self.integral = self.integral + brought
            self.within = (moved, now)
            after_step()
        self.within = None
        self._fastest(moved, end)
        return np.roll(_boosted(moved, frame), cells, axis=1)

    def state(self) -> dict[str, Any] | None:
        """A tree of what `advance` goes on from; None where the state is lost, as the next step will find."""
        if self.within is not None and not math.isfinite(fastest(self.within[0], *self._coefficients)[0]):
            return None
        return {"within": self.within, "steps": self.steps, "integral": self.integral, "bound": self._bound}

    def restore(self, state: Mapping[str, Any]) -> None:
        self.within, self.steps, self.integral = state["within"], state["steps"], state["integral"]
        self._bound = state["bound"]

    def _step(self, state: Array, h: float, frame: float, now: float) -> tuple[Array, Array]:
        """(the state, the integral of its sample) after a step."""

        def relax(u: Array, share: float) -> Array:
            return self.gas.relax(u, share * h, frame)

        long = LONGEST_EULER * h
        first = self._rate(state, long, now)
        one = relax(state + h * (2 / 3) * first, 2 / 3)
        two = relax(state, 2 / 3) * (2 / 3) + (one + long * self._rate(one, long, now)) / 3
        last = two + long * self._rate(two, long, now)
        samples = [sample(self.gas, stage, self.dx, frame) for stage in (state, one, two)]
        brought = h * (samples[0] / 4 + samples[1] * (3 / 16) + samples[2] * (9 / 16))
        return relax((74 / 128) * state + (15 / 128) * long * first, 1.0) + (27 / 64) * relax(last, 1 / 3), brought

    def _rate(self, state: Array, long: float, now: float) -> Array:
        """dU/dt but for the closed form. An Euler step of length `long` with it is positive: the part 1 - κ of the state moves
        and the part κ collides."""
        speed, rate = self._fastest(state, now)
        share = long * speed / self.dx / max(1 - long * rate, 1e-300)
        if not share < 1:
            raise _TooLong
        out = np.empty_like(state)
        divergence(state, speed, share, np.empty((2, *state.shape)), np.empty_like(state), out)
        out /= self.dx
        collide(state, *self._coefficients, out)
        return out

    def _fastest(self, state: Array, now: float) -> tuple[float, float]:
        speed, rate = fastest(state, *self._coefficients)
        if not math.isfinite(speed):
            raise SolverStopped(f"t = {now:.6g}: density or temperature is no longer positive; lower grid.time_step")
        return speed, rate


def _boosted(state: Array, velocity: float) -> Array:
    """The same state seen from a frame that moves with -velocity."""
    rho, m, e = state
    return np.stack([rho, m + velocity * rho, e + velocity * m + 0.5 * velocity**2 * rho])
