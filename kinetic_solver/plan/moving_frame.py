"""The frame of reference in which a scene is solved. Gravity, and friction without noise, are changes of coordinates.

With x = y + X(t), v = U(t) + λ(t) w and f(x, v, t) = F(y, w, s)/λ, where U' = g - γU and X' = U:

- U alone (λ = 1, s = t) takes gravity out of (2): F obeys it with g = 0. Both operators depend on differences of velocity only.
- Where γσ = 0, λ = exp(-γt) and ds = λ dt take friction out as well, since both operators grow in proportion to the velocities:
  F obeys (2) with g = γ = σ = 0, transport and collisions alone.
- A gas that then cools by its collisions has a λ that follows it, λ = exp(-γt)/(1 + κr), r = (1 - exp(-γt))/γ: with ds = λ dt F
  obeys (2) with g = σ = 0 and the negative friction -κ, so that its velocities stay as they are. Any κ > 0 will do; with the
  rate at which the gas cools in the end (stability/scaling.py) F comes to rest. A time t takes s = ln(1 + κr)/κ: as long for
  each e-fold of cooling.

So a flow that gravity carries away needs no wider velocity window, and one that nothing heats no finer dv as it cools.
Tests: tests/exact/test_frame.py, tests/exact/test_cooling.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from kinetic_solver.initial import start_state
from kinetic_solver.scene import Model, Run, Scene
from kinetic_solver.theory.ornstein_uhlenbeck import transition

ROUND_OFF = 2.0**-53
SLOW = 1e-3
"""γt below which velocities are taken for linear in time: Simpson's rule then errs by (γt)⁴ of them at most."""


@dataclass(frozen=True)
class Place:
    """The frame at one instant."""

    time: float
    """t."""
    position: float
    """X."""
    velocity: float
    """U."""
    scale: float
    """λ."""

    def totals(self, totals: tuple[float, float, float]) -> tuple[float, float, float]:
        """(mass, momentum, energy) of f from those of F."""
        mass, p, energy = totals
        u, scale = self.velocity, self.scale
        return mass, u * mass + scale * p, u * u / 2 * mass + u * scale * p + scale**2 * energy

    def rates(self, rates: tuple[float, float]) -> tuple[float, float]:
        """Rates of momentum and energy by collisions, by the scene's time, from those of F by the frame's clock."""
        p, energy = rates
        return self.scale**2 * p, self.velocity * self.scale**2 * p + self.scale**3 * energy


@dataclass(frozen=True)
class ReferenceFrame:
    """A frame that starts with velocity `start`; at rest in the laboratory where `moving` is False."""

    model: Model
    moving: bool = False
    start: float = 0.0
    cooling: float = 0.0
    """κ [1/time]; 0 where λ follows no cooling."""
    unit: float = 1.0
    """√θ0: fields of a run that cools are written over (v - U)/(unit λ)."""

    @property
    def noiseless(self) -> bool:
        """True where the frame takes friction out."""
        return self.moving and self.model.friction * self.model.noise == 0

    def clock(self, time: float) -> float:
        """s at the time t."""
        if not self.noiseless:
            return time
        r = transition(self.model, time).drift_time
        return math.log1p(self.cooling * r) / self.cooling if self.cooling > 0 else r

    def place(self, clock: float) -> Place:
        """The frame when its clock shows s."""
        if not self.moving:
            return Place(clock, 0.0, 0.0, 1.0)
        time, friction = clock, self.model.friction
        if self.cooling > 0:
            time = math.expm1(self.cooling * clock) / self.cooling
        if self.noiseless and friction > 0:
            # The clock ends at 1/γ; what is told of later times is that they are late.
            time = -math.log1p(-min(friction * time, 1 - ROUND_OFF)) / friction
        step = transition(self.model, time)
        return Place(
            time,
            self.start * step.drift_time + step.displacement_shift,
            self.start * step.decay + step.velocity_shift,
            step.decay / (1 + self.cooling * step.drift_time) if self.noiseless else 1.0,
        )

    def travelled(self, time: float) -> tuple[float, float]:
        """(X, ∫U²/2 dt) from 0 to a time."""
        step, gamma, g, u0 = transition(self.model, time), self.model.friction, self.model.gravity, self.start
        x = u0 * step.drift_time + step.displacement_shift
        if gamma * time < SLOW:
            # U is all but a parabola: Simpson's rule.
            middle = transition(self.model, time / 2)
            speeds = (u0, u0 * middle.decay + middle.velocity_shift, u0 * step.decay + step.velocity_shift)
            return x, time / 12 * (speeds[0] ** 2 + 4 * speeds[1] ** 2 + speeds[2] ** 2)
        terminal, faster = g / gamma, u0 - g / gamma
        of_faster = -(faster**2) * math.expm1(-2 * gamma * time) / (2 * gamma)
        return x, (terminal**2 * time + 2 * terminal * faster * step.drift_time + of_faster) / 2

    def scene(self, scene: Scene) -> Scene:
        """`scene` as it looks in this frame, by this frame's clock."""
        if not self.moving:
            return scene
        u0, theta0 = start_state(scene)
        model = Model() if self.noiseless else scene.model
        still = {"friction": -self.cooling, "noise": 0.0} if self.noiseless else {}
        model = model.model_copy(update={"gravity": 0.0, **still})
        beams = tuple(b.model_copy(update={"mean_velocity": b.mean_velocity - self.start}) for b in scene.initial.beams)
        seen = {"beams": beams} if beams else {"mean_velocity": u0 - self.start, "temperature": theta0}
        initial = scene.initial.model_copy(update=seen)
        run = scene.run.model_copy(update={"output_every": None})  # the scene's own is valid
        if self.noiseless:
            run = Run(end_time=self.clock(scene.run.end_time))
        return scene.model_copy(update={"model": model, "initial": initial, "run": run})
